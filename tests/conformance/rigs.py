"""All rigs of the conformance suite by name."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

from service.conformance import DriverRig
from tests.conformance.abb_rigs import ABB_RIGS
from tests.conformance.fanuc_rigs import FANUC_RIGS
from tests.conformance.instrument_rigs import INSTRUMENT_RIGS
from tests.conformance.ur_rigs import UR_RIGS
from tests.conformance.yaskawa_rigs import YASKAWA_RIGS

RIGS: dict[str, Callable[[ExitStack], DriverRig]] = {
    **ABB_RIGS,
    **FANUC_RIGS,
    **UR_RIGS,
    **YASKAWA_RIGS,
    **INSTRUMENT_RIGS,
}
# What comes back on this connection is used once, to see that a controller is there: only its requests are spoiled.
REQUESTS_ONLY = {"ur-program", "ur-x-program"}
# Where the robot moves on one request, which nobody confirms: a damaged one may send it elsewhere.
MOVE_AT_ONCE = {"abb-stock", "abb-simple-motion", "fanuc-mappdk", "fanuc-rmi", "ur-realtime", "ur-primary"}

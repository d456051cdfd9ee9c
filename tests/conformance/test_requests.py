"""Test damaged requests: nothing wrong is recorded, and custom programs move nothing.

A digit or a bit is changed, half of a request is lost or all of it, or it comes twice. The project's programs on
the controllers show a target and wait for a go, so the arm never moves to an unrequested target. Other programs
move on one request, so there the arm may go elsewhere. No reading may then state that it has reached the requested
target.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from mocks.faultproxy import REQUEST_FAULTS
from service.conformance import DriverRig
from service.conformance.faults import damaged_requests
from tests.conformance.rigs import MOVE_AT_ONCE, REQUESTS_ONLY, RIGS
from tests.conformance.test_faults import BRIDGED

FEW_REQUESTS = BRIDGED | REQUESTS_ONLY | {"ur-realtime", "ur-primary"}  # one or two a question
STATES_ONLY = {"abb-simple-state"}  # this port hears nothing
NO_SUM = {
    "leica-emscon"
}  # a beam that is sent elsewhere may find another target there: acquisition.run.checks.repeated_point


@pytest.fixture(scope="module", params=sorted(set(RIGS) - STATES_ONLY - NO_SUM))
def named_rig(request: pytest.FixtureRequest) -> Iterator[tuple[str, DriverRig]]:
    with ExitStack() as stack:
        yield request.param, RIGS[request.param](stack)


@pytest.mark.parametrize("fault", sorted(REQUEST_FAULTS))
def test_no_wrong_reading_and_no_motion_that_nobody_asked_for(
    named_rig: tuple[str, DriverRig], fault: str
) -> None:
    name, rig = named_rig
    damaged_requests(rig, fault, rate=0.3 if name in FEW_REQUESTS else 0.1)
    if name not in MOVE_AT_ONCE:
        assert rig.elsewhere() == []

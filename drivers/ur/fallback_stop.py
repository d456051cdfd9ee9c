"""A stop for a UR arm whose port 30003 does not answer, over two other ports.

30002 takes URScript as 30003 does, and the dashboard ends the running program (`stop`). Neither reports whether the arm
is at rest; a further RTDE connection does. Universal Robots, "Remote control via TCP/IP", "Dashboard server".
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress

from drivers.errors import LinkError, LinkTimeout
from drivers.link import Address, TcpLink, WireSink
from drivers.ur.dashboard import order
from drivers.ur.deadlines import UrDeadlines
from drivers.ur.rtde import Rtde
from drivers.ur.state import PAUSED, STOPPED


def halt_elsewhere(
    script: bytes,
    secondary: Address,
    dashboard: Address,
    rtde: Rtde,
    deadlines: UrDeadlines,
    wire: WireSink | None,
    clock: Callable[[], float] = time.monotonic,
) -> None:
    """Send `script` to 30002 and `stop` to the dashboard, and wait until the arm is at rest.

    The state is read over `rtde`, a separate link.

    Raises
    ------
    LinkError
        The arm is not reported at rest.
    """
    link = TcpLink(secondary, rtde.device, wire=wire, clock=clock)
    with suppress(LinkError):
        link.open(connect_s=deadlines.connect_s)
        link.send(script, command="stop", send_s=deadlines.send_s)
    try:
        order(dashboard, "stop", rtde.device, deadlines, wire)
        _see_at_rest(rtde, deadlines.stop_s, clock)
    finally:
        link.close()  # only now: closed with states unread it is reset, and its program is lost


def _see_at_rest(rtde: Rtde, seconds: float, clock: Callable[[], float]) -> None:
    rtde.open()
    try:
        with rtde.watch("stop") as witness:
            end = clock() + seconds
            while clock() < end:
                state = witness.state()
                if state.at_rest and state.runtime_state in (STOPPED, PAUSED):
                    return
    finally:
        rtde.close()
    raise LinkTimeout(
        f"the arm did not come to rest within stop_s = {seconds:g} s", device=rtde.device, command="stop"
    )

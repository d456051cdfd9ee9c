"""A stop for a UR arm whose port for programs does not answer, over its other ports.

30001, 30002 and 30003 take URScript alike; the dashboard and the Robot API end the running program (`stop`). None of
these answers reports whether the arm is at rest; a stream of states does. Universal Robots, "Remote control via
TCP/IP", "Dashboard server".
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress

from drivers.errors import LinkError, LinkTimeout
from drivers.link import TcpLink
from drivers.ur.deadlines import UrDeadlines
from drivers.ur.rtde import Rtde
from drivers.ur.script_port import ScriptPort
from drivers.ur.state import PAUSED, STOPPED


def halt_elsewhere(
    script: bytes,
    links: Iterable[TcpLink],
    end_program: Iterable[Callable[[], object]],
    feeds: Iterable[Rtde | ScriptPort],
    deadlines: UrDeadlines,
    clock: Callable[[], float] = time.monotonic,
) -> None:
    """Send `script` over every link, end the program otherwise too, and wait for rest.

    The state is read over the first of `feeds` that answers; each opens a separate connection.

    Raises
    ------
    LinkError
        The arm is not reported at rest.
    """
    with ExitStack() as until_rest:  # closed with states unread a link is reset, and its program is lost
        for link in links:
            until_rest.callback(link.close)
            with suppress(LinkError):
                link.open(connect_s=deadlines.connect_s)
                link.send(script, command="stop", send_s=deadlines.send_s)
        for end in end_program:
            end()
        _see_at_rest(feeds, deadlines.stop_s, clock)


def _see_at_rest(feeds: Iterable[Rtde | ScriptPort], seconds: float, clock: Callable[[], float]) -> None:
    problem: LinkError = LinkTimeout(
        f"the arm did not come to rest within stop_s = {seconds:g} s", command="stop"
    )
    end = clock() + seconds
    for feed in feeds:
        try:
            feed.open()
            with feed.watch("stop") as witness:
                while clock() < end:
                    state = witness.state()
                    if state.at_rest and state.runtime_state in (STOPPED, PAUSED):
                        return
        except LinkError as error:
            problem = error
        finally:
            feed.close()
    raise problem

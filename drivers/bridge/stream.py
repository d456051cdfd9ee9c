"""The points of a tracker behind an MBP/1 bridge in continuous mode.

`STREAM on=1 rate=` is active until the block ends. The bridge counts its samples. A sample that the tracker does not
have, because the beam is broken, is left out with its number. Meanwhile only PING is asked, without which a bridge
drops its client after 30 s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.bridge import mbp
from drivers.bridge.session import MbpSession
from drivers.bridge.tracker import FARTHEST_MM
from drivers.errors import LinkTimeout, MotionStopped
from drivers.interfaces import Sample

QUIET_S = 0.2  # after which the reader of the stream may do other work
BEAT_S = 4.0
SILENT_S = 10.0  # without an answer to two PINGs the bridge is gone
_COMMAND = "STREAM"


@contextmanager
def point_stream(session: MbpSession, rate_hz: float, device: str) -> Iterator[Iterator[Sample | None]]:
    """Stream points of the target that the beam holds. Errors of the bridge are passed on.

    Raises
    ------
    NotArmed
        The device is not armed.
    LinkError
        The connection failed.
    """
    with session.measuring(_COMMAND):
        session.ask(_COMMAND, {"on": 1, "rate": float(rate_hz)})
        try:
            yield _samples(session, device)
        finally:
            if session.client.link.is_open:
                session.ask(_COMMAND, {"on": 0})


def _samples(session: MbpSession, device: str) -> Iterator[Sample | None]:
    client = session.client
    heard = beat = client.clock()
    last_t_s = -math.inf
    while True:
        now = client.clock()
        if not session.armed:
            raise MotionStopped("stopped", device=device, command=_COMMAND)
        if now - heard > SILENT_S:
            client.link.close()
            raise LinkTimeout(f"nothing came for {SILENT_S:g} s", device=device, command=_COMMAND)
        if now - beat > BEAT_S:
            client.shout("PING")
            beat = now
        message = client.listen(_COMMAND, QUIET_S)
        if message is None:
            yield None
            continue
        heard = now
        if message.kind == "SAMPLE":
            with session.understood():
                sample = _sample(message, last_t_s)
            last_t_s = max(last_t_s, sample.t_s)
            yield sample


def _sample(message: mbp.Message, last_t_s: float) -> Sample:
    """Parse the sample in a message.

    Raises
    ------
    ProtocolError
        The message is not a sample of a tracker.
    """
    x, y, z = (mbp.number(message, axis, -FARTHEST_MM, FARTHEST_MM) for axis in "xyz")
    t_s = mbp.number(message, "t", -1e12, 1e12)
    doubt = ""
    if mbp.number(message, "status", 0, 9) != 0:
        doubt = "marked inaccurate"
    elif math.hypot(x, y, z) < 1.0:
        doubt = "at the origin of the tracker"
    elif t_s <= last_t_s:
        doubt = "the clock did not advance"
    return Sample(t_s, (x, y, z), message.number, doubt)

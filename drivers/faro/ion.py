"""FARO ION tracker behind an MBP/1 bridge (TCP 5701): the vendor's own socket protocol is not public.

Points are in the tracker's own frame, in mm. The conversation is `drivers.bridge.session`; what an answer must say to
be taken as a point is `drivers.bridge.tracker`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Unpack

from drivers.bridge.session import MbpSession, SessionArguments
from drivers.bridge.tracker import MeasureRequest, ask_weather, check_question, point_at, point_of, status_of
from drivers.deadlines import InstrumentDeadlines
from drivers.errors import ConfigError
from drivers.interfaces import Identity, InstrumentStatus, PointReading


class FaroTracker:
    """The driver of a FARO tracker. Methods block; `stop` may be called from any thread."""

    unverified_on_hardware = True

    def __init__(
        self,
        url: str,
        *,
        name: str = "faro",
        distance_mode: str = "IFM_ADM",
        rate_hz: float = 100.0,
        age_limit_s: float = 1.0,
        scatter_limit_mm: float = 0.25,
        deadlines: InstrumentDeadlines | None = None,
        **talk: Unpack[SessionArguments],
    ) -> None:
        if distance_mode not in ("ADM", "IFM", "IFM_ADM"):
            raise ConfigError(f"distance_mode {distance_mode!r} is not ADM, IFM or IFM_ADM", device=name)
        if rate_hz <= 0:
            raise ConfigError(f"rate_hz {rate_hz} must be positive", device=name)
        self.name = name
        self.deadlines = deadlines or InstrumentDeadlines()
        self._distance_mode = distance_mode
        self._rate_hz = rate_hz
        self._limits = (age_limit_s, scatter_limit_mm)
        self.session = MbpSession(url, name, "TRACKER", lambda: self.deadlines, **talk)

    def connect(self) -> None:
        """Open and greet; the head does not move. Raises LinkError, Busy."""
        self.session.connect()

    def disconnect(self) -> None:
        """Close and disarm; never raises."""
        self.session.disconnect()

    @property
    def weakness(self) -> str:
        """The errors that this bridge cannot detect; empty where it sends checksums. Once connected."""
        return self.session.weakness

    def identify(self) -> Identity:
        """The identity from the bridge's greeting. Raises LinkError when not connected."""
        return self.session.identify()

    def arm(self) -> None:
        """Initialise if needed (the head moves), check state and weather, choose the distance mode.

        Raises LinkError, NotReady, SafetyStop.
        """
        with self.session.arming():
            ask_weather(self.session, {})
            self.session.ask("MODE", {"distance": self._distance_mode})

    def disarm(self) -> None:
        """Allow no more measurements until armed again; never raises."""
        self.session.armed = False

    def measure(
        self, target: str, *, samples: int = 100, near_mm: Sequence[float] | None = None
    ) -> PointReading:
        """Average `samples` readings of the SMR in nest `target`.

        With `near_mm` (tracker frame) the beam is pointed there and the nearest SMR found; without, the
        name is passed on and a bridge that cannot point by name measures the SMR that the beam holds.
        Raises NotArmed, LinkError, Unmeasurable, MotionStopped (after `stop`), NotReady, SafetyStop.
        """
        check_question(target, samples, self.name)
        with self.session.measuring("MEASURE"):
            if near_mm is not None:
                point_at(self.session, near_mm, self.deadlines.point_s)
            lasts_s = samples / self._rate_hz
            seconds = lasts_s + self.deadlines.measure_margin_s
            fields: dict[str, object] = {
                "samples": samples,
                "rate": self._rate_hz,
                "timeout": seconds,
                "face": 1,
            }
            if near_mm is None:
                fields["target"] = target
            reply = self.session.ask("MEASURE", fields, "measure_s", seconds)
            with self.session.understood():
                asked = MeasureRequest(target, samples, lasts_s, *self._limits)
                return point_of(self.session, reply, asked)

    def stop(self) -> None:
        """Abort the measurement in progress and disarm; from any thread, at any time. Raises LinkError."""
        self.session.stop()

    def status(self) -> InstrumentStatus:
        """State and weather. Raises LinkError, SafetyStop."""
        return status_of(self.session)

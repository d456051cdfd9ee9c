"""FARO ION tracker behind an MBP/1 bridge (TCP 5701).

The vendor's own socket protocol is not public. Points are in the tracker's own frame, in mm. The conversation is
`drivers.bridge.session`; `drivers.bridge.tracker` decides whether an answer is accepted as a point.
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
            raise ConfigError(
                f"distance_mode {distance_mode!r} is not ADM, IFM or IFM_ADM",
                device=name,
                what_to_do="Use one of the three.",
            )
        if rate_hz <= 0:
            raise ConfigError(
                f"rate_hz {rate_hz} must be positive", device=name, what_to_do="Set a rate above 0 Hz."
            )
        self.name = name
        self.deadlines = deadlines or InstrumentDeadlines()
        self._distance_mode = distance_mode
        self._rate_hz = rate_hz
        self._limits = (age_limit_s, scatter_limit_mm)
        self.session = MbpSession(url, name, "TRACKER", lambda: self.deadlines, **talk)

    def connect(self) -> None:
        """Open and greet; the head does not move.

        Raises
        ------
        LinkError
            The connection failed.
        Busy
            The bridge is in use.
        """
        self.session.connect()

    def disconnect(self) -> None:
        """Close and disarm; never raises."""
        self.session.disconnect()

    @property
    def weakness(self) -> str:
        """The errors that this bridge cannot detect; empty if it sends checksums. Once connected."""
        return self.session.weakness

    def identify(self) -> Identity:
        """Return the identity from the bridge's greeting.

        Raises
        ------
        LinkError
            The device is not connected.
        """
        return self.session.identify()

    def arm(self) -> None:
        """Initialise if needed (the head moves), check state and weather, choose the distance mode.

        Raises
        ------
        LinkError
            The connection failed.
        NotReady
            The tracker is not ready, or has no weather.
        SafetyStop
            The tracker is in an emergency stop.
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

        With `near_mm` (tracker frame) the beam is pointed there and the nearest SMR is found. Without it, the name is
        passed on; a bridge that cannot point by name measures the SMR that the beam holds.

        Raises
        ------
        NotArmed, NotReady, SafetyStop
            The tracker cannot measure now.
        LinkError
            The connection failed.
        Unmeasurable
            The reading cannot be used.
        MotionStopped
            `stop` was called.
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
        """Abort the measurement in progress and disarm; from any thread, at any time.

        Raises
        ------
        LinkError
            The connection failed.
        """
        self.session.stop()

    def status(self) -> InstrumentStatus:
        """Return state and weather.

        Raises
        ------
        LinkError
            The connection failed.
        SafetyStop
            The bridge reports one.
        """
        return status_of(self.session)

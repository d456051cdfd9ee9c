"""Leica AT960 (and AT930, AT40x under LMF) behind an MBP/1 bridge (TCP 5701).

The bridge runs on the LMF library, because LMF's wire protocol is not public. Points are in the tracker's own frame,
mm. The tracker measures absolute distances, so a broken beam costs only the reading: pointing at the target finds it
again. The reflector is sent to the bridge and must come back as sent, because its offset is in every distance. Trackers
that speak emScon (AT901, AT401, AT402) need no bridge: `drivers.leica.emscon`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Unpack

from drivers.bridge import mbp
from drivers.bridge.session import MbpSession, SessionArguments
from drivers.bridge.stream import point_stream
from drivers.bridge.tracker import MeasureRequest, ask_weather, check_question, point_at, point_of, status_of
from drivers.deadlines import InstrumentDeadlines
from drivers.errors import CommandRefused, ConfigError, NotReady
from drivers.interfaces import Identity, InstrumentStatus, PointReading, Sample

# LMF: 12 s for a Standard or Precise point, 2 s more for two faces, 3 s for going there.
LEICA_DEADLINES = replace(InstrumentDeadlines(), measure_margin_s=15.0)
_SMR = "Seat the right SMR or correct reflector_mm in the cell file."
_PROFILES = ("FAST", "STANDARD", "PRECISE")
_FACES = {"one": ("1", 1.0), "both": ("BOTH", 2.0)}


class LeicaTracker:
    """The driver of an AT960. Methods block; `stop` may be called from any thread."""

    unverified_on_hardware = True

    def __init__(
        self,
        url: str,
        *,
        name: str = "leica",
        profile: str = "STANDARD",
        faces: str = "one",
        rate_hz: float = 100.0,
        reflector_mm: float = 38.1,
        search_radius_mm: float = 30.0,
        age_limit_s: float = 1.0,
        scatter_limit_mm: float = 0.25,
        deadlines: InstrumentDeadlines | None = None,
        **talk: Unpack[SessionArguments],
    ) -> None:
        if profile not in _PROFILES or faces not in _FACES:
            raise ConfigError(
                f"profile is one of {_PROFILES}, faces one of {tuple(_FACES)}",
                device=name,
                what_to_do="Correct them in the cell file.",
            )
        if not rate_hz > 0.0 or not reflector_mm > 0.0:
            raise ConfigError(
                f"rate_hz {rate_hz} and reflector_mm {reflector_mm} must be positive",
                device=name,
                what_to_do="Correct them in the cell file.",
            )
        self.name = name
        self._profile = profile
        self._face, self._times = _FACES[faces]
        self._rate_hz = rate_hz
        self._reflector_mm = reflector_mm
        self._search_radius_mm = search_radius_mm
        self._limits = (age_limit_s, scatter_limit_mm)
        self.deadlines = deadlines or LEICA_DEADLINES
        self.session = MbpSession(url, name, "TRACKER", lambda: self.deadlines, **talk)

    def connect(self) -> None:
        """Open and greet; the head does not move.

        Raises
        ------
        LinkError
            The connection failed.
        ProtocolError
            Another device answers.
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
        """Initialise if needed (the head moves); set weather station, profile and reflector.

        Raises
        ------
        LinkError
            The connection failed.
        NotReady
            The tracker is not ready, or the bridge does not confirm the reflector.
        SafetyStop
            The tracker is in an emergency stop.
        """
        with self.session.arming():
            ask_weather(self.session, {"source": "STATION"})
            self.session.ask("MODE", {"distance": "ADM", "profile": self._profile})
            try:
                reply = self.session.ask("TARGET", {"type": "SMR", "d": self._reflector_mm})
            except CommandRefused as error:
                error.what_to_do = _SMR
                raise
            with self.session.understood():
                used_mm = mbp.number(reply, "d", 0.0, 500.0)
            if used_mm != self._reflector_mm:
                raise NotReady(
                    f"the tracker uses a reflector of {used_mm:g} mm, the cell one of {self._reflector_mm:g} mm",
                    command="TARGET",
                    raw=reply.raw,
                    what_to_do=_SMR,
                )

    def disarm(self) -> None:
        """Allow no more measurements until armed again; never raises."""
        self.session.armed = False

    def measure(
        self, target: str, *, samples: int = 100, near_mm: Sequence[float] | None = None
    ) -> PointReading:
        """Average `samples` readings of the SMR in nest `target`.

        `near_mm` is used as in `drivers.faro.ion`.

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
        lasts_s = self._times * samples / self._rate_hz
        fields: dict[str, object] = {"samples": samples, "rate": self._rate_hz, "face": self._face}
        with self.session.measuring("MEASURE"):
            if near_mm is not None:
                point_at(self.session, near_mm, self.deadlines.point_s, radius=self._search_radius_mm)
            else:
                fields["target"] = target
            seconds = lasts_s + self.deadlines.measure_margin_s
            reply = self.session.ask("MEASURE", fields | {"timeout": seconds}, "measure_s", seconds)
            with self.session.understood():
                asked = MeasureRequest(target, samples, lasts_s, *self._limits)
                return point_of(self.session, reply, asked)

    def stream(self, rate_hz: float) -> AbstractContextManager[Iterator[Sample | None]]:
        """Stream points of the SMR that was measured last, in continuous mode.

        Raises
        ------
        NotArmed
            The tracker is not armed.
        LinkError
            The connection failed.
        """
        return point_stream(self.session, rate_hz, self.name)

    def stop(self) -> None:
        """Abort the measurement in progress and disarm; from any thread.

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

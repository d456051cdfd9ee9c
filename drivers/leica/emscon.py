"""Leica AT901, AT401, AT402 over emScon packets (TCP 700).

The AT960 needs a bridge: `drivers.leica.at960`. A measurement packet names no question. A late or doubled one must not
be accepted as another reading. Therefore the tracker's status is asked before every measurement. A packet that
arrives before that answer ends the connection, as does every packet that is not the next one expected. The packet has
no time: `t_s` is the clock of this computer, and a reading exactly like the one before is refused as stale.
Millimetres, degrees.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Sequence

from drivers.deadlines import InstrumentDeadlines
from drivers.errors import (
    AcquisitionError,
    Busy,
    ConfigError,
    LinkError,
    LinkLost,
    MotionStopped,
    NoisyMeasurement,
    NotArmed,
    NotReady,
    ProtocolError,
    TargetNotSeen,
    Unmeasurable,
    naming,
)
from drivers.interfaces import Identity, InstrumentStatus, PointReading
from drivers.leica import emscon_packets as tpi
from drivers.leica.emscon_packets import Packet
from drivers.leica.emscon_settings import can_be, meddled, needed, put_in_order
from drivers.link import TcpLink, WireSink, parse_url

_LOG = logging.getLogger(__name__)
_UNITS = (1, 1, 0, 1, 0)  # mm, deg, degC, hPa, %RH
_STATES = {0: "OFF", 1: "BUSY", 2: "READY", 3: "READY"}  # 3: only the 6D of a probe is invalid
_FARTHEST_MM = 100_000.0
_SHORTEST_MS, _LONGEST_MS = 500, 100_000
# Codes of unsolicited changes.
_WEAKNESS = "emScon has no checksum: an answer of which one bit is damaged on its way is taken for measured"
_LOST = 25  # measurement status not ready
_GONE = (851, 997, 998)  # sensor disconnected, server closing


class EmsconTracker:
    """The driver of an emScon tracker. Methods block; `stop` may be called from any thread."""

    unverified_on_hardware = True

    def __init__(
        self,
        url: str,
        *,
        name: str = "emscon",
        reflector: str | None = None,
        rate_hz: float = 100.0,
        search_radius_mm: float = 30.0,
        scatter_limit_mm: float = 0.25,
        deadlines: InstrumentDeadlines | None = None,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if not rate_hz > 0.0:
            raise ConfigError(
                f"rate_hz {rate_hz} must be positive", device=name, what_to_do="Set a rate above 0 Hz."
            )
        self.name = name
        self.deadlines = deadlines or InstrumentDeadlines()
        self._reflector = reflector
        self._reflector_first: int | None = None  # if none is named: of the first arming
        self._rate_hz = rate_hz
        self._search_radius_mm = search_radius_mm
        self._scatter_limit_mm = scatter_limit_mm
        self._clock = clock
        self._link = TcpLink(parse_url(url), name, wire=wire, clock=clock)
        self._lock = threading.RLock()
        self._send_lock = threading.Lock()
        self._stopping = threading.Event()
        self._armed = False
        self._time_ms = 0
        self._changes: list[int] = []
        self._last: tuple[float, ...] = ()
        self._warned = False

    # -- connection ---------------------------------------------------------------------------------------

    def connect(self) -> None:
        """Open and ask for the identity; the head does not move.

        Raises
        ------
        LinkError
            The connection failed.
        ProtocolError
            Another device answers.
        Busy
            The tracker is in use.
        """
        if not self._warned:
            self._warned = True
            _LOG.warning("%s: this driver is UNVERIFIED ON HARDWARE: check its first readings", self.name)
        self.disconnect()
        end = self._clock() + self.deadlines.takeover_s
        with self._lock:
            while True:  # a server notices late that its client (us, a moment ago) is gone
                self._link.open(connect_s=self.deadlines.connect_s)
                try:
                    self._ask(tpi.GET_SYSTEM_STATUS)
                except Busy:
                    self._link.close()
                    if self._clock() >= end:
                        raise
                    threading.Event().wait(self.deadlines.takeover_s / 20)
                else:
                    return

    def disconnect(self) -> None:
        """Close and disarm; never raises."""
        self._armed = False
        self._link.close()

    @property
    def weakness(self) -> str:
        """The errors that this protocol cannot detect."""
        return _WEAKNESS

    def identify(self) -> Identity:
        """Return the serial number and the version of the server.

        Raises
        ------
        LinkError
            The connection failed.
        """
        values = self._ask(tpi.GET_SYSTEM_STATUS).values
        version = ".".join(str(each) for each in values[4:7])
        return Identity("Leica", "emScon tracker", str(values[9]), version, "emscon", None)

    # -- arming -------------------------------------------------------------------------------------------

    def arm(self) -> None:
        """Set units, weather, settings, mode and reflector; initialise if needed (the head moves).

        Raises
        ------
        LinkError
            The connection failed.
        NotReady
            The tracker is not ready, has no weather station, or uses another reflector than before.
        ConfigError
            There is no such reflector.
        """
        with self._lock, naming(self.name, "arm"):
            self._ask(tpi.SET_UNITS, *_UNITS)
            if self.status().state == "OFF":
                self._ask(tpi.INITIALIZE, deadline="init_s", seconds=self.deadlines.init_s)
            state = self.status()
            if state.state != "READY":
                raise NotReady(f"tracker is {state.state}", raw=state.raw)
            if not self.has_weather_station():
                raise NotReady("no weather station")
            self._put_settings_in_order()
            self._ask(tpi.SET_COORDINATES, 0)  # right-handed Cartesian
            self._ask(tpi.SET_MODE, 0)  # stationary
            self._ask(tpi.SET_SEARCH, self._search_radius_mm, round(1000 * self.deadlines.point_s / 2))
            if self._reflector is not None:
                self._ask(tpi.SET_REFLECTOR, self._reflector_number(self._reflector))
            self._refuse_another_reflector()
            self._time_ms = 0
            self._ask(tpi.GET_TRACKER_STATUS)  # the changes made here have been reported before its answer
            self._changes.clear()
            self._stopping.clear()
            self._armed = True

    def disarm(self) -> None:
        """Allow no more measurements until armed again; never raises."""
        self._armed = False

    def _put_settings_in_order(self) -> None:
        packet = self._ask(tpi.GET_SETTINGS)
        settings = packet.values
        if not can_be(settings):
            raise self._impossible("settings that do not exist", packet)
        if needed(settings) != settings:
            _LOG.warning("%s: set for these readings: %s", self.name, put_in_order(settings))
            self._ask(tpi.SET_SETTINGS, *needed(settings))

    def _refuse_another_reflector(self) -> None:
        """Refuse another reflector than before, because its offset is in every point.

        If the cell file names none, that of the first arming counts.

        Raises
        ------
        NotReady
            The tracker uses another reflector.
        """
        packet = self._ask(tpi.GET_REFLECTOR)
        number = packet.values[0]
        if self._reflector_first is None or self._reflector is not None:
            self._reflector_first = number
        if number != self._reflector_first:
            raise NotReady(
                f"the tracker uses reflector {number}, until now it was {self._reflector_first}",
                raw=packet.raw,
                what_to_do="Choose the previous reflector in the program of the tracker, then confirm.",
            )

    def _reflector_number(self, wanted: str) -> int:
        """Return the number of a reflector by its name.

        The server answers with one packet for each reflector.
        """
        numbers: dict[str, int] = {}
        with self._link.question("GetReflectors", unread_allowed=True), naming(self.name, "GetReflectors"):
            packet = self._ask(tpi.GET_REFLECTORS)
            for left in range(int(packet.values[0]) - 1, -1, -1):
                name = packet.values[4].decode("utf-16-le", "replace").split("\0")[0]
                numbers[name] = packet.values[1]
                if left:
                    packet = self._next("GetReflectors", "reply_s", self._clock() + self.deadlines.reply_s)
                    if (packet.kind, packet.number) != (tpi.COMMAND, tpi.GET_REFLECTORS):
                        raise _strange(packet)
        if wanted not in numbers:
            known = ", ".join(numbers)
            raise ConfigError(f"no reflector {wanted!r}; the tracker has {known}", command="GetReflectors")
        return numbers[wanted]

    # -- measuring ----------------------------------------------------------------------------------------

    def measure(
        self, target: str, *, samples: int = 100, near_mm: Sequence[float] | None = None
    ) -> PointReading:
        """Make a stationary measurement as long as `samples` at `rate_hz` take, 0.5 s at least.

        With `near_mm` (tracker frame) the beam is first pointed there to find the reflector. Without it, the reflector
        in the beam is measured, because emScon has no names of targets. Errors are those of `drivers.faro.ion`.
        """
        if samples < 1:
            raise ConfigError(
                f"samples = {samples} must be at least 1",
                device=self.name,
                command="measure",
                what_to_do="Set samples to 1 or more.",
            )
        with self._lock:
            if not self._armed:
                raise NotArmed("measurement without arming", device=self.name, command="measure")
            time_ms = min(max(_SHORTEST_MS, round(1000.0 * samples / self._rate_hz)), _LONGEST_MS)
            if time_ms != self._time_ms:
                self._ask(tpi.SET_STATIONARY, time_ms, 1)
                self._time_ms = time_ms
            if near_mm is not None:
                try:
                    self._point(near_mm)
                except Unmeasurable as error:  # in other units no target is where it is expected
                    self._refuse_meddling(error.raw)
                    raise
            status = self._ask(tpi.GET_TRACKER_STATUS)  # nothing of an earlier measurement can come after it
            if status.values[0] not in (2, 3):
                raise NotReady("tracker is not ready", device=self.name, command="measure", raw=status.raw)
            self._refuse_meddling(status.raw)
            packet = self._single(time_ms / 1000.0 + self.deadlines.measure_margin_s)
            return self._reading(packet, target, samples)

    def _refuse_meddling(self, raw: bytes) -> None:
        """Refuse measurements with settings that another program changed.

        Raises
        ------
        NotReady
            Another program changed a setting; the tracker is disarmed.
        """
        error = meddled(self._changes)
        self._changes.clear()
        if error is not None:
            self._armed = False
            error.device, error.command, error.raw = self.name, "measure", raw
            raise error

    def _point(self, near_mm: Sequence[float]) -> None:
        x, y, z = (float(value) for value in near_mm)
        if not all(math.isfinite(value) and abs(value) < _FARTHEST_MM for value in (x, y, z)):
            raise ConfigError(
                f"cannot point at {near_mm}",
                device=self.name,
                command="GoPosition",
                what_to_do="Give three finite coordinates in mm.",
            )
        self._ask(tpi.GO_POSITION, x, y, z, 1, deadline="point_s", seconds=self.deadlines.point_s)

    def _single(self, seconds: float) -> Packet:
        end = self._clock() + seconds
        self._ask(tpi.START_MEASUREMENT)
        error: AcquisitionError | None = None
        what = "StartMeasurement"
        with self._link.question(what, unread_allowed=True), naming(self.name, what):
            packet = self._next(what, "measure_s", end)
            if (packet.kind, packet.number) == (
                tpi.COMMAND,
                tpi.STOP_MEASUREMENT,
            ) and self._stopping.is_set():
                error = MotionStopped("stopped", device=self.name, command="measure", raw=packet.raw)
            elif packet.kind == tpi.ERROR or (packet.kind == tpi.SINGLE and packet.status != 0):
                error = tpi.error_of(packet, self.name, "measure")
            elif packet.kind != tpi.SINGLE:
                raise _strange(packet)
        if error is not None:
            raise error
        return packet

    def _reading(self, packet: Packet, target: str, samples: int) -> PointReading:
        mode, tried, *figures = packet.values
        point, std = tuple(figures[0:3]), tuple(figures[3:6])
        air = tuple(figures[14:17])
        if not all(math.isfinite(value) for value in (*point, *std, *air)):
            raise self._impossible("a number that is none", packet)
        if not 1.0 <= math.hypot(*point) <= _FARTHEST_MM or min(std) < 0.0:
            raise self._impossible("a point at the origin or out of the world", packet)
        if _LOST in self._changes:
            raise TargetNotSeen("target lost during the reading", device=self.name, raw=packet.raw)
        self._refuse_meddling(packet.raw)
        for bad, why in (
            (mode != 0 or tried != 0, "of another mode"),
            (point == self._last, "exactly like the one before"),
            (max(std) > self._scatter_limit_mm, f"scattered by {max(std):g} mm"),
        ):
            if bad:
                raise NoisyMeasurement(f"reading {why}", device=self.name, command="measure", raw=packet.raw)
        self._last = point
        return PointReading(
            target=target,
            xyz_mm=(point[0], point[1], point[2]),
            std_mm=(std[0], std[1], std[2]),
            samples=samples,
            t_s=self._clock(),
            age_s=0.0,
            t_air_c=air[0],
            pressure_hpa=air[1],
            humidity_percent=air[2],
            mode="ADM",
            raw=packet.raw,
        )

    def stop(self) -> None:
        """Abort the measurement in progress and disarm; from any thread, at any time.

        Raises
        ------
        LinkError
            The connection failed.
        """
        self._armed = False
        self._stopping.set()
        if self._lock.acquire(blocking=False):
            try:
                self._ask(tpi.STOP_MEASUREMENT)
            finally:
                self._lock.release()
        else:
            self._send(tpi.STOP_MEASUREMENT)  # the pending question then ends

    def status(self) -> InstrumentStatus:
        """Return state and weather.

        Raises
        ------
        LinkError
            The connection failed, or the answer is impossible.
        """
        with self._lock:
            ready = self._ask(tpi.GET_TRACKER_STATUS)
            t, p, h = self._ask(tpi.GET_ENVIRONMENT).values
            if ready.values[0] not in _STATES or not (-40.0 < t < 80.0 and 300.0 < p < 1300.0 and h >= 0.0):
                raise self._impossible("an unknown state or an impossible weather", ready)
            return InstrumentStatus(_STATES[ready.values[0]], t, p, h, ready.raw)

    def has_weather_station(self) -> bool:
        """Check that there is a weather station; without one the server repeats the last weather.

        Raises
        ------
        LinkError
            The connection failed.
        """
        return self._ask(tpi.GET_SYSTEM_STATUS).values[7] != 0

    # -- packets ------------------------------------------------------------------------------------------

    def _ask(
        self, number: int, *arguments: float, deadline: str = "reply_s", seconds: float | None = None
    ) -> Packet:
        """Return the good answer to one command; another status is raised as its error class.

        Raises
        ------
        LinkError
            The connection failed.
        """
        what = f"command {number}"
        error: AcquisitionError | None = None
        with self._lock, self._link.question(what, unread_allowed=True), naming(self.name, what):
            self._send(number, *arguments)
            end = self._clock() + (self.deadlines.reply_s if seconds is None else seconds)
            packet = self._next(what, deadline, end)
            while packet.kind == tpi.ERROR and packet.number != number:
                # Unsolicited, for example when a person walks through the beam
                packet = self._next(what, deadline, end)
            if packet.kind not in (tpi.COMMAND, tpi.ERROR) or packet.number != number:
                raise _strange(packet)
            if packet.status != 0:
                error = tpi.error_of(packet, self.name, what)
            if isinstance(error, LinkError):
                raise error
        if error is not None:
            raise error
        return packet

    def _send(self, number: int, *arguments: float) -> None:
        with self._send_lock:
            data = tpi.command(number, *arguments)
            self._link.send(data, command=f"command {number}", send_s=self.deadlines.send_s)

    def _next(self, what: str, deadline: str, end: float) -> Packet:
        """Return the next requested packet, and note changes of status."""
        while True:
            header = self._read(tpi.HEADER.size, what, deadline, end)
            packet = tpi.parse(header + self._read(tpi.rest_of(header), what, deadline, end))
            if packet.kind in tpi.UNASKED:
                continue
            if packet.kind != tpi.CHANGE:
                return packet
            self._changes.append(packet.number)
            if packet.number in _GONE:
                raise LinkLost(f"tracker reports {packet.number} and ends the connection", raw=packet.raw)

    def _read(self, count: int, what: str, deadline: str, end: float) -> bytes:
        left = max(end - self._clock(), 0.0)
        return self._link.read_exactly(count, command=what, deadline=deadline, seconds=left)

    def _impossible(self, why: str, packet: Packet) -> ProtocolError:
        self._link.close()
        return ProtocolError(
            f"tracker reports {why}",
            device=self.name,
            command="measure",
            raw=packet.raw,
            what_to_do="The answer cannot be a measurement: look at the tracker's own program, then connect again.",
        )


def _strange(packet: Packet) -> ProtocolError:
    said = f"packet of type {packet.kind}, command {packet.number} is not the answer"
    return ProtocolError(said, raw=packet.raw)

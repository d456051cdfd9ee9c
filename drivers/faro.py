"""FARO ION tracker behind an MBP/1 bridge (TCP 5701): the vendor's own socket protocol is not public.

A reading is refused when it is not exactly what was asked for: other number of samples, status other than
accurate, older than `age_limit_s`, a device clock that did not advance, scattered, a point at the origin
(what a failed vendor call returns), polar and Cartesian coordinates that disagree, or the target lost
within the averaging time. Points are in the tracker's own frame, in mm.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivers import mbp
from drivers.errors import (
    BeamBroken,
    Busy,
    ConfigError,
    LinkError,
    MotionStopped,
    NoisyMeasurement,
    NotArmed,
    NotReady,
    ProtocolError,
    TargetNotSeen,
)
from drivers.interfaces import Identity, InstrumentStatus, PointReading
from drivers.link import WireSink, parse_url

_LOG = logging.getLogger(__name__)
_FARTHEST_MM = 100_000.0  # beyond the range of any tracker
_POLAR_AGREES_MM = 0.05
_STATES = ("OFF", "WARMING", "READY", "BUSY", "ERROR", "ESTOP")


@dataclass(frozen=True, slots=True)
class FaroDeadlines:
    """Named waits in seconds. A measurement may take samples/rate + `measure_margin_s`."""

    connect_s: float = 3.0
    send_s: float = 1.0
    reply_s: float = 2.0
    init_s: float = 180.0
    point_s: float = 15.0
    takeover_s: float = 1.0
    measure_margin_s: float = 5.0


class FaroTracker:
    """One FARO tracker. Verbs block; `stop` may be called from any thread."""

    unverified_on_hardware = True

    def __init__(
        self,
        url: str,
        *,
        name: str = "faro",
        distance_mode: str = "IFM_ADM",
        rate_hz: float = 100.0,
        search_radius_mm: float = 30.0,
        age_limit_s: float = 1.0,
        scatter_limit_mm: float = 0.25,
        heartbeat_s: float | None = 4.0,
        deadlines: FaroDeadlines | None = None,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if distance_mode not in ("ADM", "IFM", "IFM_ADM"):
            raise ConfigError(f"distance_mode {distance_mode!r} is not ADM, IFM or IFM_ADM", device=name)
        if rate_hz <= 0:
            raise ConfigError(f"rate_hz {rate_hz} must be positive", device=name)
        self.name = name
        self.deadlines = deadlines or FaroDeadlines()
        self._distance_mode = distance_mode
        self._rate_hz = rate_hz
        self._search_radius_mm = search_radius_mm
        self._age_limit_s = age_limit_s
        self._scatter_limit_mm = scatter_limit_mm
        self._heartbeat_s = heartbeat_s
        self._client = mbp.MbpClient(parse_url(url), name, self.deadlines.send_s, wire, clock)
        self._clock = clock
        self._lock = threading.RLock()
        self._hello: mbp.Message | None = None
        self._armed = False
        self._stopping = threading.Event()
        self._last_t_s = -math.inf
        self._quit = threading.Event()
        self._heart: threading.Thread | None = None
        self._warned = False

    # -- connection ---------------------------------------------------------------------------------------

    def connect(self) -> None:
        """Open and greet; the head does not move. Raises LinkError, Busy."""
        if not self._warned:
            self._warned = True
            _LOG.warning("%s: this FARO driver is unverified on hardware", self.name)
        self.disconnect()
        with self._lock:
            hello = self._greet()
            wanted = {"proto": "1", "kind": "TRACKER"}
            for key, value in wanted.items():
                if hello.fields.get(key) != value:
                    self._client.link.close()
                    raise ProtocolError(
                        f"{key} is {hello.fields.get(key)}, needed {value}",
                        device=self.name,
                        command="HELLO",
                        raw=hello.raw,
                        what_to_do="Check that the address belongs to the bridge of the tracker.",
                    )
            self._hello = hello
            self._last_t_s = -math.inf
        if self._heartbeat_s is not None:
            self._quit = threading.Event()
            self._heart = threading.Thread(target=self._beat, args=(self._quit,), daemon=True)
            self._heart.start()

    def _greet(self) -> mbp.Message:
        """A bridge notices late that its client (us, a moment ago) is gone: `takeover_s` is left to it."""
        limits = self.deadlines
        end = self._clock() + limits.takeover_s
        while True:
            try:
                return self._client.open(connect_s=limits.connect_s, reply_s=limits.reply_s)
            except Busy:
                self._client.link.close()
                if self._clock() >= end:
                    raise
                threading.Event().wait(limits.takeover_s / 20)

    def disconnect(self) -> None:
        """Close and disarm; never raises."""
        self._quit.set()
        self._armed = False
        self._hello = None
        self._client.link.close()
        heart, self._heart = self._heart, None
        if heart is not None:
            heart.join()

    def _beat(self, quit_: threading.Event) -> None:
        """The bridge drops a client that is silent for 30 s; prompts and moves can take longer."""
        while not quit_.wait(self._heartbeat_s):
            with self._lock:
                if quit_.is_set() or not self._client.link.is_open:
                    return
                try:
                    self._client.ask("PING", {}, "reply_s", self.deadlines.reply_s)
                except LinkError as error:  # the link is closed now; the next question tells the sequencer
                    _LOG.warning("%s", error)
                    return

    def identify(self) -> Identity:
        """What the bridge said in its greeting. Raises LinkError when not connected."""
        with self._lock:
            if self._hello is None:
                self._ask("PING", {})  # raises "not connected"
                raise ProtocolError("no greeting", device=self.name, command="identify")
            said = self._hello.fields.get
            simulated = {"0": False, "1": True}.get(said("sim", ""))
            return Identity(
                said("vendor", ""), said("model", ""), said("serial", ""), said("fw", ""), "mbp1", simulated
            )

    # -- arming -------------------------------------------------------------------------------------------

    def arm(self) -> None:
        """Initialise if needed (the head moves), check state and weather, choose the distance mode.

        Raises LinkError, NotReady, SafetyStop.
        """
        with self._lock:
            if self.status().state == "OFF":
                self._ask("INIT", {}, "init_s", self.deadlines.init_s)
            state = self.status().state
            if state != "READY":
                raise NotReady(f"tracker is {state}", device=self.name, command="arm")
            weather = self._ask("WEATHER", {})
            with self._understood():
                mbp.number(weather, "T", -20.0, 60.0)
                mbp.number(weather, "P", 500.0, 1200.0)
                mbp.number(weather, "H", 0.0, 100.0)
            self._ask("MODE", {"distance": self._distance_mode})
            self._stopping.clear()
            self._armed = True

    def disarm(self) -> None:
        """No more measurements until armed again; never raises."""
        self._armed = False

    # -- measuring ----------------------------------------------------------------------------------------

    def measure(
        self, target: str, *, samples: int = 100, near_mm: Sequence[float] | None = None
    ) -> PointReading:
        """Average `samples` readings of the SMR in nest `target`.

        With `near_mm` (tracker frame) the beam is pointed there and the nearest SMR found; without, the
        name is passed on and a bridge that cannot point by name measures the SMR that the beam holds.
        Raises NotArmed, LinkError, Unmeasurable, MotionStopped (after `stop`), NotReady, SafetyStop.
        """
        if not target.isidentifier() or not target.isascii():
            raise ConfigError(f"target name {target!r} is not a word", device=self.name, command="measure")
        if samples < 1:
            raise ConfigError(f"samples = {samples} must be at least 1", device=self.name, command="measure")
        with self._lock:
            if not self._armed:
                raise NotArmed("measurement without arming", device=self.name, command="MEASURE")
            self._client.events.clear()
            if near_mm is not None:
                self._point(near_mm)
            seconds = samples / self._rate_hz + self.deadlines.measure_margin_s
            fields: dict[str, object] = {
                "samples": samples,
                "rate": self._rate_hz,
                "timeout": seconds,
                "face": 1,
            }
            if near_mm is None:
                fields["target"] = target
            reply = self._ask("MEASURE", fields, "measure_s", seconds)
            with self._understood():
                return self._reading(reply, target, samples)

    def _point(self, near_mm: Sequence[float]) -> None:
        x, y, z = (float(value) for value in near_mm)
        if not all(math.isfinite(value) and abs(value) < _FARTHEST_MM for value in (x, y, z)):
            raise ConfigError(f"cannot point at {near_mm}", device=self.name, command="POINT")
        self._ask("POINT", {"x": x, "y": y, "z": z, "find": 1}, "point_s", self.deadlines.point_s)

    def stop(self) -> None:
        """Abort what is under way and disarm; from any thread, at any time. Raises LinkError."""
        self._armed = False
        self._stopping.set()
        if self._lock.acquire(blocking=False):
            try:
                self._client.ask("ABORT", {}, "reply_s", self.deadlines.reply_s)
            finally:
                self._lock.release()
        else:
            self._client.shout("ABORT")  # the pending question then ends with an error

    def status(self) -> InstrumentStatus:
        """State and weather. Raises LinkError, SafetyStop."""
        reply = self._ask("STATUS", {})
        with self._understood():
            state = reply.fields.get("state", "")
            if state not in _STATES:
                raise ProtocolError(f"unknown state {state!r}", raw=reply.raw)
            weather = {
                key: mbp.number(reply, key) if key in reply.fields else None for key in ("T", "P", "H")
            }
            return InstrumentStatus(state, weather["T"], weather["P"], weather["H"], reply.raw)

    # -- understanding ------------------------------------------------------------------------------------

    def _ask(
        self, command: str, fields: dict[str, object], deadline: str = "reply_s", seconds: float | None = None
    ) -> mbp.Message:
        with self._lock:
            try:
                return self._client.ask(
                    command, fields, deadline, self.deadlines.reply_s if seconds is None else seconds
                )
            except NotReady as error:
                if self._stopping.is_set():
                    raise MotionStopped(
                        "stopped", device=self.name, command=command, raw=error.raw
                    ) from error
                raise
            except LinkError:
                self._armed = False
                raise

    def _understood(self) -> _ClosesOnProtocolError:
        return _ClosesOnProtocolError(self)

    def close_damaged(self, error: ProtocolError) -> None:
        """An answer arrived whole and says the impossible: nothing more is believed on this connection."""
        error.device = self.name
        self._armed = False
        self._client.link.close()

    def _reading(self, reply: mbp.Message, target: str, samples: int) -> PointReading:
        def value(key: str, low: float = -_FARTHEST_MM, high: float = _FARTHEST_MM) -> float:
            return mbp.number(reply, key, low, high)

        x, y, z = value("x"), value("y"), value("z")
        std = (value("sx", 0.0), value("sy", 0.0), value("sz", 0.0))
        t_s = value("t", -1e12, 1e12)
        age_s = value("age", 0.0, 1e12)
        echo = reply.fields.get("target", target)
        if echo != target:
            raise ProtocolError(f"reading of {echo}, asked for {target}", raw=reply.raw)
        if math.hypot(x, y, z) < 1.0:
            raise ProtocolError("point at the origin of the tracker", raw=reply.raw)
        if "r" in reply.fields and abs(value("r", 0.0) - math.hypot(x, y, z)) > _POLAR_AGREES_MM:
            raise ProtocolError("polar and Cartesian coordinates disagree", raw=reply.raw)
        self._void_if_lost(reply, t_s - samples / self._rate_hz)
        for bad, why in (
            (value("n", 0, 1e9) != samples, f"not {samples} samples"),
            (value("status", 0, 9) != 0, "marked inaccurate"),
            (age_s > self._age_limit_s, f"{age_s:g} s old"),
            (t_s <= self._last_t_s, "device clock did not advance"),
            (max(std) > self._scatter_limit_mm, f"scatters by {max(std):g} mm"),
        ):
            if bad:
                raise NoisyMeasurement(f"reading {why}", device=self.name, command="MEASURE", raw=reply.raw)
        self._last_t_s = t_s
        return PointReading(
            target=target,
            xyz_mm=(x, y, z),
            std_mm=std,
            samples=samples,
            t_s=t_s,
            age_s=age_s,
            t_air_c=value("temp", -40.0, 80.0) if "temp" in reply.fields else None,
            pressure_hpa=value("P", 300.0, 1300.0) if "P" in reply.fields else None,
            humidity_percent=value("H", 0.0, 100.0) if "H" in reply.fields else None,
            mode=reply.fields.get("mode", ""),
            face=reply.fields.get("face", ""),
            raw=reply.raw,
        )

    def _void_if_lost(self, reply: mbp.Message, since_s: float) -> None:
        for event in self._client.events:
            kind = {"BEAM_BROKEN": BeamBroken, "TARGET_LOST": TargetNotSeen}.get(event.event)
            if kind and mbp.number(event, "t") >= since_s:
                raise kind(
                    f"{event.event} during the reading", device=self.name, command="MEASURE", raw=reply.raw
                )


class _ClosesOnProtocolError:
    """Context in which a whole answer is understood; an impossible content closes the link."""

    def __init__(self, tracker: FaroTracker) -> None:
        self._tracker = tracker

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, ProtocolError):
            self._tracker.close_damaged(error)

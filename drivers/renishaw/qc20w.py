"""Renishaw QC20-W ballbar behind an MBP/1 bridge, over TCP (5703) or a serial line.

The serial line can be any pyserial URL. The bar's Bluetooth payload is not public; the bridge reads it with the maker's
software. The sensor shows the deviation d from the bar's calibrated length L0 (at 20 degC) within a stroke of
+-1.0 mm:

    length = L0 (1 + alpha (T - 20 degC)) + scale (d - zero)

CAL gives L0, scale and, if the certificate has it, alpha. The zero of the sensor drifts. It is read in the calibrator
by `zero()`, is kept in every reading and never changed silently. After a break of its radio link, at any time, CAL is
asked again: the bridge may have paired with another bar, which has its own L0.

A reading is refused if it is out of stroke, stale (`drivers.bridge.session` on clocks that step), scattered, or calmer
than a sensor can be (metres). It is also refused if the radio link broke within its time. Units mm, s, degC.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Unpack

from drivers.bridge import mbp
from drivers.bridge.session import MbpSession, SessionArguments
from drivers.deadlines import InstrumentDeadlines
from drivers.errors import (
    AcquisitionError,
    ConfigError,
    NoisyMeasurement,
    NotReady,
    OutOfRange,
    ProtocolError,
    Refused,
)
from drivers.interfaces import Identity, InstrumentStatus, LengthReading

STROKE_MM = 1.0
_LONGEST_MM = 5000.0
_MANY = 10  # values, of which the scatter says something
RESOLUTION_MM = 1e-4  # of the sensor, by its data sheet
REFERENCE_C = 20.0
ZERO_LIMIT_MM = 0.2
_MOUNT = "Mount the ballbar with the right extension bar and both balls seated, then repeat the measurement."
_VOID: Mapping[str, type[AcquisitionError]] = {
    "OVERRANGE": OutOfRange,
    "LINK_DOWN": NoisyMeasurement,  # samples are missing from the average
}


@dataclass(frozen=True, slots=True)
class BarCalibration:
    """The certificate of a bar.

    Length (mm, at 20 degC), scale, standard uncertainty (mm), alpha (1/K).
    """

    length_mm: float
    scale: float
    u_mm: float
    expansion_per_k: float
    date: str
    certificate: str
    serial: str


class Qc20w:
    """The driver of a ballbar.

    `nominal_mm` is its length with the extension bars that the cell file specifies.
    """

    unverified_on_hardware = True

    def __init__(
        self,
        url: str,
        *,
        nominal_mm: float,
        name: str = "qc20w",
        rate_hz: float = 100.0,
        age_limit_s: float = 1.0,
        scatter_limit_mm: float = 0.002,
        deadlines: InstrumentDeadlines | None = None,
        **talk: Unpack[SessionArguments],
    ) -> None:
        if not 0.0 < nominal_mm < _LONGEST_MM or not rate_hz > 0.0:
            raise ConfigError(
                f"nominal_mm {nominal_mm} and rate_hz {rate_hz} must be positive",
                device=name,
                what_to_do="Correct them in the cell file.",
            )
        self.name = name
        self.zero_mm = 0.0
        self.calibration: BarCalibration | None = None
        self._serial = ""  # of the bar that was armed first
        self._radio_broke = False  # since CAL was read
        self._nominal_mm = nominal_mm
        self._rate_hz = rate_hz
        self._age_limit_s = age_limit_s
        self._scatter_limit_mm = scatter_limit_mm
        self.deadlines = deadlines or InstrumentDeadlines()
        self.session = MbpSession(url, name, "BALLBAR", lambda: self.deadlines, serial=True, **talk)

    def connect(self) -> None:
        """Open and greet.

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
        """Return the identity from the bridge's greeting, with the serial number of the bar.

        The certificate of the bar has the serial number, if any: a bridge may serve several bars.

        Raises
        ------
        LinkError
            The connection failed.
        """
        who = self.session.identify()
        try:
            reply = self.session.ask("CAL", {})
        except Refused:  # its bar is off
            return who
        return replace(who, serial=reply.fields.get("serial") or who.serial)

    def arm(self) -> None:
        """Check the state and read the calibration.

        Raises
        ------
        LinkError
            The connection failed.
        NotReady
            The bridge is not ready, or has another bar.
        SafetyStop
            The bridge is in an emergency stop.
        """
        with self.session.arming():
            self.calibration, reply = self._certificate()
            self._serial = self._serial or self.calibration.serial
            if self.calibration.serial != self._serial:
                raise self._another(reply)
            self._radio_broke = False
            self.session.client.events.clear()
            if abs(self.calibration.length_mm - self._nominal_mm) > STROKE_MM:
                raise NotReady(
                    f"the bar is calibrated to {self.calibration.length_mm:g} mm, "
                    f"{self._nominal_mm:g} mm are needed now",
                    command="CAL",
                    raw=reply.raw,
                    what_to_do=_MOUNT,
                )

    def _certificate(self) -> tuple[BarCalibration, mbp.Message]:
        reply = self.session.ask("CAL", {"nominal": self._nominal_mm})
        with self.session.understood():
            return _calibration(reply), reply

    def _another(self, reply: mbp.Message) -> NotReady:
        self.session.armed = False
        now = _calibration(reply)
        return NotReady(
            f"bar {now.serial or '?'} of {now.length_mm:g} mm answers, until now it was {self._serial or '?'}",
            command="CAL",
            raw=reply.raw,
            what_to_do="Connect the bar used before, or begin a new record for this one.",
        )

    def _hear_of_the_radio(self) -> None:
        heard = self.session.client.events
        self._radio_broke = self._radio_broke or any(each.event in ("LINK_DOWN", "LINK_UP") for each in heard)

    def _refuse_another_bar(self) -> None:
        """Read CAL again if the radio link of the bar broke since it was read.

        Raises
        ------
        NotReady
            The bridge has another bar.
        """
        if self._radio_broke:
            now, reply = self._certificate()
            if now != self.calibration:
                raise self._another(reply)
            self._radio_broke = False

    def disarm(self) -> None:
        """Allow no more measurements until armed again; never raises."""
        self.session.armed = False

    def measure(self, target: str, *, base_target: str, samples: int = 100) -> LengthReading:
        """Measure the length between ball `target` on the tool and ball `base_target`.

        It is averaged over `samples` values.

        Raises
        ------
        NotArmed, NotReady, SafetyStop
            The bar cannot measure now.
        LinkError
            The connection failed.
        OutOfRange
            The length is out of the stroke.
        NoisyMeasurement
            The reading cannot be used.
        MotionStopped
            `stop` was called.
        """
        for ball in (target, base_target):
            if not (ball.isidentifier() and ball.isascii()):
                raise ConfigError(
                    f"ball name {ball!r} is not a word",
                    device=self.name,
                    command="measure",
                    what_to_do="Use letters, digits and underscores.",
                )
        if samples < 1:
            raise ConfigError(
                f"samples = {samples} must be at least 1",
                device=self.name,
                command="measure",
                what_to_do="Set samples to 1 or more.",
            )
        seconds = samples / self._rate_hz + self.deadlines.measure_margin_s
        fields = {
            "n": samples,
            "rate": self._rate_hz,
            "timeout": seconds,
            "base": base_target,
            "target": target,
        }
        self._hear_of_the_radio()  # before they are cleared
        with self.session.measuring("READ"):
            try:
                reply = self.session.ask("READ", fields, "measure_s", seconds)
                with self.session.understood():
                    reading = self._reading(reply, target, base_target, samples)
            except OutOfRange as error:
                error.what_to_do = _MOUNT
                raise
            finally:
                self._hear_of_the_radio()
            self._refuse_another_bar()
            return reading

    def zero(self) -> float:
        """Read the sensor in its calibrator; the result is `zero_mm` of later readings.

        Raises
        ------
        NotArmed, NotReady
            The bar cannot measure now.
        LinkError
            The connection failed.
        OutOfRange
            The bar is not in its calibrator, or badly seated.
        """
        self._hear_of_the_radio()
        with self.session.measuring("ZERO"):
            reply = self.session.ask("ZERO", {}, "point_s", self.deadlines.point_s)
            self._hear_of_the_radio()
            with self.session.understood():
                zero = mbp.number(reply, "offset", -STROKE_MM, STROKE_MM)
            if abs(zero) > ZERO_LIMIT_MM:
                raise OutOfRange(
                    f"a zero of {zero:+.3f} mm; a bar well seated in its calibrator shows {ZERO_LIMIT_MM:g} mm at most",
                    raw=reply.raw,
                    what_to_do="Seat both balls of the bar in the calibrator of its length, then repeat.",
                )
            self.zero_mm = zero
            return self.zero_mm

    def build(self, nominal_mm: float) -> None:
        """Note that a person has built the bar to another length.

        Its zero is unknown; arming compares the length with CAL.

        Raises
        ------
        ConfigError
            No bar has this length.
        """
        if not 0.0 < nominal_mm < _LONGEST_MM:
            raise ConfigError(
                f"a ballbar of {nominal_mm:g} mm is not possible",
                device=self.name,
                command="build",
                what_to_do="Give the length of the bar in mm.",
            )
        self._nominal_mm, self.zero_mm = nominal_mm, 0.0
        self.session.armed = False

    def stop(self) -> None:
        """Abort the measurement in progress and disarm; from any thread.

        Raises
        ------
        LinkError
            The connection failed.
        """
        self.session.stop()

    def status(self) -> InstrumentStatus:
        """Return the state of the bar.

        Raises
        ------
        LinkError
            The connection failed.
        SafetyStop
            The bridge reports one.
        """
        return self.session.status()

    def _reading(self, reply: mbp.Message, target: str, base_target: str, samples: int) -> LengthReading:
        def value(key: str, low: float, high: float) -> float:
            return mbp.number(reply, key, low, high)

        for key, asked in (("target", target), ("base", base_target)):
            if reply.fields.get(key, asked) != asked:
                raise ProtocolError(f"length of {reply.fields[key]}, requested was {asked}", raw=reply.raw)
        d, sd = value("d", -100.0, 100.0), value("sd", 0.0, 100.0)
        t_s, age_s, temp = value("t", -1e12, 1e12), value("age", -1e12, 1e12), value("temp", -40.0, 80.0)
        advanced = self.session.advanced(t_s)
        self.session.void_if_reported(_VOID, t_s - samples / self._rate_hz, reply.raw)
        if value("over", -1, 1) != 0 or abs(d) > STROKE_MM:
            raise OutOfRange(
                f"deviation of {d:+.4f} mm, the stroke is +-{STROKE_MM:g} mm",
                raw=reply.raw,
                what_to_do=_MOUNT,
            )
        for bad, why in (
            (value("n", 0, 1e9) != samples, f"not of {samples} values"),
            (not 0.0 <= age_s <= self._age_limit_s, f"{age_s:g} s old"),
            (not advanced, "from a device clock that did not advance"),
            (sd > self._scatter_limit_mm, f"scattered by {sd:g} mm"),
        ):
            if bad:
                raise NoisyMeasurement(f"length {why}", raw=reply.raw)
        # If one of n values differs by one step, their scatter is a step divided by the root of n.
        if samples >= _MANY and 0.0 < sd < 0.5 * RESOLUTION_MM / math.sqrt(samples):
            raise NotReady(
                f"its values scatter by {sd:.2g} mm, less than the sensor can show",
                raw=reply.raw,
                what_to_do="Have the bridge give d and sd in mm, not in m, and compare d with the maker's own program.",
            )
        bar = self.calibration
        assert bar is not None  # armed
        warm = 1.0 + bar.expansion_per_k * (temp - REFERENCE_C)
        return LengthReading(
            target=target,
            base_target=base_target,
            length_mm=bar.length_mm * warm + bar.scale * (d - self.zero_mm),
            std_mm=sd,
            deviation_mm=d,
            zero_mm=self.zero_mm,
            samples=samples,
            t_s=t_s,
            age_s=age_s,
            t_air_c=temp,
            battery_percent=value("batt", 0.0, 100.0) if "batt" in reply.fields else None,
            raw=reply.raw,
        )


def _calibration(reply: mbp.Message) -> BarCalibration:
    said = reply.fields.get
    return BarCalibration(
        mbp.number(reply, "L0", 1.0, 5000.0),
        mbp.number(reply, "scale", 0.9, 1.1),
        mbp.number(reply, "u", 0.0, 1.0),
        1e-6 * mbp.number(reply, "alpha", -5.0, 50.0) if "alpha" in reply.fields else 0.0,
        said("date", ""),
        said("cert", ""),
        said("serial", ""),
    )

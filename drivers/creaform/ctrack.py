"""Creaform C-Track behind an MBP/1 bridge (TCP 5702), which runs next to VXelements.

Its own interface is not public. A pose is the position and orientation of a rigid body of reflective targets, in the
frame of the reference body on the robot's base, so that the cameras may move. A reading is refused unless it is exactly
the requested one:

- body and reference by name, and the number of frames
- enough targets visible on both: `min_visible_base` (12) on the base, `min_visible` (4) on any other body; the bodies
  of Nubiola's thesis have 9 or 20
- a unit quaternion, little scatter
- recent, with a device clock that advances (for steps of the clock see `drivers.bridge.session`)

Millimetres, quaternion scalar first.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Unpack

from drivers.bridge import mbp
from drivers.bridge.session import MbpSession, SessionArguments
from drivers.deadlines import InstrumentDeadlines
from drivers.errors import (
    AcquisitionError,
    ConfigError,
    LinkLost,
    NoisyMeasurement,
    NotReady,
    ProtocolError,
    TargetNotSeen,
)
from drivers.interfaces import Identity, InstrumentStatus, PoseReading

REFERENCE, LEAST_ON_REFERENCE = "base", 12  # the body on the robot's foot, and the targets that it needs
LEAST_ON_BODY = 4
_FARTHEST_MM = 20_000.0  # beyond the volume of any C-Track
_VOID: Mapping[str, type[AcquisitionError]] = {
    "TARGET_LOST": TargetNotSeen,
    "REFERENCE_LOST": TargetNotSeen,
    "LINK_DOWN": LinkLost,
}


class CTrack:
    """The driver of a C-Track. Methods block; `stop` may be called from any thread."""

    unverified_on_hardware = True

    def __init__(
        self,
        url: str,
        *,
        name: str = "ctrack",
        reference: str = REFERENCE,
        rate_hz: float = 29.0,
        min_visible: float = LEAST_ON_BODY,
        min_visible_base: float = LEAST_ON_REFERENCE,
        age_limit_s: float = 1.0,
        scatter_limit_mm: float = 0.25,
        scatter_limit_mrad: float = 1.0,
        deadlines: InstrumentDeadlines | None = None,
        **talk: Unpack[SessionArguments],
    ) -> None:
        if not rate_hz > 0:
            raise ConfigError(
                f"rate_hz {rate_hz} must be positive", device=name, what_to_do="Set a rate above 0 Hz."
            )
        if any(least < LEAST_ON_BODY or least % 1 for least in (min_visible, min_visible_base)):
            raise ConfigError(
                f"min_visible {min_visible:g} and min_visible_base {min_visible_base:g} must be whole numbers from "
                f"{LEAST_ON_BODY} on, which a pose needs",
                device=name,
                what_to_do="Correct them in the cell file.",
            )
        _word(reference, name)
        self.name = name
        self._reference = reference
        self._rate_hz = rate_hz
        self._least = (int(min_visible), int(min_visible_base))
        self._age_limit_s = age_limit_s
        self._scatter_limits = (scatter_limit_mm, scatter_limit_mrad)
        self.deadlines = deadlines or InstrumentDeadlines()
        self.session = MbpSession(url, name, "OCMM", lambda: self.deadlines, **talk)
        self._bodies: dict[str, int] = {}

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
        """Return the identity from the bridge's greeting.

        Raises
        ------
        LinkError
            The device is not connected.
        """
        return self.session.identify()

    def arm(self) -> None:
        """Check the state and the bodies known to the bridge, and choose the reference.

        Raises
        ------
        LinkError
            The connection failed.
        NotReady
            The instrument is not ready, or the reference has too few targets.
        SafetyStop
            The instrument is in an emergency stop.
        """
        with self.session.arming():
            reply = self.session.ask("MODELS", {})
            with self.session.understood():
                self._bodies = _bodies(reply)
            known = self._bodies.get(self._reference, 0)
            if known < self._least[1]:
                raise NotReady(
                    f"reference {self._reference!r} has {known} targets, needed {self._least[1]}",
                    raw=reply.raw,
                    what_to_do="Stick more reflective targets on the base and teach the reference body again.",
                )
            self.session.ask("DYNREF", {"on": 1, "model": self._reference})

    def disarm(self) -> None:
        """Allow no more measurements until armed again; never raises."""
        self.session.armed = False

    @property
    def least_on_reference(self) -> int:
        """Number of targets of the reference that must be visible."""
        return self._least[1]

    @property
    def bodies(self) -> Mapping[str, int]:
        """Number of reflective targets of every body known to the bridge, read when armed."""
        return dict(self._bodies)

    def measure(
        self, target: str, *, samples: int = 100, near_mm: Sequence[float] | None = None
    ) -> PoseReading:
        """Measure the pose of body `target` in the reference's frame, the mean of `samples` frames.

        `near_mm` is not used: cameras need no pointing.

        Raises
        ------
        NotArmed, NotReady, SafetyStop
            The instrument cannot measure now.
        LinkError
            The connection failed.
        Unmeasurable
            The reading cannot be used.
        MotionStopped
            `stop` was called.
        ConfigError
            There is no such body.
        """
        _word(target, self.name)
        if samples < 1:
            raise ConfigError(
                f"samples = {samples} must be at least 1",
                device=self.name,
                command="measure",
                what_to_do="Set samples to 1 or more.",
            )
        with self.session.measuring("MEASURE"):
            if target not in self._bodies:
                raise ConfigError(f"no body {target!r}; the bridge has {', '.join(self._bodies)}")
            seconds = samples / self._rate_hz + self.deadlines.measure_margin_s
            fields = {
                "model": target,
                "ref": self._reference,
                "frames": samples,
                "timeout": seconds,
                "minvis": self._least[0],
            }
            reply = self.session.ask("MEASURE", fields, "measure_s", seconds)
            with self.session.understood():
                return self._reading(reply, target, samples)

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
        return self.session.status()

    def _reading(self, reply: mbp.Message, target: str, samples: int) -> PoseReading:
        def value(key: str, low: float = -_FARTHEST_MM, high: float = _FARTHEST_MM) -> float:
            return mbp.number(reply, key, low, high)

        for key, wanted in (("model", target), ("ref", self._reference)):
            if reply.fields.get(key) != wanted:
                raise ProtocolError(
                    f"pose with {key}={reply.fields.get(key)}, requested was {wanted}", raw=reply.raw
                )
        x, y, z = value("x"), value("y"), value("z")
        q = tuple(value(f"q{i}", -1.000001, 1.000001) for i in range(4))
        size = math.sqrt(sum(each * each for each in q))
        if abs(size - 1.0) > 1e-6:
            raise ProtocolError(f"quaternion of length {size:.7f}", raw=reply.raw)
        if (x, y, z) == (0.0, 0.0, 0.0):
            raise ProtocolError("pose at the origin of the reference", raw=reply.raw)
        sign = math.copysign(1.0 / size, q[0])
        std = (value("sx", 0.0), value("sy", 0.0), value("sz", 0.0))
        turn_mrad = value("srot", 0.0)
        fit_mm = value("rms", 0.0) if "rms" in reply.fields else 0.0
        t_s, age_s = value("t", -1e12, 1e12), value("age", -1e12, 1e12)
        seen = int(value("visible", 0, self._bodies[target]))
        seen_base = int(value("rvisible", 0, self._bodies[self._reference]))
        advanced = self.session.advanced(t_s)
        self.session.void_if_reported(_VOID, t_s - samples / self._rate_hz, reply.raw)
        if (seen, seen_base) != (max(seen, self._least[0]), max(seen_base, self._least[1])):
            raise TargetNotSeen(
                f"{seen} targets of {target} and {seen_base} of {self._reference} visible, "
                f"needed {self._least[0]} and {self._least[1]}",
                raw=reply.raw,
                what_to_do="Clear the view of the cameras on tool and base, then repeat the measurement.",
            )
        for bad, why in (
            (value("frames", 0, 1e9) != samples, f"not of {samples} frames"),
            (not 0.0 <= age_s <= self._age_limit_s, f"{age_s:g} s old"),
            (not advanced, "from a device clock that did not advance"),
            (max(std) > self._scatter_limits[0], f"scattered by {max(std):g} mm"),
            (
                fit_mm > self._scatter_limits[0],
                f"whose targets miss the body as it was taught by {fit_mm:g} mm",
            ),
            (turn_mrad > self._scatter_limits[1], f"scattered by {turn_mrad:g} mrad"),
        ):
            if bad:
                raise NoisyMeasurement(f"pose {why}", raw=reply.raw)
        return PoseReading(
            target=target,
            xyz_mm=(x, y, z),
            std_mm=std,
            samples=samples,
            t_s=t_s,
            age_s=age_s,
            t_air_c=value("temp", -40.0, 80.0) if "temp" in reply.fields else None,
            raw=reply.raw,
            rot_wxyz=(sign * q[0], sign * q[1], sign * q[2], sign * q[3]),
            rot_std_mrad=turn_mrad,
            visible_tool=seen,
            visible_base=seen_base,
        )


def _word(text: str, device: str) -> None:
    if not (text.isidentifier() and text.isascii()):
        raise ConfigError(
            f"{text!r} is not a word", device=device, what_to_do="Use letters, digits and underscores."
        )


def _bodies(reply: mbp.Message) -> dict[str, int]:
    """Parse the bodies of a reply.

    The fields `names=base,T1 totals=16,9` give `{"base": 16, "T1": 9}`.

    Raises
    ------
    ProtocolError
        The list is damaged.
    """
    names = reply.fields.get("names", "").split(",")
    totals = reply.fields.get("totals", "").split(",")
    if len(names) != len(totals) or not all(each.isdecimal() for each in totals) or "" in names:
        raise ProtocolError("list of bodies damaged", raw=reply.raw)
    return {name: int(total) for name, total in zip(names, totals, strict=True)}

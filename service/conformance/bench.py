"""The bench of a driver, which its package declares: its simulator, and how the suite has to read the two."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable


class SimulatedRobot(Protocol):
    """A simulated controller, written from its manual and not from the driver. Angles in deg, joint by joint."""

    port: int

    def joints_deg(self) -> Sequence[float]:
        """Joint angles at which the arm truly is."""
        ...

    def targets_deg(self) -> Sequence[Sequence[float]]:
        """The target of every motion that it began, in order."""
        ...

    def moving(self) -> bool:
        """Whether the arm is under way."""
        ...

    def pace(self, deg_s: float) -> None:
        """Set the speed of every later motion, whatever the driver asks for."""
        ...

    def fall_short(self, share: float) -> None:
        """Let every later motion end at this share of its path while the controller reports it done; 1 is right."""
        ...

    def restart(self) -> None:
        """Switch off and on: nothing moves, and what a person has to confirm is confirmed."""
        ...


class SimulatedInstrument(Protocol):
    """A simulated instrument, written from its manual and not from the driver."""

    port: int

    def truth_mm(self, target: str, base_target: str | None) -> Sequence[float]:
        """A perfect reading: x, y, z of the target in the instrument's frame, or one length to `base_target`."""
        ...

    def restart(self) -> None:
        """Switch off and on."""
        ...


@runtime_checkable
class StepsClock(Protocol):
    """A simulated instrument whose readings carry its clock."""

    def step_clock(self, by_s: float) -> None:
        """The clock jumps by so many seconds, forth or back."""
        ...


@dataclass(frozen=True, kw_only=True)
class _Bench:
    """The common part of the benches of robots and of instruments.

    driver: its name as declared (entry point group `truepose.drivers`). url: the address for the driver; `{port}` is
    that of the proxy, `{device}` the simulator (`{device.other_port}`). end: the bytes that end an answer on the wire;
    empty where answers have no end mark, then what arrives at once is one. options: given to the driver besides.
    unseen: faults that this wire cannot show (no checksum), tried and told, not held against the driver.
    patient, hasty: values for the driver's attribute `deadlines`, the second so short that a lost answer costs little
    time; None where it has none. longest_s: how long one question may take with the hasty ones, s.
    """

    driver: str
    url: str = "tcp://127.0.0.1:{port}"
    end: bytes = b""
    options: Mapping[str, Any] = field(default_factory=dict)
    unseen: tuple[str, ...] = ()
    patient: object = None
    hasty: object = None
    longest_s: float = 30.0


@dataclass(frozen=True, kw_only=True)
class RobotBench(_Bench):
    """A driver of robots and its simulator.

    simulate: gives a running simulator, and ends it. joints: how many. tolerance_deg: by how much a joint read back may
    differ from the truth. moves_at_once: the controller moves on one request that nobody confirms and no sum guards; a
    damaged one may then send it elsewhere, which is told and not held against the driver.
    """

    simulate: Callable[[], AbstractContextManager[SimulatedRobot]]
    joints: int = 6
    tolerance_deg: float = 0.01
    moves_at_once: bool = False


@dataclass(frozen=True, kw_only=True)
class InstrumentBench(_Bench):
    """A driver of instruments and its simulator.

    simulate: gives a running simulator, and ends it. targets: at least three names that it can measure, further apart
    than `tolerance_mm`, by which a reading may differ from the truth. base_targets: of a ballbar, as many, in the same
    order. absent: a name that cannot be measured.
    """

    simulate: Callable[[], AbstractContextManager[SimulatedInstrument]]
    targets: tuple[str, ...]
    base_targets: tuple[str, ...] = ()
    tolerance_mm: float = 0.5
    absent: str = "NOT_THERE"

"""The bench of a driver: its simulator, and the settings of the suite for both.

The package of the driver declares it.
"""

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
        """Return the target of every motion of the robot, in order."""
        ...

    def moving(self) -> bool:
        """Return whether the arm is under way."""
        ...

    def pace(self, deg_s: float) -> None:
        """Set the speed of every later motion, for any speed that the driver requests."""
        ...

    def fall_short(self, share: float) -> None:
        """Let every later motion end at this share of its path.

        The controller still reports it done. A share of 1 is right.
        """
        ...

    def restart(self) -> None:
        """Switch off and on: nothing moves, and all confirmations by a person are given."""
        ...


class SimulatedInstrument(Protocol):
    """A simulated instrument, written from its manual and not from the driver."""

    port: int

    def truth_mm(self, target: str, base_target: str | None) -> Sequence[float]:
        """Return a perfect reading.

        It is x, y, z of the target in the instrument's frame, or one length to `base_target`.
        """
        ...

    def restart(self) -> None:
        """Switch off and on."""
        ...


@runtime_checkable
class StepsClock(Protocol):
    """A simulated instrument whose readings carry its clock."""

    def step_clock(self, by_s: float) -> None:
        """Step the clock by `by_s` seconds, forth or back."""
        ...


@dataclass(frozen=True, kw_only=True)
class _Bench:
    """The common part of robot and instrument benches.

    Attributes
    ----------
    driver : str
        Name of the driver as declared (entry point group `truepose.drivers`).
    url : str
        Address for the driver. `{port}` is the port of the proxy, `{device}` the simulator (`{device.other_port}`). A
        robot whose address begins with `udp:` has datagrams for messages.
    end : bytes
        Bytes that end an answer on the wire. It is empty if answers have no end mark; all bytes that arrive at once
        are then one answer.
    options : mapping
        Further options of the driver.
    unseen : tuple of str
        Faults that this wire cannot show (no checksum). They are tried and reported, but do not count against the
        driver.
    patient, hasty
        Values for the driver's attribute `deadlines`, the second so short that a lost answer costs little time;
        None if the driver has none.
    longest_s : float
        Longest time of one question with the hasty deadlines, s.
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

    Attributes
    ----------
    simulate : callable
        Gives a running simulator, and ends it.
    joints : int
        Number of joints.
    tolerance_deg : float
        Largest difference of a joint read back from the truth.
    moves_at_once : bool
        The controller moves on one request that has no confirmation and no checksum. A damaged request may then
        send it elsewhere, which is reported and does not count against the driver.
    """

    simulate: Callable[[], AbstractContextManager[SimulatedRobot]]
    joints: int = 6
    tolerance_deg: float = 0.01
    moves_at_once: bool = False


@dataclass(frozen=True, kw_only=True)
class InstrumentBench(_Bench):
    """A driver of instruments and its simulator.

    Attributes
    ----------
    simulate : callable
        Gives a running simulator, and ends it.
    targets : tuple of str
        At least three names that it can measure, further apart than `tolerance_mm`.
    base_targets : tuple of str
        For a ballbar, as many base targets, in the same order.
    tolerance_mm : float
        Largest difference of a reading from the truth.
    absent : str
        A name that cannot be measured.
    """

    simulate: Callable[[], AbstractContextManager[SimulatedInstrument]]
    targets: tuple[str, ...]
    base_targets: tuple[str, ...] = ()
    tolerance_mm: float = 0.5
    absent: str = "NOT_THERE"

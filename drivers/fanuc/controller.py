"""A Fanuc controller with any protocol: MAPPDK text, Modbus registers or RMI.

Angles are the controller's own (deg): its joint 3 is counted from the horizontal. The conversion to the angles of a
kinematic model is the joint matrix `fanuc-j23` of the robot file. It is made by users of a model, never here.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from drivers.errors import (
    AcquisitionError,
    EmergencyStop,
    EnableLost,
    JointLimit,
    MotionStopped,
    ProgramNotReady,
    ProtectiveStop,
    ProtocolError,
    WrongMode,
)
from drivers.interfaces import Identity, JointReading, RobotStatus

JOINTS = 6
WIDEST_DEG = 1000.0  # no joint turns further; beyond it the answer is damaged
LOOK_S = 0.2  # how often a pending move is looked at


@dataclass(frozen=True, slots=True)
class FanucDeadlines:
    """Named waits in seconds.

    A move may take `move_factor` x its predicted time + `move_margin_s`.

    Attributes
    ----------
    settle_s
        Time from the reported end of a move to two equal readings at the target, `gap_s` apart.
    still_s
        A robot that rests for this time during a move has been stopped.
    takeover_s
        Time in which the controller notices that the last RMI session has ended.
    abort_s
        For the answer to FRC_Abort of RMI. It was seen to take more than 5 s where nothing ran.
    """

    connect_s: float = 3.0
    send_s: float = 1.0
    reply_s: float = 2.0
    stop_s: float = 1.0
    settle_s: float = 3.0
    gap_s: float = 0.05
    still_s: float = 2.0
    takeover_s: float = 5.0
    abort_s: float = 15.0
    move_factor: float = 2.0
    move_margin_s: float = 10.0


@dataclass(frozen=True, slots=True)
class JointMove:
    """An absolute joint move.

    It has its target (deg), speed (% of the joints' maximum) and longest time (s). `stopped` is set by a stop from
    another thread, which may have overtaken the move.
    """

    target: tuple[float, ...]
    percent: int
    seconds: float
    stopped: threading.Event


class FanucController(Protocol):
    """A dialect of a Fanuc controller.

    Questions are safe from any thread; `move` blocks until the controller reports its end.
    """

    @property
    def deadlines(self) -> FanucDeadlines: ...
    @deadlines.setter
    def deadlines(self, deadlines: FanucDeadlines) -> None: ...
    @property
    def dialect(self) -> str: ...
    @property
    def can_stop(self) -> bool: ...
    @property
    def weakness(self) -> str: ...
    def open(self) -> None: ...
    def close(self) -> None: ...
    def identity(self) -> Identity: ...
    def prepare(self) -> None: ...
    def move(self, move: JointMove) -> None: ...
    def joints(self) -> JointReading: ...
    def halt(self) -> None: ...
    def status(self) -> RobotStatus: ...


# Facility code and number of alarms with a separate class (SRVO 11, MOTN 15).
ALARMS: dict[tuple[int, int], tuple[type[AcquisitionError], str]] = {
    (11, 1): (EmergencyStop, "SRVO-001, emergency stop of the operator panel"),
    (11, 2): (EmergencyStop, "SRVO-002, emergency stop of the teach pendant"),
    (11, 7): (EmergencyStop, "SRVO-007, external emergency stop"),
    (11, 3): (EnableLost, "SRVO-003, deadman switch released"),
    (11, 4): (EnableLost, "SRVO-004, fence open"),
    (15, 17): (JointLimit, "MOTN-017, outside the joint limits"),
    (15, 18): (JointLimit, "MOTN-018, position not reachable"),
}


def alarm(facility: int, number: int) -> tuple[type[AcquisitionError], str]:
    """Return the error class and the text for an alarm that ended a move."""
    return ALARMS.get((facility, number), (ProtectiveStop, f"alarm {facility}-{number:03d}"))


VERSION = 2  # of the robot-side programs

# Status that the robot-side programs give a move that did not end at its target.
STOPPED_BY_CLIENT, OUT_OF_RANGE, SILENCE, UNFIT, OTHER_TARGET = 1, 2, 3, 4, 5
_ENDS: dict[int, tuple[type[AcquisitionError], str]] = {
    STOPPED_BY_CLIENT: (MotionStopped, "stopped by a client"),
    OUT_OF_RANGE: (JointLimit, "outside the joint limits of the controller"),
    SILENCE: (ProtectiveStop, "stopped by the watchdog: no word from this program"),
    UNFIT: (ProgramNotReady, "controller not ready to move"),
    OTHER_TARGET: (
        ProtocolError,
        "the target that arrived there is not the one that was sent; nothing moved",
    ),
}


def other_version(program: str, version: int, device: str) -> ProtocolError:
    """Return the error for a robot program of another version than the driver needs."""
    return ProtocolError(
        f"{program} on the controller is program version {version}, needed {VERSION}",
        device=device,
        command="connect",
        what_to_do="Load the programs of this release (drivers/fanuc/robot_side) into the controller.",
    )


def ended(status: int) -> tuple[type[AcquisitionError], str]:
    """Return class and text for a move that ended away from its target."""
    return _ENDS.get(status, (ProtectiveStop, f"the robot's program ended the move with status {status}"))


def raise_if_unfit(status: RobotStatus, device: str, command: str) -> None:
    """Check that a status allows motion; unknown values (None) do.

    Raises
    ------
    EmergencyStop
        The emergency stop is pressed.
    WrongMode
        The pendant is enabled, or the servo power is off before a move.
    EnableLost
        The servo power went off during a move.
    AcquisitionError
        The class that belongs to the alarm of the controller.
    """
    where = {"device": device, "command": command}
    if status.emergency_stop:
        raise EmergencyStop("emergency stop pressed", **where, raw=status.raw)
    if status.mode == "manual":
        raise WrongMode(
            "teach pendant is enabled",
            **where,
            raw=status.raw,
            what_to_do="Switch the pendant off and the controller to automatic mode, then confirm.",
        )
    if status.motors_on is False:
        kind = EnableLost if command == "move_to" else WrongMode
        raise kind("servo power off, or pendant enabled", **where, raw=status.raw)
    facility, number = divmod(status.error_number or 0, 1000)
    if facility:
        error, text = alarm(facility, number)
        raise error(text, **where, raw=status.raw)


class MovePoller:
    """A callback for the waiting loop of a question that calls `look` at most every LOOK_S."""

    def __init__(self, look: Callable[[], None], clock: Callable[[], float]) -> None:
        self._look = look
        self._clock = clock
        self._next = clock() + LOOK_S

    def __call__(self) -> None:
        if self._clock() >= self._next:
            self._look()
            self._next = self._clock() + LOOK_S

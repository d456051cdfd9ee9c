"""CALSRV, our own program on an ABB controller: numbered questions, and a move in two steps.

The program is in `drivers/abb/robot_side`.

    201 <seq> j1..j6 #          201 1 <seq> j1..j6 #       the target as the controller understood it; nothing moves
    209 <seq> <sum> #           209 1 <seq> #              go, answered when the robot is there
    208 <seq> <ms> <v_tcp> <v_ori> #                       watchdog and speeds, shown back in the same form

The robot moves when the sum that comes with `go` is that of the request 201 as it arrived there. So a target that was
damaged on its way moves nothing: the driver notices it in the answer, the controller by the checksum.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Unpack

from drivers.abb.conversation import DECIMALS, AbbConversation, Numbered
from drivers.errors import (
    AcquisitionError,
    CommandRefused,
    EmergencyStop,
    EnableLost,
    JointLimit,
    LinkError,
    MotionStopped,
    ProtectiveStop,
    ProtocolError,
    WrongMode,
)
from drivers.interfaces import RobotStatus, apart_deg
from drivers.wait import Waiting

JOINTS = 6
SET, JOINTS_NOW, STATE, STOP, CONDITIONS, GO = 201, 202, 205, 207, 208, 209
_ECHO_DEG = 2e-5  # a RAPID num has single precision: 1.5e-5 at 180 deg
_JOINT = re.compile(rb"-?\d{1,3}(?:\.\d{1,%d})?" % DECIMALS)  # RAPID may leave zeros at the end out
_MODES = {1: "auto", 2: "reduced", 3: "manual"}
_REFUSALS: Mapping[int, tuple[type[AcquisitionError], str]] = {
    1: (CommandRefused, "bad parameters"),
    2: (JointLimit, "out of range"),
    3: (ProtectiveStop, "motion stopped by the controller"),
    4: (WrongMode, "in manual mode at full speed, or motors off"),
    5: (MotionStopped, "motion interrupted"),
    6: (ProtocolError, "the target that arrived there is not the one that was sent"),
    7: (
        CommandRefused,
        "the controller's configuration does not tell the joint limits (Motion, Arm, rob1_1)",
    ),
    9: (CommandRefused, "unknown code"),
}


def sum_of(request: bytes) -> int:
    """Compute Fletcher's checksum of a request, modulo 251 so that it fits a RAPID num.

    Any single wrong byte changes it.
    """
    low = high = 0
    for byte in request:
        low = (low + byte) % 251
        high = (high + low) % 251
    return 256 * high + low


class CalSrv:
    """Both connections to a controller that runs CALSRV.

    `main` moves the robot, `back` answers during a move.
    """

    def __init__(self, main: AbbConversation, back: AbbConversation, name: str) -> None:
        self._main = main
        self._back = back
        self._name = name

    def set_conditions(self, watchdog_ms: int, speed: Sequence[float]) -> None:
        """Set the watchdog (ms) and the speeds (mm/s, deg/s) of all later moves.

        Raises
        ------
        LinkError
            The connection failed, or the controller shows other values.
        """
        wanted = (watchdog_ms, *(round(value, 1) for value in speed))
        answer = self._ask(self._main, CONDITIONS, wanted)
        self._compare(CONDITIONS, self._numbers(CONDITIONS, answer), wanted, 1e-3, answer.raw)

    def show(self, target: Sequence[float]) -> int:
        """Send a target, compare it with the echo, and return the checksum that starts the move.

        Nothing moves.

        Raises
        ------
        LinkError
            The connection failed, or the controller shows another target.
        JointLimit, CommandRefused
            The controller refused the target.
        """
        answer = self._ask(self._main, SET, tuple(float(q) for q in target))
        self._compare(SET, self.joints_of(SET, answer), target, _ECHO_DEG, answer.raw)
        return sum_of(answer.request)

    def go(self, proof: int, seconds: float, meanwhile: Callable[[], None]) -> None:
        """Start the move to the target that was sent, and wait until the robot is there.

        Raises
        ------
        LinkError
            The connection failed.
        CommandRefused
            The controller refused to start, or the move ended early.
        """
        self._ask(self._main, GO, (proof,), deadline="move_s", seconds=seconds, meanwhile=meanwhile)

    def joints(self) -> tuple[tuple[float, ...], bytes]:
        """Return the joint angles (deg) as read back now, and the reply.

        Raises
        ------
        LinkError
            The connection failed.
        """
        answer = self._ask(self._main, JOINTS_NOW)
        return self.joints_of(JOINTS_NOW, answer), answer.raw

    def stop(self) -> None:
        """Halt the robot.

        Raises
        ------
        LinkError
            The stop was not answered, also not on a new connection.
        """
        with self._back.lock:
            stop_s = self._back.deadlines.stop_s
            try:
                self._ask(self._back, STOP, deadline="stop_s", seconds=stop_s)
            except LinkError:  # a stop is worth a second try on a fresh connection
                self._back.link.open(connect_s=stop_s)
                self._ask(self._back, STOP, deadline="stop_s", seconds=stop_s)

    def status(self) -> RobotStatus:
        """Return the state of the controller, from the background task.

        Raises
        ------
        LinkError
            The connection failed, or the state is out of range.
        """
        answer = self._ask(self._back, STATE, deadline="stop_s", seconds=self._back.deadlines.stop_s)
        fields, raw = answer.fields, answer.raw
        if len(fields) != 6 or not all(re.fullmatch(rb"\d{1,5}", field) for field in fields):
            raise self._damaged("not six whole numbers", STATE, raw)
        mode, run, motors, estop, moving, number = (int(field) for field in fields)
        if mode > 3 or run > 9 or max(motors, estop, moving) > 1:
            raise self._damaged("state out of range", STATE, raw)
        return RobotStatus(
            _MODES.get(mode, "unknown"), bool(motors), bool(estop), bool(moving), number or None, raw
        )

    def raise_if_unfit(self, status: RobotStatus, command: str) -> None:
        """Check that the status allows motion.

        Raises
        ------
        EmergencyStop
            The emergency stop is pressed.
        WrongMode
            The mode is not automatic, or the motors are off before a move.
        EnableLost
            The motors are off during a move.
        """
        if status.emergency_stop:
            raise EmergencyStop("emergency stop pressed", device=self._name, command=command, raw=status.raw)
        if status.mode not in ("auto", "reduced"):
            raise WrongMode(
                f"controller in mode {status.mode}", device=self._name, command=command, raw=status.raw
            )
        if not status.motors_on:
            kind = EnableLost if command == "move_to" else WrongMode
            error = kind("motors off", device=self._name, command=command, raw=status.raw)
            if status.mode == "reduced":
                error.what_to_do = (
                    "Hold the enabling device, so that the motors are on, and start the program there again."
                )
            raise error

    # -- answers ------------------------------------------------------------------------------------------

    def joints_of(self, code: int, answer: Numbered) -> tuple[float, ...]:
        """Return the six joint angles of an answer (deg).

        Raises
        ------
        ProtocolError
            The answer has another form.
        """
        if len(answer.fields) != JOINTS or not all(_JOINT.fullmatch(each) for each in answer.fields):
            raise self._damaged("not six joints of at most five decimals", code, answer.raw)
        return tuple(float(field) for field in answer.fields)

    def _numbers(self, code: int, answer: Numbered) -> tuple[float, ...]:
        if not all(re.fullmatch(rb"\d{1,7}(\.\d+)?", field) for field in answer.fields):
            raise self._damaged("not numbers", code, answer.raw)
        return tuple(float(field) for field in answer.fields)

    def _compare(
        self, code: int, shown: Sequence[float], wanted: Sequence[float], within: float, raw: bytes
    ) -> None:
        if len(shown) != len(wanted) or apart_deg(shown, wanted) > within:
            raise self._damaged("the controller understood another request; nothing moved", code, raw)

    def _damaged(self, message: str, code: int, raw: bytes) -> ProtocolError:
        self._main.link.close()
        self._back.link.close()
        return ProtocolError(message, device=self._name, command=str(code), raw=raw)

    def _ask(
        self, talk: AbbConversation, code: int, values: Sequence[float] = (), **waiting: Unpack[Waiting]
    ) -> Numbered:
        """Ask a numbered question and return the answer, or raise a refusal as its error class."""
        answer = talk.ask_numbered(code, values, **waiting)
        if answer.errno:
            raise self._refusal(answer, code)
        return answer

    def _refusal(self, answer: Numbered, code: int) -> AcquisitionError:
        if answer.errno == 3:  # T_ROB1 only knows that it was stopped; the background task may know why
            try:
                self.raise_if_unfit(self.status(), "move_to")
            except (EmergencyStop, EnableLost, WrongMode) as error:
                return error
        kind, text = _REFUSALS.get(answer.errno, (CommandRefused, f"error {answer.errno}"))
        if kind is ProtocolError:
            return self._damaged(text, code, answer.raw)
        return kind(text, device=self._name, command=str(code), raw=answer.raw)

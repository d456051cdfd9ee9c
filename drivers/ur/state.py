"""UR controller states from either stream, and the conditions for accepting one.

Neither RTDE nor the 30003 packet has a checksum, and both repeat a state every 8 ms. A state is therefore accepted when
the next one confirms it: same modes and registers, and no joint further away than its speed allows. The clock of the
controller has to advance from one to the next; a repeated, late or swapped package is a ProtocolError. So is a step of
that clock within one question; between two questions it is not checked.

The numbers of the modes come from Universal Robots, "Real-Time Data Exchange (RTDE) guide"; from 14 on, from
UniversalRobots/Universal_Robots_Client_Library, `ur/datatypes.h`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from drivers.errors import (
    AcquisitionError,
    EmergencyStop,
    EnableLost,
    ProtectiveStop,
    ProtocolError,
    SafetyStop,
    WrongMode,
)

JOINTS = 6
RUNNING = 7
STOPPED = 1
PLAYING = 2
PAUSED = 4
ROBOT_MODES = {
    -1: "no controller",
    0: "disconnected",
    1: "confirm safety",
    2: "booting",
    3: "power off",
    4: "power on",
    5: "idle",
    6: "free drive",
    7: "running",
    8: "updating firmware",
}
SAFETY_MODES: dict[int, tuple[type[SafetyStop] | None, str]] = {
    1: (None, "normal"),
    2: (None, "reduced"),
    3: (ProtectiveStop, "protective stop"),
    4: (ProtectiveStop, "recovery after a violated safety limit"),
    5: (EnableLost, "safeguard stop"),
    6: (EmergencyStop, "emergency stop of the system"),
    7: (EmergencyStop, "emergency stop pressed"),
    8: (ProtectiveStop, "safety limit violated"),
    9: (ProtectiveStop, "fault of the safety system"),
    10: (SafetyStop, "joint identity not validated"),
    11: (SafetyStop, "safety mode undefined"),
    12: (EnableLost, "safeguard stop of automatic mode"),
    13: (EnableLost, "enabling device released"),
    14: (EnableLost, "enabling device of the pendant released"),
    15: (EmergencyStop, "emergency stop of the injection moulding machine"),
    16: (EnableLost, "safeguard stop of the injection moulding machine"),
    17: (SafetyStop, "PROFIsafe waits for its parameters"),
    18: (EnableLost, "safeguard stop of automatic mode by PROFIsafe"),
    19: (EnableLost, "safeguard stop by PROFIsafe"),
    20: (EmergencyStop, "emergency stop by PROFIsafe"),
    22: (EnableLost, "safeguard stop by the safety interface"),
}
STILL_RAD_S = 2e-3  # largest joint speed of an arm at rest
AGREE_RAD = 1e-4  # scatter of the read-back between two packages of an arm at rest
_WIDEST_RAD = 4 * math.pi  # joints turn +-2 pi; beyond twice that the package is damaged
_FASTEST_RAD_S = 20.0
_MOST_STATES = 250

Vector = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class UrState:
    """Joint angles (rad), speeds (rad/s) and modes of a UR controller.

    `echo` is the number of the last program begun, None if it is not reported. `arguments` are those that this program
    reports (`drivers.ur.motion`). Temperatures of the joints (degC) and the share of the speed slider are known of the
    streams that have them.
    """

    t_s: float
    target_rad: Vector
    actual_rad: Vector
    target_rad_s: Vector
    actual_rad_s: Vector
    robot_mode: int
    safety_mode: int
    runtime_state: int
    echo: int | None
    arguments: Vector = ()
    raw: bytes = b""
    temperatures_c: Vector = ()
    speed_share: float | None = None

    @property
    def shown(self) -> bytes:
        """The beginning of `raw`, for an error; the wire log has all of it."""
        return self.raw[:64]

    @property
    def emergency_stop(self) -> bool:
        """Whether a safety mode that is an emergency stop is active."""
        kind, _ = SAFETY_MODES.get(self.safety_mode, (None, ""))
        return kind is EmergencyStop

    @property
    def at_rest(self) -> bool:
        """Whether the arm is neither commanded to move nor moving."""
        return max(map(abs, self.target_rad_s + self.actual_rad_s)) < STILL_RAD_S

    def off_rad(self, goal_rad: Sequence[float]) -> float:
        """Return the largest distance of a joint, as read back, from `goal_rad`."""
        return max(abs(a - b) for a, b in zip(self.actual_rad, goal_rad, strict=True))


def check_state(state: UrState) -> None:
    """Check that an arm can report this state.

    Raises
    ------
    ProtocolError
        A value is not finite, out of range, or an unknown mode.
    """
    angles, speeds = state.target_rad + state.actual_rad, state.target_rad_s + state.actual_rad_s
    good = (
        math.isfinite(state.t_s)
        and all(abs(q) < _WIDEST_RAD for q in angles)  # a NaN fails as well
        and all(abs(v) < _FASTEST_RAD_S for v in speeds)
        and state.robot_mode in ROBOT_MODES
        and 1 <= state.safety_mode <= 30
        and 0 <= state.runtime_state <= 5
    )
    if not good:
        raise ProtocolError("joint angle, speed or mode out of range", raw=state.shown)


def agree(before: UrState, now: UrState) -> bool:
    """Check whether `now` can follow `before`.

    Raises
    ------
    ProtocolError
        `now` is not newer.
    """
    modes = ("robot_mode", "safety_mode", "runtime_state", "echo", "arguments")
    carried = carries(before, now)
    return carried and all(getattr(before, mode) == getattr(now, mode) for mode in modes)


def carries(before: UrState, now: UrState) -> bool:
    """Check whether the speeds of the joints lead from `before` to `now`.

    Raises
    ------
    ProtocolError
        `now` is not newer.
    """
    dt = now.t_s - before.t_s
    if dt <= 0:
        raise ProtocolError("controller clock does not grow: an old or repeated package", raw=now.shown)
    return all(
        abs(b - a) <= AGREE_RAD + dt * max(abs(v), abs(w))
        for a, b, v, w in zip(
            before.target_rad + before.actual_rad,
            now.target_rad + now.actual_rad,
            before.target_rad_s + before.actual_rad_s,
            now.target_rad_s + now.actual_rad_s,
            strict=True,
        )
    )


class StateConfirmer:
    """A reader of states that accepts one if the next confirms it."""

    def __init__(self, read: Callable[[], UrState]) -> None:
        self._read = read
        self._last: UrState | None = None

    def state(self) -> UrState:
        """Return the next confirmed state.

        Raises
        ------
        LinkError
            The connection failed, or no two packages in a row agree.
        """
        before = self._last or self._read()
        for _ in range(_MOST_STATES):
            now = self._last = self._read()
            if agree(before, now):
                return now
            before = now
        raise ProtocolError("no two packages in a row agree", raw=before.shown)

    def every(self) -> Iterator[tuple[UrState, bool]]:
        """Yield every state, and whether the joint speeds lead to it from the one before."""
        before = self._read()
        while True:
            now = self._read()
            yield now, carries(before, now)
            before = now


def unfit(state: UrState, *, moving: bool) -> AcquisitionError | None:
    """Return the reason why this controller cannot move, or None.

    With `moving`, it could move a moment ago.
    """
    kind, text = SAFETY_MODES.get(state.safety_mode, (SafetyStop, f"safety mode {state.safety_mode}"))
    if kind is not None:
        return kind(text, raw=state.shown)
    if state.robot_mode == RUNNING:
        return None
    text = f"robot mode is '{ROBOT_MODES[state.robot_mode]}', needed 'running'"
    if moving:
        return EnableLost(text, raw=state.shown)
    return WrongMode(
        text,
        raw=state.shown,
        what_to_do="Power the arm on and release its brakes on the pendant, then confirm.",
    )

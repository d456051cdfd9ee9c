"""Joint offsets as instructions for the screens of each maker, with their frames.

An offset is what must be added to the angle that the controller counts:

    real angle = shown angle + offset

A controller is corrected by declaring, without moving the arm, that the shown angle is greater by the offset. No
maker's own number is computed here, because each has other units and its own sign. ABB counts motor radians (joint
angle times a signed gear ratio), Fanuc and Yaskawa encoder counts, KUKA an angle at the mastering notch. Instead the
axis goes to where the real one is at zero, which is where it shows minus the offset. The controller itself declares
this place to be its zero. Only a UR takes an angle: its `delta_theta` is added to the joint angle.

The offset of joint 1 is the turn of the work frame about z, so joint 1 keeps its zero. The turn of the tool about the
last axis is that of the last joint. Each file has two checks that show a wrong sign. One is the display before the arm
has moved, the other the place of the tool afterwards at the same shown angles. A wrong sign doubles the error.

Sources, none of them tried on a controller:

- Fanuc: position = (encoder count - master count) . scale, menu MASTER/CAL (industrialmonitordirect.com, "Reset FANUC
  extended axis master count without continuous turn").
- KUKA: `$MAMES` and dial mastering (the same site, "KR6-2 mastering A2 axis" and "Robot mastering without dial
  indicator").
- ABB: calibration offset and fine calibration (the same site, "IRB 6400 axis 3 encoder drift after fine calibration").
- Yaskawa: home position and ABSO data (the same site, "DX100 home position mastering pulse recovery guide").
- UR: github.com/weijieyong/UR_kinematics_calib. With `delta_theta` added, its joint angles lead to the poses that the
  controller showed within 0.08 mm; with it subtracted they miss by 190 mm.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.arm import Robot
from calib.array import Array
from calib.compensate import poses_with
from calib.units import DEG
from service.exports.frames import DIALECTS, FrameDialect, frame_notes, frame_slots, plain
from service.exports.request import ExportRequest, Format, for_maker

_CANDIDATES = 200  # poses among which that of the check is chosen
_CENTRAL = (
    0.4  # share of the ranges, about their middle, in which they are: far from limits and from the own arm
)
_SHOWN = 1e-3 * DEG  # offsets below it are not entered
_LEVER = np.array([100.0, 0.0, 0.0])  # mm, off the axis of the flange, for a model without a tool
_OF_ALL = "All taught points, safety zones and limits count from the new zeros: check them afterwards."


@dataclass(frozen=True)
class Screens:
    """Instructions for a maker's screens.

    Attributes
    ----------
    joints : tuple of str
        Names of the axes on the pendant.
    keeps : str
        What the controller stores, and its sign.
    backup, steps : tuple of str
        What to note before, and what to do.
    undo : str
        How to return to the state before.
    at_zero : str
        Where an axis is brought to, before its offset is subtracted; empty if the axes are not moved.
    """

    joints: tuple[str, ...]
    keeps: str
    backup: tuple[str, ...]
    steps: tuple[str, ...]
    undo: str
    at_zero: str = "0"


_SCREENS: Mapping[str, Screens] = {
    "ABB": Screens(
        tuple(f"axis {k}" for k in range(1, 7)),
        "ABB keeps one calibration offset for each motor, in radians of the motor (moc.cfg, MOTOR_CALIB, "
        "cal_offset): a joint angle times the gear ratio, whose sign differs from axis to axis. Do not compute it: "
        "the controller does.",
        ("Save a backup, and note the calibration offsets: Calibration > ROB_1 > Calib. Parameters.",),
        (
            "Axis by axis, from 1 upwards: jog this axis alone until the jogging window shows the angle of the "
            "table.",
            "Calibration > ROB_1 > Calib. Parameters > Fine Calibration: select only this axis, confirm. The axis "
            "must now show 0. (If its calibration position is not 0, go to calibration position minus offset.)",
            "Update the revolution counters only if the controller asks for it.",
        ),
        "Calibration > ROB_1 > Calib. Parameters > Edit Motor Calibration Offset: enter the noted values, restart.",
    ),
    "Fanuc": Screens(
        tuple(f"J{k}" for k in range(1, 7)),
        "Fanuc keeps one master count for each axis ($DMR_GRP[1].$MASTER_COUN); position = (encoder count - master "
        "count) x scale. A positive offset therefore makes the master count smaller where the scale is positive. "
        "Zero position mastering computes it.",
        ("Save a backup, and note $DMR_GRP[1].$MASTER_COUN[1] to [6]: MENU > SYSTEM > Variables.",),
        (
            "Jog all axes to the shown angles of the table, those with offset 0 to 0: ZERO POSITION MASTER takes all "
            "axes at once. J3 counts from the horizontal, which the table allows for.",
            "Set $MASTER_ENB to 1. MENU > SYSTEM > Master/Cal > ZERO POSITION MASTER, YES. Then CALIBRATE, YES. All "
            "axes must now show 0. DONE.",
        ),
        "Type the noted $MASTER_COUN values back, set $DMR_GRP[1].$MASTER_DONE to TRUE, then Master/Cal > CALIBRATE.",
    ),
    "KUKA": Screens(
        tuple(f"A{k}" for k in range(1, 7)),
        "KUKA takes the place at which an axis is mastered to be $MAMES[k] degrees (R1/Mada/$machine.dat: often 0, "
        "-90, 90, 0, 0, 0, but not for every arm). The table counts from $MAMES.",
        ("Save an archive, and note $MAMES[1] to [6] and the axis positions.",),
        (
            "Axis by axis, from A1 upwards: jog this axis alone until the actual position shows $MAMES minus the "
            "offset.",
            "Without moving it: Start-up > Master > Unmaster for this axis, then Start-up > Master > Dial, Master. "
            "The axis must now show $MAMES.",
            "Any later mastering with the EMD undoes this. Write it on the robot.",
        ),
        "Master the axes again with the EMD.",
        "$MAMES",
    ),
    "Yaskawa": Screens(
        ("S", "L", "U", "R", "B", "T"),
        "Yaskawa keeps the encoder's absolute data at the home position (ABSO data, pulses). Pulses count up or "
        "down from axis to axis. Do not compute them: registering the home position does.",
        ("Save a backup, and note the ABSO data: ROBOT > HOME POSITION, management mode.",),
        (
            "Axis by axis: jog this axis alone until ROBOT > CURRENT POSITION shows the angle of the table (in "
            "pulses: angle x pulses per degree of this axis, with its sign).",
            "ROBOT > HOME POSITION: select this axis alone, CREATE HOME POSITION, YES. The axis must now show 0 "
            "pulses.",
            "Teach the second home position again.",
        ),
        "ROBOT > HOME POSITION > ABSOLUTE DATA: type the noted values back.",
    ),
    "UR": Screens(
        ("base", "shoulder", "elbow", "wrist 1", "wrist 2", "wrist 3"),
        "A UR adds delta_theta (rad, calibration.conf, [mounting]) to the joint angle in its kinematics. The shown "
        "joint angle stays as it is; the shown pose of the tool changes.",
        ("Copy /root/.urcontrol/calibration.conf off the robot. Its other lines must stay as they are.",),
        (
            "No public description of a screen that takes an offset was found: it is a line of the file. Arm off. In "
            "delta_theta, add the offset in rad to each number: new = old + offset. Power cycle the controller.",
            "The format ur-calibration holds lengths and twists as well, which leave less.",
        ),
        "Put the copy back, and power cycle.",
        "",
    ),
}


def _slots(robot: Robot) -> tuple[str, ...]:
    """Offsets of joints 2 to N, the base, and the tool without its turn about the last axis."""
    joints = tuple(f"theta{k}" for k in range(2, robot.joints + 1))
    return (*joints, *(slot for slot in frame_slots(robot) if slot != "tool.rz"))


def _model_offsets(export: ExportRequest, counted: Array) -> Array:
    """Convert offsets (N,) of the angles that the controller counts to those of the model, rad."""
    robot, both = export.robot, np.stack([counted, np.zeros_like(counted)])
    offset, rest = robot.model_angles(both, export.coupling)
    return offset - rest


def _counted_offsets(export: ExportRequest) -> Array:
    """Return the offsets (N,) of the angles that the controller counts, rad, as written."""
    robot = export.robot
    model = np.array([export.carried.values.get(f"theta{k}", 0.0) for k in range(1, robot.joints + 1)])
    turned, rest = robot.controller_angles(np.stack([model, np.zeros_like(model)]), export.coupling)
    return np.round((turned - rest) / DEG, 4) * DEG + 0.0


def _changes(offsets: Array) -> dict[str, float]:
    return {f"theta{k}": float(v) for k, v in enumerate(offsets, start=1) if v}


def _displacements(export: ExportRequest, joints: Array, point: Array, offsets: Array) -> Array:
    """Return the displacements of a point of the flange, (n, 3), mm.

    It moves because the offsets (N,) of the model are no longer there. `joints` (n, N) are model angles, which the
    controller shows before and after.
    """
    before, after = (poses_with(export.robot, joints, change) for change in (_changes(offsets), {}))
    return (after - before)[:, :3] @ np.append(point, 1.0)


def _check(export: ExportRequest, counted: Array) -> tuple[Array, str, Array, Array]:
    """Choose a pose in which every offset shows, among those in the middle of the range.

    Returns the shown angles (N,), deg, the name of the tool point, its displacement by all offsets (3,), and by each
    (N, 3), mm.
    """
    robot = export.robot
    places = {name: pose[:3, 3] for name, pose in export.mounting.tools.items()}
    name = max(places, key=lambda each: np.hypot(*places[each][:2]), default="")
    point = places[name] if name else _LEVER
    postures = export.carried.joints[:_CANDIDATES]
    central = postures.mean(axis=0) + _CENTRAL * (postures - postures.mean(axis=0))
    shown = np.round(robot.controller_angles(central, export.coupling) / DEG, 1)
    joints = robot.model_angles(shown * DEG, export.coupling)
    each = np.array([_model_offsets(export, one) for one in np.diag(counted)])
    moves = np.stack([_displacements(export, joints, point, one) for one in each])  # (N, n, 3)
    entered = np.abs(counted) >= _SHOWN
    least = np.linalg.norm(moves[entered], axis=2).min(axis=0) if entered.any() else np.zeros(len(joints))
    best = int(np.argmax(least))
    whole = _displacements(export, joints[best : best + 1], point, _model_offsets(export, counted))[0]
    called = plain(name) if name else "the point 100 mm off the flange's axis along its x"
    return shown[best], called, whole, moves[:, best]


def _writes(maker: FrameDialect, export: ExportRequest) -> str:
    screens, counted = _SCREENS[maker.called], _counted_offsets(export)
    pose, point, whole, each = _check(export, counted)
    moves = bool(screens.at_zero)
    lines = [f"JOINT OFFSETS, for controllers of {maker.called}", "", *map(plain, export.about), ""]
    lines += ["SIGN: real angle = shown angle + offset.", screens.keeps, "", "BEFORE"]
    lines += [f"- {line}" for line in (*screens.backup, _OF_ALL)]
    lines += ["", "OFFSETS"]
    for name, value in zip(screens.joints, counted / DEG, strict=True):
        whither = f"   go to {_minus(screens.at_zero, value)}" if moves else f"   = {value * DEG:+.7f} rad"
        kept = "   (keeps its zero)" if abs(value) * DEG < _SHOWN else ""
        lines.append(f"{name}: offset {value:+.4f} deg{whither}{kept}")
    lines += ["", "STEPS", *(f"{k}. {line}" for k, line in enumerate(screens.steps, start=1))]
    lines += ["", "CHECK 1, before the arm moves on"]
    lines.append(
        "At the same place of the arm, each axis must show more than before by its offset (less by a negative one)."
        if moves
        else "The joint angles must show what they showed before."
    )
    lines += ["", "CHECK 2, at low speed"]
    shown = ", ".join(f"{name} {angle:.1f}" for name, angle in zip(screens.joints, pose, strict=True))
    lines.append(
        f"Before and after, drive to these shown angles (deg), on a path that you have checked: {shown}."
    )
    sign = 1.0 if moves else -1.0
    lines.append(
        f"{point} must then be elsewhere than before by {_vector(whole)} mm (x, y, z of the controller's world)."
        if moves
        else f"The arm stands where it stood; the place shown for {point} must have changed by {_vector(-whole)} mm."
    )
    lines += [
        f"  of this by {name} alone: {_vector(sign * move)} mm"
        for name, move, value in zip(screens.joints, each, counted, strict=True)
        if abs(value) >= _SHOWN
    ]
    lines.append(
        "If it went the other way, a sign is wrong, and the robot is now twice as far off as before:"
    )
    lines += [screens.undo, "", "FRAMES that belong to these offsets, and to no others"]
    for kind, frames in zip(("tool", "frame"), maker.frames(export), strict=True):
        for frame in frames:
            cells = ", ".join(f"{k} {v}" for k, v in zip(maker.labels, frame.numbers, strict=True))
            lines.append(f"{kind} {plain(frame.name)}: {cells}")
    return "\n".join([*lines, ""])


def _minus(zero: str, offset: float) -> str:
    if zero == "0":
        return f"{-offset + 0.0:+.4f}"
    return f"{zero} {'-' if offset >= 0.0 else '+'} {abs(offset):.4f}"


def _vector(move: Sequence[float] | Array) -> str:
    return ", ".join(f"{round(float(v), 3) + 0.0:+.3f}" for v in move)


def _reads(maker: FrameDialect, text: str, export: ExportRequest) -> Array:
    counted = DEG * np.array(
        [float(v) for v in re.findall(r"^[^:\n]+: offset (\S+) deg", text, re.MULTILINE)]
    )
    base, flange = maker.found(text, export, listed=True)
    changes = _changes(_model_offsets(export, counted))
    return base @ poses_with(export.robot, export.carried.joints, changes) @ flange


def _format(maker: FrameDialect) -> Format:
    return Format(
        _slots,
        lambda export: _writes(maker, export),
        lambda text, export: _reads(maker, text, export),
        "joint offsets, with tool and work frames",
        for_maker(maker.maker, maker.called),
        lambda export: frame_notes(maker, export),
    )


OFFSET_FORMATS: Mapping[str, Format] = {f"{each.called.lower()}-offsets": _format(each) for each in DIALECTS}

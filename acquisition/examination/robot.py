"""The examination of the robot: identity, readiness to move, stop, and position.

Nothing is armed, moved or set. Facts that the protocol does not report are listed in one line, so that their absence is
not read as good news.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from acquisition.cell.cell import Cell, OtherDevice, match_robot
from acquisition.examination.finding import Chart
from acquisition.examination.meeting import Place, compare_clocks, examine_device, read_clock
from calib.units import percent
from drivers.details import Details
from drivers.dh_numbers import DhNumbers
from drivers.errors import Busy, CannotStop, EmergencyStop, SafetyStop, WrongMode
from drivers.interfaces import RobotArm, RobotStatus

_MOVED_DEG = 0.02
_DH_OFF_MM = 0.5


def examine_robot(cell: Cell, robot: RobotArm, chart: Chart, place: Place) -> None:
    """Examine the robot; the findings go into `chart`.

    It ends when the link breaks, and disconnects.
    """
    more = partial(_examine, cell, robot, chart, place.time_scale)
    examine_device(robot, chart, place, partial(match_robot, cell), more)


def _examine(cell: Cell, robot: RobotArm, chart: Chart, time_scale: float) -> None:
    if cell.robot.declared.by_hand:
        chart.note(
            "stop",
            "moved by hand: Stop does not reach it",
            "Agree on a word for stop with whoever drives it.",
        )
        return  # only a person can be asked more
    first_read = chart.ask("position", robot.position)
    clock = partial(cell.robot.declared.clock_s, robot)
    first = read_clock(clock, chart)
    status = chart.ask("status", robot.status)
    if status is not None:
        details = chart.ask("details", partial(cell.robot.declared.details, robot, status)) or Details()
        _fitness(chart, status, details)
        _warmth(chart, details)
        if details.second_channel:
            chart.ok("second_channel", details.second_channel)
        if details.nominal is not None:
            _geometry(cell, chart, details.nominal)
        if details.calibration is not None:
            chart.ok("calibration", f"its controller calculates with {details.calibration.name}")
        if details.closed:
            chart.note("services", f"closed: {', '.join(details.closed)}", details.opened_at)
    if first_read is not None:
        _position(cell, chart, first_read.joints_deg)
    _stop(robot, chart)
    has_clock = compare_clocks(clock, chart, first, time_scale)
    second_read = chart.ask("motion", robot.position)
    if status is not None and first_read is not None and second_read is not None:
        _motion(chart, status, _apart(first_read.joints_deg, second_read.joints_deg))
    if status is not None:
        _note_unreported(chart, status, has_clock=has_clock)


def _fitness(chart: Chart, status: RobotStatus, details: Details) -> None:
    """Check mode, safety and motors, each in its own line."""
    if status.mode == "manual":
        chart.fault("mode", WrongMode("controller in manual mode"))
    elif status.mode == "reduced":
        chart.note(
            "mode",
            "manual, at reduced speed: it moves only while the enabling device is held",
            "Hold it for a first trial; switch to automatic for a campaign.",
        )
    elif status.mode == "auto":
        chart.ok("mode", "automatic")
    stopped = isinstance(details.trouble, SafetyStop)
    if details.trouble is not None and (stopped or not status.emergency_stop):
        chart.fault("safety" if stopped else "program", details.trouble)
    elif status.emergency_stop:
        chart.fault("safety", EmergencyStop("emergency stop pressed"))
    elif status.emergency_stop is not None:
        chart.ok("safety", "no emergency stop")
    if status.motors_on:
        chart.ok("motors", "on")
    elif status.motors_on is not None and (status.emergency_stop or details.trouble is not None):
        chart.note("motors", "off", "They come back when what is named above is put in order.")
    elif status.motors_on is not None:
        chart.fault("motors", WrongMode("motors off"))
    if details.trouble is None and not status.emergency_stop and status.error_number:
        chart.note("alarm", f"the controller shows number {status.error_number}", "Read it on the pendant.")
    if details.speed_share is not None and details.speed_share < 1.0:
        chart.note(
            "speed",
            f"the speed slider is at {percent(details.speed_share)}",
            "Push it up, or every move takes longer than the forecast says.",
        )


def _geometry(cell: Cell, chart: Chart, nominal: DhNumbers) -> None:
    """Compare the DH lengths with which the controller calculates with the robot file."""
    robot = cell.robot.model
    if robot.convention != "dh" or robot.joints != len(nominal.a_mm):
        return
    off = np.abs(np.array([nominal.a_mm, nominal.d_mm]) - np.array([robot.a, robot.d])).max()
    if off > _DH_OFF_MM:
        chart.fault(
            "geometry", OtherDevice(f"its DH lengths differ from those of {robot.name} by up to {off:.1f} mm")
        )
    else:
        chart.ok("geometry", f"its DH lengths are those of {robot.name}")


def _position(cell: Cell, chart: Chart, joints_deg: Sequence[float]) -> None:
    """Check that this robot can take the posture.

    Otherwise it is another robot, or its joint matrix is another one.
    """
    robot = cell.robot.model
    shown = cell.robot.said(joints_deg, 2) if len(joints_deg) == robot.joints else ""
    joints = np.array(joints_deg)
    if len(joints) != robot.joints:
        chart.fault("position", OtherDevice(f"it has {len(joints)} joints, {robot.name} has {robot.joints}"))
        return
    reach = np.array([robot.lower, robot.upper]) / robot.joint_units
    low, high = np.array(cell.robot.limits_deg).T
    impossible = np.flatnonzero((joints < reach[0]) | (joints > reach[1]))
    outside = np.flatnonzero((joints < low) | (joints > high))
    contact = cell.clearance.at(joints[None, :])[0]
    if impossible.size:
        i = int(impossible[0])
        chart.fault(
            "position",
            OtherDevice(
                f"{cell.robot.named(i)} is at {joints[i]:.2f} {robot.units[i]}, "
                f"{robot.name} reaches {reach[0, i]:g} to {reach[1, i]:g}",
                what_to_do="Check model and joint_coupling of the cell file, and the robot's own zero marks.",
            ),
        )
    elif outside.size:
        i = int(outside[0])
        chart.note(
            "position",
            f"{shown}; {cell.robot.named(i)} is outside the cell's {low[i]:g} to {high[i]:g}",
            "Jog the robot within the limits before a campaign: nobody has checked the path there.",
        )
    elif contact is not None:
        chart.note(
            "position",
            f"{shown}; {contact}",
            "Jog the robot clear before a campaign, or correct table_z_mm, keep_out or the fixture.",
        )
    else:
        chart.ok("position", f"{shown}, within the limits of the cell")


def _stop(robot: RobotArm, chart: Chart) -> None:
    if robot.can_stop:
        chart.ok("stop", "the program can stop it")
    else:
        chart.note("stop", "the program cannot stop it", CannotStop.advice)


def _motion(chart: Chart, status: RobotStatus, moved_deg: float) -> None:
    if status.moving or moved_deg > _MOVED_DEG:
        chart.fault(
            "motion",
            Busy(
                f"the robot is moving, {moved_deg:.2f} deg since the first check",
                what_to_do="Find out who moves it, and stop that program first.",
            ),
        )
    else:
        chart.ok("motion", "it stands still")


def _warmth(chart: Chart, details: Details) -> None:
    """Report the motor temperatures if they are known.

    Whether the arm is warm is decided by the readings of a campaign.
    """
    if details.temperatures_c:
        low, high = (f"{of(details.temperatures_c):.0f}" for of in (min, max))
        chart.ok("warm_up", f"joints at {low if low == high else f'{low} to {high}'} degC")


def _note_unreported(chart: Chart, status: RobotStatus, *, has_clock: bool) -> None:
    """List the facts that the protocol does not report, so that they are not taken for good."""
    unfit = {
        "mode": status.mode == "unknown",
        "emergency stop": status.emergency_stop is None,
        "motors": status.motors_on is None,
    }
    silent = [name for name, unreported in unfit.items() if unreported]
    missing = ", ".join([*silent, *([] if has_clock else ["clock"])])
    if silent:
        chart.note("untold", f"this protocol does not report: {missing}", "Look at the pendant.")
    elif missing:
        chart.ok("untold", f"this protocol does not report: {missing}")


def _apart(one: Sequence[float], other: Sequence[float]) -> float:
    return max(abs(a - b) for a, b in zip(one, other, strict=True))

"""Correction of a program.

All targets are found, solved and corrected in one batch. The corrected program is written, read again and
compared. The values of the written file are taken from reading it back as the controller will. Rounding, and
any mistake in writing, therefore shows in the results. Sources of the correction: `calib.compensate`.

This module also gives the summary of a corrected program: a table for people, a document for programs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from calib.arm import Robot, forward
from calib.array import Array
from calib.compensate import Calibrated, Usable, correct, nominal_of
from calib.errors import DataError
from calib.fit import radius_95
from calib.model import FLANGE, ModelStructure, StatedConditions
from calib.saved import CalibratedModel
from calib.units import DEG
from service import wording
from service.programs.frames import KnownFrames
from service.programs.postures import leaves_window, postures
from service.programs.program import NewTarget, ProgramTarget, RobotProgram, rewritten
from service.programs.read import as_written, parse

CORRECTED, EMPTY, REFUSED = "corrected", "empty", "refused"
_TOOL = "the tool of the program"
_SLACK = 0.01  # share of its range by which a joint may leave it
FORMAT = "truepose-compensation/1"
_SHOWN = 40  # targets on a terminal; the JSON holds all


@dataclass(frozen=True)
class TargetOutcome:
    """Result of the correction of one target.

    Values are NaN if the target was not corrected. Positions are those of the target's tool point.

    Attributes
    ----------
    moved : tuple of float
        mm and rad from the pose as written to the pose that is sent.
    quantised : tuple of float
        mm and rad from the pose that is sent to the one that the file can hold.
    turned : float
        Largest change of a rotating joint, rad.
    slid : float
        Largest change of a sliding joint, mm; NaN without one.
    left : str
        Sentence part on errors that this arm cannot correct, and on joints outside the measured range.
    beyond : tuple of str
        The joints outside the measured range.
    radius_95 : float
        Radius of the sphere that contains 95 % of the positions that the model allows, mm.
    """

    target: ProgramTarget
    status: str
    why: str
    moved: tuple[float, float]
    quantised: tuple[float, float]
    turned: float
    slid: float = np.nan
    left: str = ""
    beyond: tuple[str, ...] = ()
    radius_95: float = np.nan


@dataclass(frozen=True)
class Compensation:
    """A program with corrected targets, and the outcome of every target of its source.

    The text holds no formula for a spreadsheet.
    """

    text: str
    outcomes: tuple[TargetOutcome, ...]

    def of(self, status: str) -> list[TargetOutcome]:
        """Return the targets with this status."""
        return [outcome for outcome in self.outcomes if outcome.status == status]


def compensate(
    program: RobotProgram,
    path: Path,
    saved: CalibratedModel,
    stated: StatedConditions,
    known: KnownFrames,
    *,
    inverse: bool = False,
    most_mm: float = np.inf,
) -> Compensation:
    """Correct the targets of a program; the others stay as they are, with the reason.

    Parameters
    ----------
    inverse : bool
        Correct from actual to nominal instead.
    most_mm : float
        Largest radius that contains 95 % of the positions that the model allows, mm. A target above it is not
        corrected.

    Raises
    ------
    DataError
        The model lacks a stated condition, the program holds no target, or it has poses and the robot has no
        inverse kinematics here.
    """
    robot, coupling = saved.model.robot, saved.coupling
    targets = program.targets
    if not targets:
        raise DataError("holds no target.", do="Give a program with targets.", file=path)
    angles, why = postures(targets, robot, coupling)
    nominal = robot.model_angles(angles, coupling)
    corrected = nominal_of if inverse else correct
    model, tool = _with_tool(saved.model, targets)
    # An arm of fewer than six joints leaves a tilt of the flange, by which a tool that is long would be off.
    point = tool if robot.joints < 6 else FLANGE
    done = corrected(
        model, saved.estimate, nominal, stated, target=point, coupling=coupling, regression=saved.regression
    )
    counted = robot.controller_angles(done.joints, coupling)
    outside = _outside(robot, saved.holds_for.get("joints"), angles, counted)
    done = replace(
        done,
        beyond=tuple(
            tuple(dict.fromkeys([*named, *more])) for named, more in zip(done.beyond, outside, strict=True)
        ),
    )
    flange = _flanges(robot, done.joints)
    driven: dict[int, NewTarget] = {}
    for i, target in enumerate(targets):
        if target.empty or why[i]:
            continue
        why[i] = done.reasons[i]
        kept = target.kept if target.turns_written else frozenset(target.windows)
        if not why[i] and (change := leaves_window(target, counted[i], kept)):
            why[i] = f"its configuration would change: {change}"
        if not why[i]:
            driven[i] = NewTarget(counted[i], flange[i])
    radius = np.full(len(targets), np.nan)
    if driven:
        at = done.joints[[*driven]] if not inverse else nominal[[*driven]]
        calibrated = Calibrated(model, saved.estimate, stated, tool)
        radius[[*driven]] = radius_95(calibrated.covariance_of_points(at, saved.covariance))
    for i in [i for i in driven if radius[i] > most_mm]:
        del driven[i]
        far = f", outside the measured range ({', '.join(done.beyond[i])})" if done.beyond[i] else ""
        why[i] = f"the model knows it to {radius[i]:.2g} mm only (95 %){far}: more than {most_mm:g} mm"
    # What needs no correction keeps its digits.
    changed = {i: d for i, d in driven.items() if not np.array_equal(done.joints[i], nominal[i])}
    text = as_written(rewritten(program, changed), path)
    written = _read_back(text, path, targets, robot, coupling, known)
    before, after = _flanges(robot, nominal), _flanges(robot, written)
    slides = np.array(robot.kinds) == "slides"
    change = np.abs(done.joints - nominal)
    turned = np.max(change[:, ~slides], axis=1, initial=0.0)
    slid = np.max(change[:, slides], axis=1) if slides.any() else np.full(len(targets), np.nan)
    notes = done.notes
    outcomes = []
    for i, target in enumerate(targets):
        if i not in driven:
            status = EMPTY if target.empty else REFUSED
            nothing = (np.nan, np.nan)
            outcomes.append(TargetOutcome(target, status, why[i], nothing, nothing, np.nan))
            continue
        moved, quantised = _apart(before[i], flange[i], target.tool), _apart(flange[i], after[i], target.tool)
        joints = float(turned[i]), float(slid[i])
        more = (notes[i], done.beyond[i], float(radius[i]))
        outcomes.append(TargetOutcome(target, CORRECTED, "", moved, quantised, *joints, *more))
    return Compensation(text, tuple(outcomes))


def _outside(robot: Robot, measured: Sequence[Sequence[float]] | None, *joints: Array) -> list[list[str]]:
    """List for each target the joints outside the range in which the model was `measured`.

    The range is in deg or mm. A joint is listed if it is outside at any of the controller angles (n, N), rad or mm.
    The lists are empty if the model does not state its range.
    """
    if measured is None:
        return [[] for _ in joints[0]]
    low, high = np.transpose(measured)
    reached = np.stack(joints) / robot.joint_units
    slack = _SLACK * (high - low)
    off = np.any((reached < low - slack) | (reached > high + slack), axis=0)
    names = [f"joint {axis.removeprefix('j')}" for axis in robot.axes]
    return [[name for name, there in zip(names, row, strict=True) if there] for row in off]


def _with_tool(model: ModelStructure, targets: Sequence[ProgramTarget]) -> tuple[ModelStructure, str]:
    """Return the model, and its target at the tool point of the program's targets.

    With several tools it is the flange.
    """
    tools = np.unique([target.tool[:3, 3] for target in targets], axis=0)
    if len(tools) > 1 or not np.any(tools):
        return model, FLANGE
    x, y, z = tools[0].tolist()
    return replace(model, targets={s: {**own, _TOOL: (x, y, z)} for s, own in model.targets.items()}), _TOOL


def _read_back(
    text: str,
    path: Path,
    targets: Sequence[ProgramTarget],
    robot: Robot,
    coupling: str,
    known: KnownFrames,
) -> Array:
    """Return the model angles (n, N) that a controller finds in the program as written.

    Raises
    ------
    RuntimeError
        The written program has other targets.
    """
    again = parse(text, path, robot, known).targets
    if [t.name for t in again] != [t.name for t in targets]:
        raise RuntimeError(
            "the corrected program differs in more than its targets from the program it was made from"
        )
    return robot.model_angles(postures(again, robot, coupling)[0], coupling)


def _flanges(robot: Robot, joints: Array) -> Array:
    """Return flange poses (n, 4, 4) of the nominal robot; NaN where the joints are NaN."""
    poses = forward(robot, np.nan_to_num(joints))
    poses[~np.all(np.isfinite(joints), axis=1)] = np.nan
    return poses


def _apart(one: Array, other: Array, tool: Array) -> tuple[float, float]:
    """Distance of the tool points, mm, and turn, rad, between two flange poses."""
    a, b = one @ tool, other @ tool
    turn = a[:3, :3].T @ b[:3, :3]
    vector = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return float(np.linalg.norm(b[:3, 3] - a[:3, 3])), float(
        np.arctan2(0.5 * np.linalg.norm(vector), 0.5 * (np.trace(turn) - 1.0))
    )


def document(done: Compensation) -> dict[str, Any]:
    """Return counts, largest values, and every target."""
    corrected = done.of(CORRECTED)
    return {
        "corrected": len(corrected),
        "refused": len(done.of(REFUSED)),
        "empty": len(done.of(EMPTY)),
        "largest_move_mm": _largest([o.moved[0] for o in corrected]),
        "largest_quantisation_mm": _largest([o.quantised[0] for o in corrected]),
        "targets": [
            {
                "target": o.target.name,
                "line": o.target.line,
                "kind": o.target.kind,
                "status": o.status,
                "reason": o.why or None,
                "moved_mm": _number(o.moved[0]),
                "moved_deg": _number(o.moved[1] / DEG),
                "largest_joint_change_deg": _number(o.turned / DEG),
                "largest_slide_change_mm": _number(o.slid),
                "quantised_mm": _number(o.quantised[0]),
                "quantised_deg": _number(o.quantised[1] / DEG),
                "outside_measured_range": list(o.beyond),
                "radius_95_mm": _number(o.radius_95),
                "notes": _notes(o),
            }
            for o in done.outcomes
        ],
    }


def of_carried(usable: Usable) -> dict[str, Any]:
    """Return the carried terms that a correction leaves out, with their cost."""
    return {
        "carried_left_out": [effect.label for effect in usable.left_out],
        "carried_loss_mm": None if usable.loss is None else asdict(usable.loss),
    }


def _notes(outcome: TargetOutcome) -> list[str]:
    return [*outcome.target.notes, *([outcome.left] if outcome.left else [])]


def shown(done: Compensation) -> Iterator[RenderableType]:
    """List every target with its move and its rounding.

    Refused targets come first and in full.
    """
    for outcome in done.of(REFUSED):
        yield Text(f"{refusal(outcome)}.")
    table = Table(
        title="Targets", title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False
    )
    listed = [o for o in done.outcomes if o.status != REFUSED]
    slides = any(math.isfinite(o.slid) for o in listed)
    joints = ("joints deg", "slides mm") if slides else ("joints deg",)
    heads = ("target", "line", "moved mm", "moved deg", *joints, "rounded mm", "95 % within mm", "")
    for name in heads:
        table.add_column(name, justify="left" if name in ("target", "") else "right", overflow="fold")
    for o in listed[:_SHOWN]:
        if o.status == EMPTY:
            figures = ["-"] * (len(heads) - 3)
        else:
            figures = [
                f"{o.moved[0]:.3f}",
                f"{o.moved[1] / DEG:.3f}",
                f"{o.turned / DEG:.3f}",
                *([f"{o.slid:.3f}"] if slides else []),
                f"{o.quantised[0]:.5f}",
                f"{o.radius_95:.3f}",
            ]
        table.add_row(o.target.name, str(o.target.line), *figures, "; ".join(_notes(o)))
    if listed:
        yield table
    if len(listed) > _SHOWN:
        yield Text(f"... and {len(listed) - _SHOWN} more; --json lists all.")


def refusal(outcome: TargetOutcome) -> str:
    """Return a refused target as a sentence without its full stop."""
    return f"line {outcome.target.line}, target '{outcome.target.name}': {outcome.why}"


def in_words(done: Compensation) -> str:
    """Return one line for people."""
    corrected, empty = done.of(CORRECTED), done.of(EMPTY)
    parts = [f"{wording.counted(len(corrected), 'target')} corrected"]
    if corrected:
        parts.append(
            f"moved by {np.max([o.moved[0] for o in corrected]):.3f} mm at most, "
            f"rounded by {np.max([o.quantised[0] for o in corrected]):.5f} mm at most"
        )
    if empty:
        parts.append(f"{len(empty)} never taught")
    return ", ".join(parts)


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _largest(values: list[float]) -> float | None:
    return _number(max(values)) if values else None

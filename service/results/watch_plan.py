"""Plan of a watch, for the command line (`truepose-watch-plan/1`).

The check poses depend on the kind of instrument:

- Instruments that measure points or poses, and instruments that are read by hand: poses drawn at random.
- Ballbar: stances of its six legs, at joints at which the model has the legs within the stroke.
- Touched artefact (`touch`): poses in which a target of the tool sits in balls at known positions.

The result is a campaign with the check poses. A robot does not drive to contact, so for a touched artefact the result
is a data set that a person fills in.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from acquisition import Cell
from acquisition.campaign import ApproachRule, Pose, Visit, drawn_poses, stance_poses, touch_poses
from acquisition.record import planned_header
from calib import watch
from calib.data import Header, Noise, header_of
from calib.errors import DataError
from calib.fit import silent
from calib.saved import CalibratedModel
from calib.units import DEG
from calib.watch import NestLimit, PlannedVisits, WatchPlan, WatchPlanProposal
from service.results.watch_answers import WatchPlanFound
from service.results.watched import in_words


@dataclass(frozen=True)
class WatchPlanRequest:
    """Request for the plan of a watch.

    Attributes
    ----------
    poses, candidates
        Number of check poses, and of candidates from which they are chosen.
    targets
        Names of the tool targets; None for all targets of the cell.
    offset_deg
        Length of the last move of each joint, deg.
    both
        Whether the side of approach is drawn for each joint; otherwise all joints arrive from below.
    rate
        False-alarm rate.
    rounds, repeats
        Number of visits to each pose, and of readings of each target per visit. None: the fewest that show every cause,
        if an instrument measures points.
    touch
        Balls to be touched; empty if an instrument measures.
    touch_mm
        Repeatability of a touch, mm.
    frame_known
        Whether the instrument or artefact will be in the same place as for the baseline.
    """

    poses: int
    candidates: int
    targets: tuple[str, ...] | None
    offset_deg: float
    both: bool
    rate: float
    seed: int
    rounds: int | None = 1
    touch: tuple[str, ...] = ()
    touch_mm: float = 0.02
    frame_known: bool = True
    repeats: int | None = 1


_STROKE_MM = 0.3  # of the bar's, which the legs of a check pose may be off by the model's own account
_CORRECTED_DEG = 2.0  # by which a calibrated robot's joints differ from the nominal ones at most
_SIDES_EACH = 4  # choices of sides for every stance
_SETS = 12  # choices of targets that are compared
NOT_TOUCHED = "rejected:not touched yet"


@dataclass(frozen=True)
class PlannedWatch:
    """Check poses of a cell with the causes that they show.

    Attributes
    ----------
    poses
        One pose for each visit, in order.
    balls
        Ball that is touched at each pose; empty if an instrument measures.
    proposals
        Readings that would detect every cause at its target size, if these poses do not.
    robot
        Device data of the robot of the baseline.
    doubted
        Reason why the baseline does not keep the false-alarm rate, or empty.
    """

    cell: Cell
    model: Path
    asked: WatchPlanRequest
    targets: tuple[str, ...]
    poses: tuple[Pose, ...]
    balls: tuple[str, ...]
    plan: WatchPlan
    noise: Noise
    proposals: tuple[WatchPlanProposal, ...]
    robot: Mapping[str, str]
    doubted: str

    @staticmethod
    def of(
        cell: Cell,
        file: Path,
        saved: CalibratedModel,
        model: Path,
        asked: WatchPlanRequest,
        say: Callable[[str], None] = silent,
    ) -> PlannedWatch:
        """Draw candidates, choose check poses and predict what they show, for the cell of `file`.

        Raises
        ------
        DataError
            The request does not fit the cell, or its readings could not be compared with the baseline.
        ConfigError
            No suitable poses are found in the cell.
        """
        targets = _targets(cell, asked)
        _refuse_one_sided(saved, model, both=asked.both)
        say("drawing candidates")
        balls: list[str] = []
        lengths = cell.instrument.declared.measures_lengths
        times, repeats = _often(asked, by_points=not lengths, by_hand=cell.instrument.declared.by_hand)
        arrival = ApproachRule(asked.offset_deg, asked.both, opposite=times != 1)
        rng = np.random.default_rng(asked.seed)
        if asked.touch:
            drawn, sat = touch_poses(cell, asked.candidates, targets[0], asked.touch, arrival, rng)
            balls = [ball for ((_, ball),) in sat]
            read = [((targets[0], ""),)] * len(sat)
        elif lengths:
            drawn, read = stance_poses(cell, _SIDES_EACH, arrival, rng)
        else:
            drawn, read = drawn_poses(cell, asked.candidates, asked.poses, targets, arrival, rng)
        header = _header_of(cell, file, asked)
        candidates = _visits(cell, drawn, read)
        moving = np.flatnonzero(np.all(candidates.sides != 0.0, axis=1))
        drawn, candidates = [drawn[i] for i in moving], candidates.take(moving)
        balls = [balls[i] for i in moving] if balls else []
        if lengths and not asked.touch:
            keep, candidates = _in_stroke(cell, saved, header, candidates)
            drawn = [_moved(cell, drawn[i], q) for i, q in zip(keep, candidates.joints, strict=True)]
        say(f"choosing {asked.poses} of {len(drawn)}")
        found = watch.plan(
            saved,
            header,
            candidates,
            asked.poses,
            asked.rate,
            times=times,
            repeats=repeats,
            frame_known=asked.frame_known,
        )
        once = tuple(drawn[i] for i in found.chosen)
        poses = tuple(
            pose._replace(sides=tuple(int((-1) ** k * side) for side in pose.sides))
            for k in range(found.rounds)
            for pose in once
        )
        chosen = found.visits
        refuse_visits(saved, header, chosen, file, model, frame_known=asked.frame_known)
        proposals = ()
        if not lengths and not asked.touch and any((c.share or 1.0) < watch.SEEN for c in found.shown.causes):
            say("comparing targets and rounds")
            proposals = watch.proposals(
                saved,
                header,
                chosen.take(range(asked.poses)),
                _choices(cell, saved, targets),
                found.shown.limit,
                frame_known=asked.frame_known,
            )
        robot = next((each for each in saved.devices if each.get("role") == "robot"), {})
        touched = tuple(balls[i] for i in found.chosen) * found.rounds if balls else ()
        return PlannedWatch(
            cell,
            model,
            asked,
            targets,
            poses,
            touched,
            found,
            header.noise,
            proposals,
            robot,
            watch.too_few_poses(saved),
        )

    @property
    def in_words(self) -> str:
        """Sentences on the causes that the check poses detect, and on remedies; may be empty."""
        said = in_words(self.plan, self.proposals, self.targets, self.asked.poses)
        return " ".join(filter(None, (said, self.doubted)))

    @property
    def driven(self) -> bool:
        """Whether `truepose watch run` can drive the plan, which it cannot for a touched artefact."""
        return not self.asked.touch

    @property
    def nests(self) -> NestLimit | None:
        """Limit of the nests, measured again half-way; None if they are not measured automatically."""
        cell = self.cell
        lengths = cell.instrument.declared.measures_lengths
        if self.asked.touch or lengths or not cell.nests or cell.instrument.one_smr:
            return None
        three = dict(list(cell.nests.items())[:3])
        return watch.nest_limit(three, self.noise, self.asked.rate)

    def files(self, out: Path) -> dict[Path, str]:
        """Create the files by path: the campaign, or the data set to be filled in and its header."""
        if self.driven:
            limit = None if self.nests is None else self.nests.limit_mm
            visits = self.plan.visits
            return {
                out: campaign_of(
                    self.model.name,
                    self.asked,
                    self.targets,
                    self.poses,
                    visits,
                    self.plan.repeats,
                    limit,
                    self.robot,
                )
            }
        return touched_files(out, self.cell, self.asked, self.targets[0], self.poses, self.balls)

    @property
    def result(self) -> WatchPlanFound:
        """The plan for programs."""
        asked, plan, cell = self.asked, self.plan, self.cell
        return WatchPlanFound.model_validate(
            {
                "format": "truepose-watch-plan/1",
                "cell": cell.name,
                "model": self.model.name,
                "instrument": "touch" if asked.touch else cell.instrument.name,
                "targets": self.targets,
                "rounds": plan.rounds,
                "repeats": plan.repeats,
                "readings": plan.shown.readings,
                "in_words": self.in_words,
                "enough_poses": plan.enough,
                "enough_lever_mm": None if plan.lever is None else plan.lever[1],
                "false_alarms": asked.rate,
                "seen_in": watch.SEEN,
                "alone_in": watch.ALONE,
                "poses_deg": [pose.joints_deg for pose in self.poses],
                "sides": [pose.sides for pose in self.poses],
                "causes": plan.shown.causes,
                "not_seen": plan.shown.unseen,
                "nests": self.nests,
                "proposals": [
                    {
                        "targets": each.targets,
                        "rounds": each.rounds,
                        "repeats": each.repeats,
                        "readings": each.readings,
                        "reached": each.reached,
                        "worst": each,
                    }
                    for each in self.proposals
                ],
            }
        )


def _often(asked: WatchPlanRequest, *, by_points: bool, by_hand: bool) -> tuple[int | None, int | None]:
    """Return the visits per pose and the readings per visit; None means as few as are enough.

    By default a person and a ballbar read once. If the joints arrive from one side only, each pose is visited once by
    default, since there is no second visit from the other side.
    """
    if asked.touch or not by_points:
        return asked.rounds or 1, 1
    if by_hand:
        return asked.rounds or 1, asked.repeats or 1
    return asked.rounds if asked.both else asked.rounds or 1, asked.repeats


def _targets(cell: Cell, asked: WatchPlanRequest) -> tuple[str, ...]:
    """Return the requested targets, for a ballbar the first three.

    Raises
    ------
    DataError
        The cell does not have the targets or balls, or cannot use them.
    """
    targets = tuple(cell.tool.targets) if asked.targets is None else asked.targets
    if unknown := [name for name in targets if name not in cell.tool.targets]:
        raise DataError(
            f"'{unknown[0]}' is not a target of the cell.",
            do=f"Use {', '.join(cell.tool.targets)}.",
            key="--targets",
        )
    if unknown := [name for name in asked.touch if name not in cell.nests]:
        raise DataError(
            f"'{unknown[0]}' is not a ball of the cell.",
            do=f"Name balls whose places [world] nests has: {', '.join(cell.nests)}.",
            key="--touch",
        )
    if asked.touch and len(targets) != 1:
        raise DataError(
            "must name one target: the ball of the tool that touches.",
            do="Name it: --targets T1.",
            key="--targets",
        )
    if asked.touch and not 3 <= len(asked.touch) <= 4:
        raise DataError(f"names {len(asked.touch)} balls.", do="Name three or four.", key="--touch")
    if not asked.touch and cell.instrument.declared.measures_lengths and asked.targets is not None:
        raise DataError(
            "is for instruments that see points: a ballbar takes the first three.",
            do="Leave it out.",
            key="--targets",
        )
    return targets[:3] if cell.instrument.declared.measures_lengths and not asked.touch else targets


def _header_of(cell: Cell, file: Path, asked: WatchPlanRequest) -> Header:
    values = planned_header(cell)
    if asked.touch:
        values["noise"] = {
            "kind": "isotropic",
            "sigma_mm": asked.touch_mm,
            "repeatability_deg": cell.robot.repeatability_deg,
        }
        values = {k: v for k, v in values.items() if k not in ("nests", "base_targets", "base_targets_u_mm")}
    return header_of(values, file, "")


def _visits(cell: Cell, poses: Sequence[Pose], read: Sequence[tuple[tuple[str, str], ...]]) -> PlannedVisits:
    """Convert visits to the joints of the model.

    The side is 0 for a joint of the model that does not move because two coupled joints of the controller cancel.
    """
    joints = cell.robot.model_angles([pose.joints_deg for pose in poses])
    moved = joints - cell.robot.model_angles(
        [np.subtract(pose.joints_deg, np.multiply(pose.sides, 1.0)) for pose in poses]
    )
    return PlannedVisits(
        joints,
        np.where(np.abs(moved) < 1e-9, 0.0, np.sign(moved)),
        np.array([pose.reach_deg for pose in poses]) * DEG,
        tuple(read),
    )


def _in_stroke(
    cell: Cell, saved: CalibratedModel, header: Header, candidates: PlannedVisits
) -> tuple[list[int], PlannedVisits]:
    """Find the candidates whose legs the model brings within the stroke: indices and visits."""
    found, off = watch.within_stroke(saved, header, candidates, cell.instrument.nominal_mm)
    near = np.max(np.abs(found.joints - candidates.joints), axis=1) < _CORRECTED_DEG * DEG
    keep = np.flatnonzero((off < _STROKE_MM) & near).tolist()
    return keep, found.take(keep)


def _moved(cell: Cell, pose: Pose, joints: np.ndarray) -> Pose:
    """Return the pose at other joints of the model, rad, converted to those of the controller."""
    robot = cell.robot.model
    counted = robot.controller_angles(joints[None], cell.robot.coupling)[0] / robot.joint_units
    return pose._replace(joints_deg=tuple(round(float(q), 4) for q in counted))


def _choices(cell: Cell, saved: CalibratedModel, targets: tuple[str, ...]) -> list[tuple[str, ...]]:
    """List the requested targets, then other choices of targets that cell and model have.

    Choices of few targets come first; at most `_SETS` are returned.
    """
    known = [name for name in cell.tool.targets if name in next(iter(saved.model.targets.values()))]
    every = [some for count in range(1, len(known) + 1) for some in combinations(known, count)]
    return list(dict.fromkeys([targets, *every]))[:_SETS]


def _refuse_one_sided(saved: CalibratedModel, model: Path, *, both: bool) -> None:
    sides = saved.holds_for.get("approach") or ()
    if both and any(side != "both sides" for side in sides):
        raise DataError(
            "was calibrated with joints that came from one side only: backlash that was always there would look new.",
            do="Calibrate with approach sides = 'both', or plan with --one-side: backlash is then not detected.",
            file=model,
            key="holds_for.approach",
        )


def refuse_visits(
    saved: CalibratedModel,
    header: Header,
    visits: PlannedVisits,
    file: Path,
    model: Path,
    *,
    frame_known: bool = True,
) -> None:
    """Refuse visits in the cell of `file` whose readings could not be compared with a baseline.

    Raises
    ------
    DataError
        The readings would be no watch of this baseline.
    """
    would = replace(watch.planned(saved, header, visits), path=file)
    watch.refuse_unlike(saved, would, model, frame_known=frame_known, missing_allowed=False)


def refuse_plan(cell: Cell, file: Path, saved: CalibratedModel, model: Path, visits: Sequence[Visit]) -> None:
    """Refuse, before anything moves, a campaign whose readings do not suit the baseline.

    Raises
    ------
    DataError
        The readings would be no watch of this baseline.
    """
    those = [visit for visit in visits if visit.kind == "pose"]
    if not those:
        return
    poses = [Pose(visit.joints_deg, visit.sides, 0.0) for visit in those]
    read = [tuple((target, base or "") for target, base in visit.readings) for visit in those]
    header = header_of(planned_header(cell), file, "")
    refuse_visits(saved, header, _visits(cell, poses, read), file, model)


def campaign_of(
    model: str,
    asked: WatchPlanRequest,
    targets: Sequence[str],
    poses: Sequence[Pose],
    visits: PlannedVisits,
    repeats: int,
    nest_limit_mm: float | None,
    robot: Mapping[str, str],
) -> str:
    """Write the campaign (TOML) that visits the poses in their order.

    Parameters
    ----------
    repeats : int
        Number of readings of each target per visit.
    nest_limit_mm : float or None
        Limit of the nests, which are measured again half-way, mm; None if they are not measured again.
    robot : mapping
        Device data of the robot of the baseline.
    """
    block: dict[str, Any] = {
        "set": "calibration",
        "joints_deg": [list(pose.joints_deg) for pose in poses],
        "approach_sides": [list(pose.sides) for pose in poses],
    }
    if any(base for _, base in visits.read[0]):
        block |= {"kind": "legs", "legs": [[list(leg) for leg in legs] for legs in visits.read]}
    else:
        block |= {"kind": "poses", "select": "list", "targets": list(targets)}
        if repeats > 1:
            block["readings"] = repeats
    table = {
        "format": "truepose-campaign/1",
        "seed": asked.seed,
        "approach": {"offset_deg": -asked.offset_deg, "sides": "both" if asked.both else "one"},
        "block": [block],
    }
    if nest_limit_mm is not None:
        table["nest_check"] = {"every": max(visits.readings // 2, 1), "limit_mm": round(nest_limit_mm, 4)}
    if robot.get("serial"):
        table["robot"] = {key: robot[key] for key in ("maker", "model", "serial") if robot.get(key)}
    return f"# Check poses of {model}, by truepose watch plan.\n{tomli_w.dumps(table)}"


def touched_files(
    out: Path, cell: Cell, asked: WatchPlanRequest, target: str, poses: Sequence[Pose], balls: Sequence[str]
) -> dict[Path, str]:
    """Create the data set of touches and its header, by path.

    Each row holds a pose and the position of its ball, one of `balls`. The person who has touched the ball enters the
    joints that the controller shows, and empties the status.

    Raises
    ------
    DataError
        `out` is not a CSV file.
    """
    if out.suffix != ".csv":
        raise DataError(
            "is not the name of a data set. A plan with --touch is a table that a person fills, not a campaign.",
            do="Name a .csv file.",
            file=out,
            key="--out",
        )
    values = planned_header(cell)
    values["noise"] = {
        "kind": "isotropic",
        "sigma_mm": asked.touch_mm,
        "repeatability_deg": cell.robot.repeatability_deg,
    }
    values["instrument"], values["readings"] = "touch", f"1-{len(poses)}"
    for key in ("base_targets", "base_targets_u_mm", "nests", "u_mm_assumed", "model"):
        values.pop(key, None)
    robot, text = cell.robot.model, io.StringIO(newline="")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(
        [
            *("reading_id", "ball", "status", "tool_target", "x_mm", "y_mm", "z_mm"),
            *robot.joint_columns,
            *robot.approach_columns,
            "t_air_c",
        ]
    )
    for i, (pose, name) in enumerate(zip(poses, balls, strict=True), start=1):
        rows.writerow([i, name, NOT_TOUCHED, target, *cell.nests[name], *pose.joints_deg, *pose.sides, ""])
    return {out: text.getvalue(), out.with_suffix(".toml"): tomli_w.dumps(values)}

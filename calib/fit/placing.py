"""Base model of a data set, with start values for base, tool and base targets.

The start of every series is found from its own readings. The base pose follows by aligning the nominal
robot with measured points, or with base targets located by distances; the tool frame follows by
averaging.

If the series has sweeps of single joints, their circles give a second start (`fit.circle_points`):
joints 1 and 2 place the base, the last two the tool. The start at which the nominal robot misses less is
taken. This matters if the tool is unknown and as long as the arm, and the poses are few: alternate
alignment and averaging then end in a wrong place.

`place_nominal` fits base and tool alone. The result is the nominal robot at its best, with which every
report compares. It places a calibrated robot in the same way.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import forward
from calib.arm.start import align, base_and_tool, base_target, tool_turn, tools_of
from calib.array import Array
from calib.data.dataset import Dataset
from calib.data.header import Header
from calib.data.plausible import refuse_mirrored
from calib.data.spans import Span
from calib.errors import DataError
from calib.fit import robust
from calib.fit.circle_points import Start, starts
from calib.fit.least_squares import Linearisation, find_dependent, solve
from calib.fit.readings import readings_of
from calib.model import base_model
from calib.model.effect import Effect
from calib.model.model import BoundModel, ModelStructure
from calib.text.toml_table import Vector

_OF_PLACE = {"base", "target", "anchor", "length"}  # what the maker's drawing of the robot does not say


def base_model_of(dataset: Dataset, groups: Sequence[str] | None = None) -> ModelStructure:
    """Build the model that the header frees, with a start for every series.

    Parameters
    ----------
    dataset : Dataset
        Readings and header of one robot.
    groups : sequence of str, optional
        Parameter groups to free. Default: those of the header.

    Raises
    ------
    DataError
        There are no measured calibration rows, or the readings are mirrored or in another unit. The
        error is also raised if the header holds or weighs a parameter that the model does not have, or
        one without a nominal value.
    """
    if not dataset.fit_rows.any():
        raise DataError(
            "has no calibration rows that were measured: nothing can be fitted to it.",
            do="Mark some rows set = calibration, or judge a model with these: truepose validate DATA --model M.json.",
            file=dataset.path,
            key="set",
        )
    _refuse_unknown(dataset)
    header, conditions = dataset.header, dataset.conditions
    groups = header.groups if groups is None else groups
    targets = {name: header.targets_of(name) for name in conditions.series_names}
    placements: dict[str, Array] = {}
    turns: dict[str, Array] = {}
    located: dict[str, Vector] = {}
    measured_in: list[dict[str, bool]] = []
    flange = forward(header.robot, conditions.joints)
    circles = starts(dataset) if header.world == "free" else {}
    for s, name in enumerate(conditions.series_names):
        rows = dataset.fit_rows & (conditions.series == s)
        names = conditions.target_names
        seen = {
            names[t]: bool((dataset.turned & rows & (conditions.target == t)).any())
            for t in np.unique(conditions.target[rows])
        }
        measured_in.append(seen)
        pointed = rows & dataset.pointed
        if header.world == "free" and pointed.any():
            nominal = np.array([targets[name].get(t, (0.0, 0.0, 0.0)) for t in names])
            which, points = conditions.target[pointed], dataset.points[pointed]
            free = "tool" in groups
            pose, tool = base_and_tool(flange[pointed], nominal, which, points, tool_unknown=free)
            if s in circles:
                pose, tool = _nearer(
                    flange[pointed], (pose, tool), circles[s], which, points, tool_unknown=free
                )
            placements[name] = pose
            if free:
                found: dict[str, Vector] = {
                    t: (float(x), float(y), float(z))
                    for t, (x, y, z) in zip(names, tool, strict=True)
                    if t in seen and t not in header.tool_targets_u_mm and not _declared(header, "tool", t)
                }
                targets[name] = {**targets[name], **found}
        turned = rows & dataset.turned
        if "tool" in groups and turned.any() and not _declared(header, "tool", *(f"{t}.r" for t in seen)):
            pose = placements.get(name, np.eye(4))
            turns[name] = tool_turn(flange[turned], pose, dataset.orientation[turned])
        spanned = rows & dataset.spanned
        if spanned.any():
            here = _locate(dataset, flange, targets[name], spanned, zero_unknown="length_zero" in groups)
            known = {b: place for b, place in here.items() if b in header.base_targets}
            refuse_mirrored(dataset, known, {b: np.array(header.base_targets[b]) for b in known})
            if header.world == "free" and name not in placements:
                placements[name] = _aligned(here, header)
            pose = placements.get(name, np.eye(4))
            for anchor, place in here.items():
                x, y, z = pose[:3, :3] @ place + pose[:3, 3]
                located.setdefault(anchor, (float(x), float(y), float(z)))
    if header.one_tool and "tool" in groups and len(placements) > 1:
        _share_tool(dataset, flange, targets, placements, turns)
    effects = base_model.build(
        groups,
        header.robot,
        conditions.series_names,
        measured_in,
        _uncertain(header, conditions.anchor_names),
        header.tool_targets_u_mm,
        one_tool=header.one_tool,
    )
    return ModelStructure(
        header.robot,
        _adapted(effects, dataset),
        targets,
        placements,
        header.noise.station_mm,
        turns,
        {
            name: header.base_targets.get(name, located.get(name, (0.0, 0.0, 0.0)))
            for name in conditions.anchor_names
        },
        spans=_between(dataset, targets, measured_in),
    )


def _share_tool(
    dataset: Dataset,
    flange: Array,
    targets: dict[str, dict[str, Vector]],
    placements: dict[str, Array],
    turns: dict[str, Array],
) -> None:
    """Start all series with one tool, and their bases with that tool.

    Each target is taken from the series that measured it most often.
    """
    conditions, rows = dataset.conditions, dataset.fit_rows & dataset.pointed
    names = conditions.target_names
    counts = {
        name: np.bincount(conditions.target[rows & (conditions.series == s)], minlength=len(names))
        for s, name in enumerate(conditions.series_names)
    }
    best = {t: max(counts, key=lambda name: counts[name][k]) for k, t in enumerate(names)}
    shared = {t: targets[of][t] for t, of in best.items() if t in targets[of]}
    if turns:
        whole = max(turns, key=lambda name: counts[name].sum())
        turns.update(dict.fromkeys(turns, turns[whole]))
    for s, name in enumerate(conditions.series_names):
        targets[name] = {**targets[name], **shared}
        of = rows & (conditions.series == s)
        if name in placements and of.any():
            nominal = np.array([targets[name].get(t, (0.0, 0.0, 0.0)) for t in names])
            placements[name], _ = base_and_tool(
                flange[of], nominal, conditions.target[of], dataset.points[of], tool_unknown=False
            )


def _nearer(
    flange: Array,
    aligned: tuple[Array, Array],
    circles: Start,
    which: NDArray[np.int64],
    points: Array,
    *,
    tool_unknown: bool,
) -> tuple[Array, Array]:
    """Choose base pose and tool targets from alignment or from circles.

    The choice is the start with which the nominal robot misses less.
    """
    pose, tool = aligned
    if circles.base is not None:
        pose = circles.base
        tool = tools_of(flange, pose, tool, which, points) if tool_unknown else tool
    if tool_unknown:
        tool = tool.copy()
        for t, place in circles.targets.items():
            tool[t] = place

    def miss(pose: Array, tool: Array) -> float:
        there = flange[:, :3, 3] + np.einsum("nij,nj->ni", flange[:, :3, :3], tool[which])
        return float(np.median(np.linalg.norm(points - there @ pose[:3, :3].T - pose[:3, 3], axis=1)))

    return (pose, tool) if miss(pose, tool) < miss(*aligned) else aligned


def _locate(
    dataset: Dataset,
    flange: Array,
    targets: dict[str, Vector],
    rows: NDArray[np.bool_],
    *,
    zero_unknown: bool,
) -> dict[str, Array]:
    """Locate base targets in the base frame of the nominal robot, mm.

    A base target is left out if the distances do not determine it.
    """
    conditions = dataset.conditions
    found = {}
    for a in np.unique(conditions.anchor[rows]):
        of = rows & (conditions.anchor == a)
        tool = np.array([targets[conditions.target_names[t]] for t in conditions.target[of]])
        points = flange[of, :3, 3] + np.einsum("nij,nj->ni", flange[of, :3, :3], tool)
        place = base_target(points, dataset.lengths[of], zero_unknown=zero_unknown)
        if place is not None:
            found[conditions.anchor_names[a]] = place
    return found


def _aligned(here: dict[str, Array], header: Header) -> Array:
    """Compute the base pose (4, 4) from base targets that were located in the robot's frame.

    The pose brings them to their known positions. For one or two targets it is one pose of many; the fit
    then drops the parameters that stay undetermined.
    """
    known = [name for name in here if name in header.base_targets]
    pose = np.eye(4)
    if known:
        nominal = np.array([here[name] for name in known])
        goal = np.array([header.base_targets[name] for name in known])
        pose[:3, :3], pose[:3, 3] = align(nominal, goal, np.ones(len(known)))
    return pose


def _uncertain(header: Header, names: Sequence[str]) -> dict[str, float | None]:
    """Base targets that are parameters: unknown (None), or known with an uncertainty in mm."""
    out: dict[str, float | None] = {}
    for name in names:
        if name not in header.base_targets:
            out[name] = None
        elif name in header.base_targets_u_mm:
            out[name] = header.base_targets_u_mm[name]
    return out


def _between(
    dataset: Dataset, targets: Mapping[str, Mapping[str, Vector]], measured_in: Sequence[Mapping[str, bool]]
) -> tuple[Span, ...]:
    """Find the distances between balls to which the arm is measured too.

    Distances between other balls have no information on the arm.
    """
    seen = dict(zip(targets, measured_in, strict=True)) | {"": dataset.conditions.anchor_names}
    return tuple(
        span
        for span in dataset.spans
        if span.series in seen and span.one in seen[span.series] and span.other in seen[span.series]
    )


def _declared(header: Header, *names: str) -> bool:
    """Test whether `hold` or `priors` of the header name one of these parameters.

    The nominal value is then kept, and no start takes its place.
    """
    said = [re.sub(r"\[.*\]", "", name) for name in (*header.hold, *header.priors)]
    return any(
        one == name or one.startswith(f"{name}.") or one[:-1] == name for one in said for name in names
    )


def _refuse_unknown(dataset: Dataset) -> None:
    """Refuse headers that hold or weigh a position that has no nominal value.

    In a free world this includes the pose of the base.
    """
    header = dataset.header
    free = [name for name in dataset.conditions.anchor_names if name not in header.base_targets]
    unknown = ("base", *free, "base_targets") if free else ("base",)
    if header.world == "nominal":
        unknown = unknown[1:]
    if _declared(header, *unknown):
        raise DataError(
            "belongs to a pose or position that the header leaves free, so it has no nominal value.",
            do='Set world = "nominal", give the position under [base_targets], or leave the name out.',
            file=dataset.path.with_suffix(".toml"),
            key="model.hold, model.priors",
        )


def _adapted(effects: tuple[Effect, ...], dataset: Dataset) -> tuple[Effect, ...]:
    header = dataset.header
    guessed = header.loads_estimated and any(effect.label == "compliance" for effect in effects)
    priors = {**({"compliance": base_model.OF_ESTIMATED_LOADS} if guessed else {}), **header.priors}
    if not header.hold and not priors:
        return effects
    try:
        return base_model.adapted(effects, header.hold, priors)
    except KeyError as error:
        names = ", ".join(p.name for e in effects for p in e.parameters)
        raise DataError(
            f"names {error.args[0]!r}, which the model does not have.",
            do=f"Its parameters are: {names}.",
            file=dataset.path.with_suffix(".toml"),
            key="model.hold" if error.args[0] in header.hold else "model.priors",
        ) from error


def place_nominal(
    dataset: Dataset, model: ModelStructure, robot: tuple[ModelStructure, Array] | None = None
) -> tuple[ModelStructure, Array]:
    """Fit only the base of the nominal robot, the tool if freed, and the base targets.

    Parameters
    ----------
    dataset : Dataset
        Readings; those of `fit_rows` are fitted.
    model : ModelStructure
        Base model of the data set.
    robot : (ModelStructure, array of shape (m,)), optional
        Effects and estimate of a calibrated robot, which is placed instead. They are held, and what is
        fitted is the same as for the nominal robot.

    Returns
    -------
    model : ModelStructure
    estimate : array
        Model and estimate for predictions.
    """
    of_place = tuple(e for e in model.effects if e.group == "base model" and e.places <= _OF_PLACE)
    placed = replace(model, effects=of_place)
    start = np.zeros(len(placed.parameters))
    readings = readings_of(dataset, dataset.fit_rows, placed, start)
    at = Linearisation(BoundModel(placed, readings.conditions), readings.observed.alone, start)
    active, dropped = find_dependent(at)
    if robot is not None:
        held, values = robot
        placed = replace(placed, effects=(*of_place, *held.effects))
        active, start = np.append(active, np.zeros(len(values), dtype=bool)), np.append(start, values)
        at = Linearisation(BoundModel(placed, readings.conditions), readings.observed.alone, start)
    for _ in range(2):
        at = solve(at, active, dropped, weights=robust.huber(at.residual, readings.observed.freedom)).at
    return placed, at.estimate

"""The base model of a data set in its place: what the header frees, with a start for what the world hides.

The start of every series is found from its own readings: the base pose by aligning the nominal robot with measured
points or with base targets located by distances, the tool frame by averaging. `place_nominal` then fits base and
tool alone: the nominal robot at its best, the yardstick of every report.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib import robust
from calib.dataset import Dataset
from calib.effects import base_model
from calib.effects.effect import Effect
from calib.errors import DataError
from calib.header import Header, Vector
from calib.kinematics import Array, forward
from calib.least_squares import find_dependent, solve
from calib.model import Design, RobotModel
from calib.readings import readings_of
from calib.start import align, base_and_tool, base_target, tool_turn

_OF_PLACE = ("base", "tool", "base_targets", "length_zero")


def base_model_of(dataset: Dataset, groups: Sequence[str] | None = None) -> RobotModel:
    """The model that the header frees (or `groups`), with a start for every series.

    Raises DataError when the header holds or weighs a parameter that the model does not have.
    """
    header, conditions = dataset.header, dataset.conditions
    groups = header.groups if groups is None else groups
    targets = {name: header.targets_of(name) for name in conditions.series_names}
    placements: dict[str, Array] = {}
    turns: dict[str, Array] = {}
    located: dict[str, Vector] = {}
    measured_in: list[dict[str, bool]] = []
    flange = forward(header.robot, conditions.joints)
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
            pose, tool = base_and_tool(
                flange[pointed],
                nominal,
                conditions.target[pointed],
                dataset.points[pointed],
                tool_unknown="tool" in groups,
            )
            placements[name] = pose
            if "tool" in groups:
                found: dict[str, Vector] = {
                    t: (float(x), float(y), float(z))
                    for t, (x, y, z) in zip(names, tool, strict=True)
                    if t in seen
                }
                targets[name] = {**targets[name], **found}
        turned = rows & dataset.turned
        if "tool" in groups and turned.any():
            pose = placements.get(name, np.eye(4))
            turns[name] = tool_turn(flange[turned], pose, dataset.orientation[turned])
        spanned = rows & dataset.spanned
        if spanned.any():
            here = _locate(dataset, flange, targets[name], spanned, zero_unknown="length_zero" in groups)
            if header.world == "free" and name not in placements:
                placements[name] = _aligned(here, header)
            pose = placements.get(name, np.eye(4))
            for anchor, place in here.items():
                x, y, z = pose[:3, :3] @ place + pose[:3, 3]
                located.setdefault(anchor, (float(x), float(y), float(z)))
    effects = base_model.build(
        groups,
        header.robot,
        conditions.series_names,
        measured_in,
        _uncertain(header, conditions.anchor_names),
    )
    return RobotModel(
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
    )


def _locate(
    dataset: Dataset,
    flange: Array,
    targets: dict[str, Vector],
    rows: NDArray[np.bool_],
    *,
    zero_unknown: bool,
) -> dict[str, Array]:
    """Base targets in the base frame of the nominal robot, mm, where the distances determine them."""
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
    """(4, 4) base pose that brings base targets located in the robot's frame to where they are known to stand."""
    known = [name for name in here if name in header.base_targets]
    pose = np.eye(4)
    if len(known) >= 3:
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
        elif header.base_targets_u_mm > 0.0:
            out[name] = header.base_targets_u_mm
    return out


def _adapted(effects: tuple[Effect, ...], dataset: Dataset) -> tuple[Effect, ...]:
    header = dataset.header
    if not header.hold and not header.priors:
        return effects
    try:
        return base_model.adapted(effects, header.hold, header.priors)
    except KeyError as error:
        names = ", ".join(p.name for e in effects for p in e.parameters)
        raise DataError(
            f"names {error.args[0]!r}, which the model does not have.",
            do=f"Its parameters are: {names}.",
            file=dataset.path.with_suffix(".toml"),
            key="model.hold" if error.args[0] in header.hold else "model.priors",
        ) from error


def place_nominal(dataset: Dataset, model: RobotModel) -> tuple[RobotModel, Array]:
    """The nominal robot in its place: base (and tool, where freed) fitted, nothing else. Returns model and estimate."""
    placed = replace(model, effects=tuple(e for e in model.effects if e.label.partition("[")[0] in _OF_PLACE))
    start = np.zeros(len(placed.parameters))
    readings = readings_of(dataset, dataset.fit_rows, placed, start)
    design = Design(placed, readings.conditions)
    active, _ = find_dependent(design, readings.observed, start)
    residual = readings.observed.residual(design.frames(start))
    for _ in range(2):
        weights = robust.huber(residual, readings.observed.freedom)
        solution = solve(design, readings.observed, start, active, weights)
        start, residual = solution.estimate, solution.residual
    return placed, start

"""The parameters of an identified model as rows.

Each row has the value, the nominal value, the standard error, and whether the parameter was dropped.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from calib.array import Array
from calib.data import Header
from calib.fit import IdentificationFit
from calib.model import EffectTerm, InSeries, ModelStructure, OnTarget, Regressor, ToAnchor
from calib.units import to_display, to_internal
from service.results.common import ParameterResponse


def rows_of(found: IdentificationFit, *, base_model_only: bool = False) -> list[ParameterResponse]:
    """List the parameters of a model in order, optionally without those of diagnosed effects.

    The absolute value of a base parameter is that of its pose in the world, with turns about x, y, z in that order.
    """
    dropped = {drop.name: drop.confounded_with for drop in found.dropped}
    errors = found.standard_errors
    absolute = absolutes(found.model, found.estimate, found.covariance)
    nominal = nominals(found.model, found.header)
    rows = []
    for effect in found.model.effects:
        if base_model_only and effect.group != "base model":
            continue
        for parameter in effect.parameters:
            position, unit, live = (
                found.model.index[parameter.name],
                parameter.unit,
                parameter.name not in dropped,
            )
            value, std = absolute[parameter.name] if live else (None, None)
            stated = nominal.get(parameter.name)
            rows.append(
                ParameterResponse(
                    name=parameter.name,
                    value=to_display(float(found.estimate[position]), unit) if live else None,
                    std=to_display(float(errors[position]), unit) if live else None,
                    unit=unit,
                    nominal=stated,
                    absolute=value,
                    absolute_std=std,
                    change_from_nominal=None if value is None or stated is None else value - stated,
                    owner=effect.owner,
                    dropped=not live,
                    confounded_with=list(dropped.get(parameter.name, ())),
                )
            )
    return rows


def absolutes(model: ModelStructure, estimate: Array, covariance: Array) -> dict[str, tuple[float, float]]:
    """Return the absolute value and standard error of each parameter by name, in display units.

    They do not depend on the start of the fit. `estimate` (m,) and `covariance` (m, m) are in internal units.
    """
    value, std = estimate.astype(np.float64), np.sqrt(np.diag(covariance))
    for i, start, slots in _starts(model):
        value[i], change = _moved(start, slots, estimate[i])
        std[i] = np.sqrt(np.einsum("ab,bc,ac->a", change, covariance[np.ix_(i, i)], change))
    for i, p in enumerate(model.parameters):
        value[i] += to_internal(_of_link(model, p.name) or 0.0, p.unit)
    return {
        p.name: (to_display(float(v), p.unit), to_display(float(s), p.unit))
        for p, v, s in zip(model.parameters, value, std, strict=True)
    }


def nominals(model: ModelStructure, header: Header | None) -> dict[str, float]:
    """Return the nominal value of each parameter by name, in display units.

    Parameters without a known nominal value are left out.

    Parameters
    ----------
    header : Header or None
        Header of the data set. It states the targets and, if the world frame is nominal, the base. None if it is
        unknown.
    """
    found = {p.name: x for p in model.parameters if (x := _of_link(model, p.name)) is not None}
    for term in _mounting(model):
        of, axis = term.regressor, term.slot.partition(".")[2]
        if header is None:
            continue
        if term.slot.startswith("base.") and header.world == "nominal":
            found[term.parameter] = 0.0
        stated = None
        if isinstance(of, OnTarget):
            stated = header.targets_of(of.series).get(of.target)
        elif isinstance(of, ToAnchor):
            stated = header.base_targets.get(of.anchor)
        if stated is not None and axis in _XYZ:
            found[term.parameter] = stated[_XYZ.index(axis)]
    return found


_XYZ = "xyz"
Start = tuple[Array, Array, Array]
"""From where the parameters of a frame count: translation (3,), the axes (3, 3) of theirs, orientation (3, 3)."""


def _mounting(model: ModelStructure) -> Iterator[EffectTerm]:
    """Yield the terms of the parameters that place base, tool targets and base targets."""
    for effect in model.effects:
        if effect.group == "base model" and effect.owner == "mounting":
            yield from effect.terms


def _starts(model: ModelStructure) -> Iterator[tuple[list[int], Start, list[str]]]:
    """Yield the positions of the parameters, the start and the slots of each frame.

    The frames are the base, the tool targets and the base targets.
    """
    eye, zero = np.eye(3), np.zeros(3)
    bodies: dict[Regressor, list[EffectTerm]] = {}
    for term in _mounting(model):
        bodies.setdefault(term.regressor, []).append(term)
    for of, terms in bodies.items():
        if isinstance(of, OnTarget):
            start = np.array(model.targets[of.series][of.target]), eye, model.turns.get(of.series, eye)
        elif isinstance(of, ToAnchor):
            start = np.array(model.anchors.get(of.anchor, zero)), eye, eye
        else:
            series = of.series if isinstance(of, InSeries) else next(iter(model.targets))
            pose = model.placements.get(series, np.eye(4))
            # Nubiola counts the turns of the base behind d_1, which therefore does not turn with the start
            raised = (pose[:3, :3] - eye)[:, 2] * (model.robot.d[0] if model.robot.base == "thesis" else 0.0)
            start = pose[:3, 3] + raised, pose[:3, :3], pose[:3, :3]
        yield [model.index[t.parameter] for t in terms], start, [t.slot.partition(".")[2] for t in terms]


def _moved(start: Start, slots: Sequence[str], estimate: Array) -> tuple[Array, Array]:
    """Return the absolute parameters of a frame at their estimate, with their derivative.

    The estimate and the absolute values have the shape (p,), and the derivative of the values by the estimate (p,
    p). Rotations are about x, y, z in that order.
    """
    place, axes, turned = start

    def absolute(values: Array) -> Array:
        of = dict(zip(slots, values, strict=True))
        moved = place + axes @ np.array([of.get(axis, 0.0) for axis in _XYZ])
        turns = turned @ Rotation.from_euler("XYZ", [of.get(f"r{axis}", 0.0) for axis in _XYZ]).as_matrix()
        angles = Rotation.from_matrix(turns).as_euler("XYZ")
        return np.array([angles[_XYZ.index(s[1])] if s[0] == "r" else moved[_XYZ.index(s)] for s in slots])

    step = 1e-6
    columns = [
        (absolute(estimate + h) - absolute(estimate - h)) / (2.0 * step) for h in step * np.eye(len(slots))
    ]
    return absolute(estimate), np.column_stack(columns)


_STRONG = 0.9
_HIGH = 3.0  # times the mean


def strong_correlations(found: IdentificationFit) -> list[tuple[str, str, float]]:
    """List pairs of parameters with |r| above 0.9, strongest first.

    The readings hardly distinguish the two parameters of such a pair.
    """
    correlations = np.nan_to_num(np.triu(found.correlations, k=1))
    pairs = np.argwhere(np.abs(correlations) > _STRONG)
    names = [p.name for p in found.model.parameters]
    strong = [(names[i], names[j], float(correlations[i, j])) for i, j in pairs]
    return sorted(strong, key=lambda pair: -abs(pair[2]))


def high_leverage(found: IdentificationFit) -> list[tuple[int, float]]:
    """Find the rows of the data set with high leverage.

    Leverage is high if it exceeds three times the mean. The result is a list of (row index, hat value), highest
    first.
    """
    leverage = found.leverage
    high = np.flatnonzero(leverage > _HIGH * leverage.mean())
    order = high[np.argsort(-leverage[high])]
    return [(int(found.readings.rows[i]), float(leverage[i])) for i in order]


def _of_link(model: ModelStructure, name: str) -> float | None:
    """Return the nominal value of a parameter of a link, in display units; None for others."""
    robot = model.robot
    kind, number = name.rstrip("0123456789"), name[len(name.rstrip("0123456789")) :]
    if not number:
        return None
    link = int(number) - 1
    if kind in ("alpha", "theta"):
        return to_display(getattr(robot, kind)[link], "deg")
    if kind in ("a", "d"):
        return getattr(robot, kind)[link]
    return 0.0 if kind in ("beta", "c") else None

"""Numeric readings for tests of the fit alone: no arm, no chain, a stated prediction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from calib.array import Array
from calib.fit.least_squares import Linearisation
from calib.model.model import BoundModel
from calib.model.observations import Observations


def parameter(name: str, size: float | None = None, *, measured: bool = False, base: bool = True) -> Any:
    """Build a parameter whose internal unit is that of its size.

    If `base`, it belongs to the base model, otherwise to an effect.
    """
    return SimpleNamespace(name=name, size=size, measured=measured, base=base)


def toy_model(parameters: Sequence[Any], **of: Any) -> Any:
    """Build the parts of a model that the fit uses; `of` gives spans and anchors."""
    effects = [
        SimpleNamespace(group="base model" if p.base else "joints", parameters=[p]) for p in parameters
    ]
    return SimpleNamespace(
        parameters=tuple(parameters),
        effects=effects,
        index={p.name: k for k, p in enumerate(parameters)},
        prior_mean=np.zeros(len(parameters)),
        prior_std=np.array([np.inf if p.size is None else p.size for p in parameters]),
        unit=np.ones(len(parameters)),
        measured=np.array([p.measured for p in parameters]),
        **{"spans": (), "targets": {}, "anchors": {}, **of},
    )


def toy(
    model: Any,
    measured: Array,
    predicted: Callable[[Array], Array],
    derivative: Callable[[Array], Array],
    estimate: Array,
    freedom: Sequence[int] | None = None,
) -> Linearisation:
    """Build readings (k, n) with their prediction.

    `derivative` (k n, m) is the one that the fit uses, right or wrong.
    """
    n = measured.shape[1]
    count = np.arange(n)
    observed = SimpleNamespace(
        shared=None,
        freedom=np.array([len(measured)] * n if freedom is None else freedom),
        residual=lambda at: measured - predicted(at).reshape(measured.shape),
        columns=lambda at, _slots: derivative(at),
    )
    design = SimpleNamespace(
        model=model,
        slots=(),
        frames=lambda at, _slots: at,
        columns=lambda columns: columns,
        conditions=SimpleNamespace(
            pose=count, joints=count[:, None] * 1.0, target=0 * count, anchor=0 * count, series=0 * count
        ),
    )
    return Linearisation(cast(BoundModel, design), cast(Observations, observed), estimate)


def linear(model: Any, matrix: Array, measured: Array, estimate: Array | None = None) -> Linearisation:
    """Build readings (k, n) whose prediction is matrix (k n, m) times the estimate.

    The start is 0 if no estimate is given.
    """
    start = np.zeros(matrix.shape[1]) if estimate is None else estimate
    return toy(model, measured, lambda at: matrix @ at, lambda _at: matrix, start)


def columns_of(model: Any, matrix: Array) -> Linearisation:
    """Build one reading per row of a matrix (n, m); the measured values do not matter."""
    return linear(model, matrix, np.zeros((1, len(matrix))))

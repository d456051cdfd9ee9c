"""Regression in a model file: its choices, training joint angles and weights."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from calib.arm.robot import Robot
from calib.errors import DataError
from calib.regression.mls_svr import Gaussian, Kernel, Linear, MlsSvr
from calib.regression.regression import Regression, RegressionRequest, evaluate, products_of
from calib.saved.model_checks import numbers_of
from calib.text.toml_table import FARTHEST_MM

METHOD = "mls-svr"
_FEWEST = 2
_MOST_TURN = 100.0  # rad
_MOST = 1e12  # limit of a weight or a mean: far above any, and its products do not overflow


def document_of(regression: Regression) -> dict[str, Any]:
    """Build the table `regression` of a model file.

    The weights of a linear kernel act on features. Those of a Gaussian kernel act on the kernel with the features of
    `trained_at_rad`.
    """
    svr = regression.svr
    return {
        "method": METHOD,
        "on": regression.wanted.on,
        "features": regression.wanted.features,
        "kernel": regression.wanted.kernel,
        "width": svr.kernel.width if isinstance(svr.kernel, Gaussian) else None,
        "gamma": svr.gamma,
        "lambda": svr.share,
        "target_mm": list(regression.target),
        "left_out_rms_mm": regression.rms,
        "mean": svr.mean.tolist(),
        "weights": svr.weights.tolist(),
        "offset_mm": svr.offset.tolist(),
        "trained_at_rad": regression.joints.tolist(),
    }


def regression_of(table: Mapping[str, Any], robot: Robot, path: Path) -> Regression:
    """Read the regression of a table.

    Raises
    ------
    DataError
        A value is invalid; the message names file and key.
    KeyError
        A key is missing.
    """

    def number(key: str, least: float) -> float:
        value = float(numbers_of(table[key], (), f"regression.{key}", path))
        if value < least:
            raise _refused(f"is {value!r}.", key, path)
        return value

    if table["method"] != METHOD:
        raise _refused(f"is {table['method']!r}.", "method", path)
    try:
        wanted = RegressionRequest.of(table["on"], table["features"], table["kernel"])
        products = products_of(wanted.features, robot)
    except DataError as error:
        raise _refused(error.what, (error.key or "").lstrip("-"), path) from error
    count = len(table["trained_at_rad"])
    if count < _FEWEST:
        raise _refused("holds too few samples.", "trained_at_rad", path)
    joints = numbers_of(
        table["trained_at_rad"], (count, robot.joints), "regression.trained_at_rad", path, _MOST_TURN
    )
    kernel: Kernel = Linear() if wanted.kernel == "linear" else Gaussian(number("width", 1e-9))
    columns = len(products) if wanted.kernel == "linear" else count
    x, y, z = numbers_of(table["target_mm"], (3,), "regression.target_mm", path, FARTHEST_MM)
    svr = MlsSvr(
        kernel,
        number("gamma", 0.0),
        number("lambda", 0.0),
        evaluate(products, joints),
        numbers_of(table["mean"], (columns,), "regression.mean", path, _MOST),
        numbers_of(table["weights"], (columns, 3), "regression.weights", path, _MOST),
        numbers_of(table["offset_mm"], (3,), "regression.offset_mm", path, FARTHEST_MM),
    )
    return Regression(wanted, (float(x), float(y), float(z)), joints, svr, number("left_out_rms_mm", 0.0))


def refuse_unlikely_shift(regression: Regression, robot: Robot, most_mm: float, path: Path) -> None:
    """Refuse a regression that shifts the point by more than `most_mm` at its training angles."""
    shift = float(np.linalg.norm(regression.shift(robot, regression.joints), axis=1).max())
    if not shift <= most_mm:
        raise DataError(
            f"shifts the point by up to {shift:.1f} mm at the angles that it was trained at, more than {most_mm:g} mm.",
            do="Use a model of this robot as it was written. If the robot is really that far off, allow more: "
            "--largest-correction DEG MM, over HTTP largest_mm.",
            file=path,
            key="regression",
        )


def _refused(what: str, key: str, path: Path) -> DataError:
    return DataError(
        what, do="Write the model again with 'truepose regress'.", file=path, key=f"regression.{key}"
    )

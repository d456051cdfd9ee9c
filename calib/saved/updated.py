"""A model file with updated parameters: the old file with a few new values and their origin.

What was not looked at again (data, conditions, held-out error, regression) stays as it was; `updates` says what is
newer, oldest first; `measured` is that of the readings it was updated by.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from calib.array import Array
from calib.model.model import RobotModel
from calib.saved.document import parameters_of, triangle
from calib.saved.model_checks import content_hash
from calib.text.files import replace_file
from calib.text.json_text import read_json
from calib.text.program import written_by


def save_update(
    path: Path,
    baseline: Path,
    model: RobotModel,
    estimate: Array,
    covariance: Array,
    update: Mapping[str, Any],
) -> None:
    """Write the model of `baseline` with another estimate (m,) and covariance (m, m), internal units.

    model: the baseline's, with an effect more or none. update: plain values that say what changed and by which
    readings. Raises DataError where the baseline cannot be read, OSError.
    """
    old = read_json(baseline)
    document = {
        **old,
        "program": written_by(),
        **({"measured": {"began": began, "ended": began}} if (began := update.get("measured")) else {}),
        "parameters": parameters_of(model, estimate, np.sqrt(np.diag(covariance))),
        "effects": [effect.to_json() for effect in model.effects],
        "covariance_internal_units": triangle(covariance),
        "updates": [*old.get("updates", []), {**update, "baseline_sha256": old.get("content_sha256", "")}],
    }
    document["content_sha256"] = content_hash(document)
    replace_file(path, json.dumps(document, indent=1, allow_nan=False) + "\n")

"""A kept diagnosis in which a figure is none."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from calib.data import read_dataset
from calib.diagnose import diagnose
from fleet.diagnose.statement import of_diagnosis
from tests.fleet.diagnose.sets import good


def test_what_is_no_number_is_null(tmp_path: Path) -> None:
    found = diagnose(read_dataset(good(tmp_path, "a")), most=1)
    assert found.error_after is not None
    odd = replace(found, error_after=replace(found.error_after, p95=float("nan"), max=float("inf")))
    kept = json.loads(json.dumps(of_diagnosis("a", odd), allow_nan=False))["error_after_mm"]
    assert (kept["p95"], kept["max"]) == (None, None)
    assert kept["rms"] > 0.0

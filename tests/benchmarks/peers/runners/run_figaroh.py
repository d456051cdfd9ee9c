"""Runner of figaroh: its structural method, with the documented and the plainest cost.

The choice of the identifiable parameters and the optimisation are timed, but not its statistics, nor its report.
"""
# pyright: reportMissingImports=false

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from case import Case, Predict, answer_cases
from figaroh_arm import Documented, Plain, calibration_of, predict


def solver(kind: type[Any]) -> Callable[[Case], Callable[[], Predict]]:
    """Return a solver that uses one of the cost functions."""

    def prepare(case: Case) -> Callable[[], Predict]:
        with tempfile.TemporaryDirectory() as folder:
            calibration = calibration_of(case, kind, Path(folder))

        def solve() -> Predict:
            calibration.create_param_list()
            found, _ = calibration.solve_optimisation()
            return lambda joints: predict(calibration, found.x, joints)

        return solve

    return prepare


if __name__ == "__main__":
    answer_cases(
        {"documented": solver(Documented), "plain cost": solver(Plain)},
        ("figaroh", "pin", "scipy", "numpy"),
    )

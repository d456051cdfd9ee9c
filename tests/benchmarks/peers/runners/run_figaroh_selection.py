"""Runner of figaroh's Detmax: select candidate poses of a case by its information matrices.

It also writes ROWS.npz, next to the answer, with the rows (N, 3, m) of its regressor, from which those matrices
come.
"""
# pyright: reportMissingImports=false

from __future__ import annotations

import random
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from case import Case, write
from figaroh.calibration.calibration_tools import calculate_base_kinematics_regressor
from figaroh.optimal.base_optimal_calibration import Detmax
from figaroh_arm import Plain, calibration_of

CHOSEN = 50


def main() -> None:
    """Select from the candidates of every case on the command line."""
    answers = []
    for path in sys.argv[2:]:
        case = Case.read(path)
        with tempfile.TemporaryDirectory() as folder:
            calibration = calibration_of(case, Plain, Path(folder))
        _, regressor, *_ = calculate_base_kinematics_regressor(
            calibration.q_measured, calibration.model, calibration.data, calibration.calib_config
        )
        rows = regressor.reshape(3, len(case.joints), -1).transpose(1, 0, 2)
        np.savez(Path(sys.argv[1]).with_name(f"{case.name}-rows.npz"), rows=rows)
        pool = {i: each.T @ each for i, each in enumerate(rows)}
        random.seed(1)
        begin = time.process_time()
        history = Detmax(pool, CHOSEN).main_algo()
        seconds = time.process_time() - begin
        # its criterion is det^(1/m)
        log_det = rows.shape[2] * float(np.log(history[-1]))
        answers.append({"case": case.name, "seconds": seconds, "log_det": log_det})
    write({"answers": answers})


if __name__ == "__main__":
    main()

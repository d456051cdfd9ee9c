"""Benchmark of the selection of 50 of N poses against figaroh's Detmax.

Both use the information matrices of figaroh's own regressor. Our log det must be as high or higher, in a thirtieth
of the time or less.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from calib.selection.exchange import select
from tests.benchmarks.clock import line
from tests.benchmarks.peers.arm import Arm, Array, measure
from tests.benchmarks.peers.environment import PEERS, Absent
from tests.benchmarks.peers.identification import case_of
from tests.benchmarks.peers.runners.case import timed

CANDIDATES, CHOSEN = (1000, 5000), 50
WANTED = 30.0
EQUAL = 1e-6  # of log det: rounding


def log_det(rows: Array) -> float:
    """Log-determinant of the information of poses, shape (n, k, m)."""
    flat = rows.reshape(-1, rows.shape[2])
    return float(np.linalg.slogdet(flat.T @ flat)[1])


def run() -> bool:
    """Print time and log det for every number of candidates."""
    reached = True
    figaroh = next(peer for peer in PEERS if peer.name == "figaroh")
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{count}.npz" for count in CANDIDATES]
        for path, count in zip(paths, CANDIDATES, strict=True):
            case_of(path.stem, measure(Arm(), count, 11)).write(path)
        try:
            document = figaroh.answer("run_figaroh_selection.py", paths, Path(folder) / "answer.json")
        except Absent as error:
            line(f"figaroh Detmax: {error}", "absent", f">= {WANTED:g}", False)
            return False
        for answer in document["answers"]:
            with np.load(Path(folder) / f"{answer['case']}-rows.npz") as file:
                rows = file["rows"]
            seconds, chosen = timed(lambda: lambda: select(rows, CHOSEN))  # noqa: B023
            ratio, gained = answer["seconds"] / seconds, log_det(rows[chosen]) - answer["log_det"]
            name = f"{CHOSEN} of {answer['case']} poses"
            line(
                f"{name}: Detmax {answer['seconds']:.1f} s, ours {seconds:.3f} s",
                f"{ratio:.0f} x",
                f">= {WANTED:g}",
                ratio >= WANTED,
            )
            line(
                f"{name}: log det, Detmax {answer['log_det']:.3f}, ours {log_det(rows[chosen]):.3f}",
                f"{gained:+.3f}",
                ">= 0",
                gained >= -EQUAL,
            )
            reached &= ratio >= WANTED and gained >= -EQUAL
    return reached

"""A measured UR10: the error left on readings that took no part, of the same night and of four months later.

Three data sets from the series that Fraunhofer IPA published (night A, 11,911 poses; B, 1,495, four months later): A
with a random fifth held out, A with whole stretches of time held out, and A with fifty poses of B in one data set of
two series, judged on the rest of B. Each is diagnosed in a process of its own, for its memory. The files are looked for
in the folder that UR10_DATA names, or else in a usual place beside the repository.
"""

from __future__ import annotations

import os
import resource
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from calib.convert.ipa_ur10 import read
from calib.convert.table import Table
from calib.data.read import read_dataset
from calib.diagnose.diagnosis import diagnose
from tests.benchmarks.clock import line

DATA = Path(
    os.environ.get("UR10_DATA", Path(__file__).resolve().parents[3] / "shared" / "data" / "ur10_leica")
)
OF_B = 50  # poses of B that take part
RANDOM, BLOCKS, OTHER_SERIES = 0.075, 0.106, 0.22  # mm RMS
MEMORY_GB = 0.6


def two_series(a: Table, b: Table) -> Table:
    """All of A and OF_B poses of B, spread over it, to be fitted; the rest of B to be predicted."""
    taken = set(np.linspace(0, len(b) - 1, OF_B).round().astype(int).tolist())
    sets = ["calibration"] * len(a) + ["calibration" if i in taken else "validation" for i in range(len(b))]
    columns = {name: [*cells, *b.columns[name]] for name, cells in a.columns.items()}
    columns["reading_id"] = [f"A{i}" for i in a.columns["reading_id"]] + [
        f"B{i}" for i in b.columns["reading_id"]
    ]
    columns |= {"set": sets, "series": ["A"] * len(a) + ["B"] * len(b)}
    return replace(a, columns=columns)


def judged(path: Path) -> tuple[float, float, int, float, float]:
    """Held-out error before and after, mm RMS, effects found, seconds of processor time and GB of memory."""
    dataset = read_dataset(path)
    begin = time.process_time()
    result = diagnose(dataset)
    spent = time.process_time() - begin
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    before, after = result.error_before, result.error_after
    if before is None or after is None:
        raise ValueError(f"{path}: nothing is held out")
    return before.rms, after.rms, len(result.effects), spent, memory


def run() -> bool:
    """Print errors, processor time and memory of the three sets."""
    if not (DATA / "series_A.csv").is_file():
        print(f"no measured UR10 in {DATA}: name its folder in UR10_DATA")
        return False
    a, b = read(DATA / "series_A.csv"), read(DATA / "series_B.csv")
    sets = {
        "A, random fifth held out": (a.hold_out("random", 0.2, 1), RANDOM),
        "A, stretches of time held out": (a.hold_out("block", 0.2, 1), BLOCKS),
        f"A and {OF_B} poses of B, rest of B": (two_series(a, b), OTHER_SERIES),
    }
    reached = True
    with tempfile.TemporaryDirectory() as folder:
        for number, (name, (table, wanted)) in enumerate(sets.items()):
            path = Path(folder) / f"set{number}.csv"
            table.write(path)
            with ProcessPoolExecutor(1, get_context("spawn")) as alone:
                before, after, effects, spent, memory = alone.submit(judged, path).result()
            print(f"  {effects} effects, {spent:.0f} s of processor time, {memory:.2f} GB")
            line(f"{name}: {before:.3f} ->", f"{after:.3f} mm", f"<= {wanted:.3f}", after <= wanted)
            reached &= after <= wanted and memory <= MEMORY_GB
    return reached

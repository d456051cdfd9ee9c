"""Held-out position errors of every data set in `shared`, compared with entered values.

    python -m tests.benchmarks real_data [NAME ...] [--enter]

One line for each set: the nominal robot in its place, the base model, the model with named effects, and the whole
model, mm RMS on held-out rows, and a yardstick. Results entered before are in `real_data.json`; `--enter` replaces
those of the sets that ran. The run fails if a result is more than 2 % worse than the entered one. Each set runs in
a separate process, for its memory. SHARED_DATA names the folder if it is not next to the repository.
"""

from __future__ import annotations

import json
import os
import resource
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from calib.convert.ipa_ur10 import read
from calib.convert.table import ConvertedTable
from calib.data.read import read_dataset
from calib.diagnose.diagnosis import carry_over, diagnose
from calib.errors import DataError
from calib.fit.statistics import ErrorStatistics

SHARED = Path(os.environ.get("SHARED_DATA", Path(__file__).resolve().parents[3] / "shared"))
DATA = SHARED / "data" / "ur10_leica"
ENTERED = Path(__file__).with_suffix(".json")
OF_B = 50  # poses of B that take part
WORSE = 0.02  # share by which a figure may exceed the entered one
MEMORY_GB = 1.0
_TO_B = "ur10_a_to_b"

YARDSTICKS: Mapping[str, float] = {
    "ur10_a_random": 0.075,
    "ur10_a_blocks": 0.181,
    "ur10_b_random": 0.135,
    "ur10_b_blocks": 0.111,
    "ur10_b_carried": 0.275,
    _TO_B: 0.41,
    f"{_TO_B}_refitted": 0.25,
    "fanuc_r2000": 0.276,
    "franka_pos": 1.273,
    "franka_pose": 1.273,
    "p3": 0.139,
    "p3b": 0.176,
    "panda_1_with_sensor": 0.199,
    "k14": 0.124,
    "surface": 0.030,
    "g_9_step": 0.0487,
    "g_2_ramp": 0.0495,
    "f_couple56_ur": 0.0470,
    "F5_tooth_bump_j3_0": 0.0334,
    "f_swapped_kr": 39.95,
}
"""The best that `shared/tools/carried.py` reached from the base or after the names; for `ur10_a_to_b` the sinusoids of
the data's README. `ur10_a_to_b` leaves the robot as series A shows it and fits base and tool to B."""


@dataclass(frozen=True)
class Figures:
    """Held-out errors of one set, mm RMS, and its cost.

    An error is None if nothing was placed or fitted.
    """

    nominal: float | None
    base: float | None
    named: float | None
    carried: float | None
    verdict: str
    effects: int
    terms: int
    seconds: float
    memory_gb: float

    @property
    def judged(self) -> dict[str, float]:
        """The figures that are entered, in the order in which they are printed."""
        named = {"base": self.base, "named": self.named, "carried": self.carried}
        return {name: figure for name, figure in named.items() if figure is not None}


def two_series(a: ConvertedTable, b: ConvertedTable) -> ConvertedTable:
    """All of A and OF_B poses of B, spread over it, to be fitted; the rest of B to be predicted."""
    taken = set(np.linspace(0, len(b) - 1, OF_B).round().astype(int).tolist())
    sets = ["calibration"] * len(a) + ["calibration" if i in taken else "validation" for i in range(len(b))]
    columns = {name: [*cells, *b.columns[name]] for name, cells in a.columns.items()}
    columns["reading_id"] = [f"A{i}" for i in a.columns["reading_id"]] + [
        f"B{i}" for i in b.columns["reading_id"]
    ]
    columns |= {"set": sets, "series": ["A"] * len(a) + ["B"] * len(b)}
    return replace(a, columns=columns)


def _of_ur10() -> Mapping[str, Callable[[], ConvertedTable]]:
    def a() -> ConvertedTable:
        return read(DATA / "series_A.csv")

    def b() -> ConvertedTable:
        return read(DATA / "series_B.csv")

    return {
        "ur10_a_random": lambda: a().hold_out("random", 0.2, 1),
        "ur10_a_blocks": lambda: a().hold_out("block", 0.2, 1),
        "ur10_b_random": lambda: b().hold_out("random", 0.2, 1),
        "ur10_b_blocks": lambda: b().hold_out("block", 0.2, 1),
        "ur10_b_carried": lambda: two_series(a(), b()),
    }


def measured(name: str) -> dict[str, Figures]:
    """Diagnose one set, and judge on series B what series A shows if the set is `ur10_a_random`."""
    tables = _of_ur10()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.csv"
        if name in tables:
            tables[name]().write(path)
        else:
            path = _file_of(name)
        dataset = read_dataset(path)
        begin = time.process_time()
        try:
            found = diagnose(dataset)
        except DataError as error:
            print(f"  {error}", flush=True)
            return {name: Figures(None, None, None, None, "refused", 0, 0, time.process_time() - begin, 0.0)}
        spent = time.process_time() - begin
        added = [e for e in found.final.model.effects if e.group != "base model"]
        carried = sum(e.is_carried for e in added)
        whole = Figures(
            nominal=_rms(found.error_nominal),
            base=_rms(found.error_before),
            named=_rms(found.error_named),
            carried=_rms(found.error_after),
            verdict=found.verdict,
            effects=len(added) - carried,
            terms=carried,
            seconds=spent,
            memory_gb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
        )
        if name != "ur10_a_random":
            return {name: whole}
        path = Path(folder) / "b.csv"
        tables["ur10_b_random"]().write(path)
        kept = carry_over(found, read_dataset(path))
    base = _rms(kept.base)
    return {name: whole} | {
        line: replace(whole, nominal=None, base=base, named=_rms(error), carried=_rms(error))
        for line, error in ((_TO_B, kept.frozen), (f"{_TO_B}_refitted", kept.refitted))
    }


def _rms(errors: ErrorStatistics | None) -> float | None:
    return None if errors is None else errors.rms


def _file_of(name: str) -> Path:
    return next(SHARED.glob(f"*/*/{name}.csv"), SHARED / f"{name}.csv")


def _process_of(names: Iterable[str]) -> list[str]:
    """The sets to be diagnosed for these lines, each once."""
    return list(dict.fromkeys("ur10_a_random" if name.startswith(_TO_B) else name for name in names))


def run(names: Iterable[str] = (), *, enter: bool = False) -> bool:
    """Print the results of some sets, or of all if none is named.

    Return False if one is worse than entered, or is missing.
    """
    unknown = [name for name in names if name not in YARDSTICKS]
    if unknown:
        print(f"no set {', '.join(unknown)}; there are {', '.join(YARDSTICKS)}")
        return False
    entered: dict[str, dict[str, float]] = json.loads(ENTERED.read_text()) if ENTERED.is_file() else {}
    columns = ("nominal", "base", "named", "carried", "yardst.", "entered", "change")
    print(f"{'set':<22}" + "".join(f"{column:>9}" for column in columns) + "  verdict")
    reached = True
    for name in _process_of(names or YARDSTICKS):
        there = DATA / "series_A.csv" if name in _of_ur10() else _file_of(name)
        if not there.is_file():
            print(f"{name:<22} data absent: {there} (name the folder in SHARED_DATA)")
            reached = False
            continue
        with ProcessPoolExecutor(1, get_context("spawn")) as alone:
            lines = alone.submit(measured, name).result()
        for line, figures in lines.items():
            reached &= kept(line, figures, entered.get(line, {}))
            if enter:
                entered[line] = {key: round(figure, 5) for key, figure in figures.judged.items()}
    if enter:
        ordered = {name: entered[name] for name in YARDSTICKS if name in entered}
        ENTERED.write_text(json.dumps(ordered, indent=1) + "\n")
    return reached


def kept(name: str, figures: Figures, before: Mapping[str, float]) -> bool:
    """Print one line. False if a figure is worse than `before`, or missing, or if memory is exceeded."""
    now = figures.judged
    worse = [key for key, old in before.items() if now.get(key, np.inf) > old * (1.0 + WORSE)]
    last, yardstick = before.get("carried"), YARDSTICKS[name]
    change = "-" if last is None or figures.carried is None else f"{figures.carried / last - 1.0:+.1%}"
    cells = [figures.nominal, figures.base, figures.named, figures.carried, yardstick, last]
    row = "".join("        -" if x is None else f"{x:9.4f}" for x in cells)
    print(
        f"{name:<22}{row}{change:>9}  {figures.verdict}, {figures.effects} effects, {figures.terms} carried terms, "
        f"{figures.seconds:.1f} s, {figures.memory_gb:.2f} GB"
        + (f"  WORSE: {', '.join(worse)}" if worse else ""),
        flush=True,
    )
    if figures.memory_gb > MEMORY_GB:
        print(f"  MISSED: {figures.memory_gb:.2f} GB, at most {MEMORY_GB:g} GB")
    return not worse and figures.memory_gb <= MEMORY_GB

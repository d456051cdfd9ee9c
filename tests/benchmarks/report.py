"""The report of the measured UR10: processor time to draw it, and its size.

Night A with a random fifth held out, as in `real_data`. The shortest of some tries: what else runs on the machine
lengthens processor time, too.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from calib import read_dataset, save_model
from calib.convert.ipa_ur10 import read
from calib.diagnose import diagnose
from service.gc_pause import left_alone
from service.report import diagnosis_report
from service.results.models.diagnosed import DiagnosisOutcome
from tests.benchmarks.clock import line
from tests.benchmarks.real_data import DATA

TRIES = 3
SECONDS, MEGABYTES = 5.0, 3.0


def run() -> bool:
    """Print both; True where it is drawn soon enough and small enough."""
    if not (DATA / "series_A.csv").is_file():
        print(f"no measured UR10 in {DATA}: name its folder in UR10_DATA")
        return False
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.csv"
        read(DATA / "series_A.csv").hold_out("random", 0.2, 1).write(path)
        found = diagnose(read_dataset(path))
        sealed = save_model(Path(folder) / "m.json", found.final, found)
    document, spent, page = DiagnosisOutcome(found).document(), [], ""
    for _ in range(TRIES):
        begin = time.process_time()
        with left_alone():
            page = diagnosis_report(found, document, model_sha256=sealed)
        spent.append(time.process_time() - begin)
    size = len(page.encode()) / 1e6
    line(
        f"report of {len(found.effects)} effects, processor time",
        f"{min(spent):.1f} s",
        f"< {SECONDS:g} s",
        min(spent) < SECONDS,
    )
    line("its size", f"{size:.1f} MB", f"< {MEGABYTES:g} MB", size < MEGABYTES)
    return min(spent) < SECONDS and size < MEGABYTES

"""Predicted points of the validation rows for `--predictions P.csv`.

Each row is predicted with and without the diagnosed effects.
"""

from __future__ import annotations

import csv
import io

from calib.diagnose import DiagnosisFit
from calib.text import no_formula

COLUMNS = ("reading_id", "x_mm", "y_mm", "z_mm", "x_base_mm", "y_base_mm", "z_base_mm")


def predictions_csv(diagnosis: DiagnosisFit) -> str:
    """Write one CSV line per validation row, measured or not, in the order of the data set.

    Points are in mm, in the world frame. A column `simulated` is added if the readings come from simulators.
    """
    dataset = diagnosis.dataset
    rows = dataset.sets == "validation"
    conditions = dataset.conditions.take(rows)
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    simulated = dataset.header.simulated
    writer.writerow((*COLUMNS, "simulated") if simulated else COLUMNS)
    if rows.any():
        ids = [name for name, held in zip(dataset.reading_id, rows, strict=True) if held]
        after, before = diagnosis.final.predict(conditions), diagnosis.base.predict(conditions)
        for name, with_effects, without in zip(ids, after, before, strict=True):
            line = [no_formula(name), *(f"{x:.6f}" for x in (*with_effects, *without))]
            writer.writerow([*line, "yes"] if simulated else line)
    return text.getvalue()

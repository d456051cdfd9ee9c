"""History of three robots over two years: calibrations and watches by simulated readings.

It has the form in which a cell writes it. One robot moved its base and wears, one did not change, and one lost the
zero of a joint and was calibrated again.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import tomli_w

from calib import load_model, read_dataset, save_model
from calib.diagnose import diagnose
from calib.text import parse_toml
from mocks.campaign import make_campaign, write_campaign
from service.files import as_json
from service.results.models.diagnosed import DiagnosisOutcome
from service.results.shape import document_of
from service.results.watched import WatchRequest, watch_result
from tests.service.campaigns import Rows, edit_rows

FIT, JUDGED, CHECKED = 70, 30, 12  # readings of a calibration, held out, of a watch


@dataclass(frozen=True)
class Life:
    """History of one robot.

    `days` holds None for a calibration, and for a watch the differences by that day: of the points (mm along y) and of
    joint 4 (deg).
    """

    serial: str
    seed: int
    effects: tuple[str, ...]
    days: Sequence[tuple[str, tuple[float, float] | None]]


LIVES = (
    Life("120-500321", 4, ("backlash:j4",), [
        ("2025-01-14", None), ("2025-04-08", (0.0, 0.0)), ("2025-07-02", (0.01, 0.0)), ("2025-10-06", (0.02, 0.0)),
        ("2026-01-12", None), ("2026-03-03", (0.01, 0.0)), ("2026-05-11", (0.04, 0.0)), ("2026-08-24", (0.06, 0.0)),
        ("2026-11-02", (0.31, 0.0)),
    ]),
    Life("120-500507", 11, (), [
        ("2025-02-18", None), ("2025-06-17", (0.0, 0.0)), ("2025-11-25", (0.0, 0.0)), ("2026-04-14", (0.0, 0.0)),
        ("2026-10-20", (0.0, 0.0)),
    ]),
    Life("120-500733", 17, ("periodic:j5:n2",), [
        ("2025-03-11", None), ("2025-09-09", (0.0, 0.0)), ("2026-02-10", (0.0, 0.05)), ("2026-02-12", None),
        ("2026-09-15", (0.0, 0.0)),
    ]),
)  # fmt: skip


def write_history(folder: Path, lives: Sequence[Life] = LIVES) -> list[Path]:
    """Models, diagnoses and verdicts of robots, oldest first; their files."""
    return [file for life in lives for file in _written(folder / life.serial, life)]


def _written(folder: Path, life: Life) -> list[Path]:
    most = len(life.days) * FIT
    made = make_campaign(
        seed=life.seed, n=most, n_validation=len(life.days) * JUDGED, effects=list(life.effects), size=4.0
    )
    out: list[Path] = []
    baseline = Path()
    for i, (day, moved) in enumerate(life.days):
        place = folder / day
        csv = Path(write_campaign(made, place)["csv"])
        edit_rows(csv, _part(i, most) if moved is None else _checked(i, moved))
        sign(csv.with_suffix(".toml"), life.serial, day)
        dataset = read_dataset(csv)
        if moved is None:
            found = diagnose(dataset)
            baseline = place / "model.json"
            save_model(baseline, found.final, found)
            (place / "diagnosis.json").write_text(as_json(DiagnosisOutcome(found).document()), "utf-8")
            out += [baseline, place / "diagnosis.json"]
        else:
            verdict = watch_result(dataset, load_model(baseline), baseline, WatchRequest())
            (place / "watch.json").write_text(as_json(document_of(verdict)), "utf-8")
            out.append(place / "watch.json")
    return out


def _part(i: int, most: int) -> Callable[[Rows], None]:
    def keep(rows: Rows) -> None:
        judged = most + i * JUDGED
        rows[:] = rows[i * FIT : (i + 1) * FIT] + rows[judged : judged + JUDGED]

    return keep


def _checked(i: int, moved: tuple[float, float]) -> Callable[[Rows], None]:
    def keep(rows: Rows) -> None:
        rows[:] = rows[i * FIT : i * FIT + CHECKED]
        for row in rows:
            row["y_mm"] = str(float(row["y_mm"]) + moved[0])
            row["j4_deg"] = str(float(row["j4_deg"]) - moved[1])

    return keep


def sign(header: Path, serial: str, day: str) -> None:
    """Put devices and time into a header."""
    table = parse_toml(header.read_text("utf-8"), header)
    table["device"] = [
        {"role": "robot", "model": "IRB 120", "serial": serial},
        {"role": "instrument", "model": "FARO ION", "serial": "V01000123456"},
    ]
    table["measured"] = {"began": f"{day} 08:15 UTC", "ended": f"{day} 09:40 UTC"}
    table.pop("simulated", None)  # for a store of real robots; a test's alone
    header.write_text(tomli_w.dumps(table), "utf-8")


if __name__ == "__main__":  # python -m tests.service.histories FOLDER: for the pictures of docs/operator.md
    write_history(Path(sys.argv[1]))

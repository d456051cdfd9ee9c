"""Simulated data sets for the tests of the service, and small ways to spoil them."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from mocks.campaign import make_campaign, write_campaign

Rows = list[dict[str, str]]


def write_data(
    folder: Path, *, seed: int = 4, effects: tuple[str, ...] = ("backlash:j4",), n: int = 80
) -> Path:
    """A campaign of n calibration and n // 2 validation rows; returns its CSV."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in _files(seed, effects, n).items():
        (folder / name).write_bytes(content)
    return folder / "data.csv"


@cache
def _files(seed: int, effects: tuple[str, ...], n: int) -> dict[str, bytes]:
    """The files of a campaign, made once in a process: a hundred tests begin with the same one."""
    campaign = make_campaign(seed=seed, n=n, n_validation=n // 2, effects=list(effects), size=6.0)
    with TemporaryDirectory() as folder:
        write_campaign(campaign, Path(folder))
        return {file.name: file.read_bytes() for file in Path(folder).iterdir()}


def write_narrow_data(folder: Path, *, effect: str = "periodic:j5:n2", seed: int = 4, n: int = 330) -> Path:
    """Readings in 35 % of the range of the effect's joint only: there orders look alike. Validation rows stay wide."""
    data = write_data(folder, seed=seed, effects=(effect,), n=n)
    name = f"{effect.split(':')[1]}_deg"

    def narrow(rows: Rows) -> None:
        angles = [float(row[name]) for row in rows]
        middle, half = 0.5 * (min(angles) + max(angles)), 0.175 * (max(angles) - min(angles))
        rows[:] = [r for r in rows if r["set"] == "validation" or abs(float(r[name]) - middle) < half]

    edit_rows(data, narrow)
    return data


def read_rows(path: Path) -> Rows:
    """The lines of a CSV by column."""
    return list(csv.DictReader(io.StringIO(path.read_text("utf-8"))))


def edit_rows(path: Path, change: Callable[[Rows], object]) -> None:
    """Read a CSV as dictionaries, let `change` alter them in place, and write it back."""
    rows = read_rows(path)
    change(rows)
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    path.write_text(text.getvalue(), "utf-8")


def edit_text(path: Path, old: str, new: str) -> None:
    """Replace a piece of a text file that must be there."""
    text = path.read_text("utf-8")
    assert old in text, f"{path} does not hold {old!r}"
    path.write_text(text.replace(old, new), "utf-8")

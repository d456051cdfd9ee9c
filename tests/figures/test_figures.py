"""Measured figures are entered as printed, and nothing else is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.figures.__main__ import commands
from tests.figures.history import ROOT, append, measured, read
from tests.figures.page import PAGE, page

PRINTS = (
    "from tests.benchmarks.clock import line; line('held-out error, 1.3 s', '{}', '<= 2', {}); print('a | b')"
)


def test_a_run_is_entered_and_read_again_as_it_was(tmp_path: Path) -> None:
    file = tmp_path / "history.csv"
    runs = [measured("floor:2", ["-c", PRINTS.format(value, value == "1.9")]) for value in ("1.9", "2.5")]
    runs[1] = replace(runs[1], date="2030-01-01 00:00:00")  # two within a second would be one
    for run in runs:
        append(run, file)
    assert read(file) == runs
    assert [run.exit for run in runs] == [0, 0]
    shown = page(runs)
    assert "| held-out error, ~ s | 1.9 | 2.5 (missed) |" in shown
    assert runs[0].commit in shown
    assert "a | b" in shown


@pytest.mark.parametrize("code", ["print('half'); 1 / 0", "pass", "print('half'); raise SystemExit(2)"])
def test_what_breaks_off_is_no_figure(code: str) -> None:
    with pytest.raises(RuntimeError, match="nothing is entered"):
        measured("floor", ["-c", code])


def test_the_page_is_the_history_and_nothing_else() -> None:
    assert PAGE.read_text("utf-8") == page(read())


def test_no_other_word_hides_a_benchmark() -> None:
    names = {path.stem for path in (ROOT / "tests" / "benchmarks").glob("*.py")}
    assert "coverage" in names  # of intervals; the lines that tests reach have another word
    assert all(commands(name) == [["-m", "tests.benchmarks", name]] for name in names)
    assert commands("floor:20")[-1][-2:] == ["floor", "20"]

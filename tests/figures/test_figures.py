"""Measured figures are entered as printed, and nothing else is."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.benchmarks.__main__ import BENCHMARKS
from tests.figures.__main__ import commands
from tests.figures.history import append, measured, read
from tests.figures.page import PAGE, page

PRINTS = (
    "from tests.benchmarks.clock import line; line('held-out error, 1.3 s', '{}', '<= 2', {}); print('a | b')"
)


def test_a_run_is_entered_and_read_again_as_it_was(tmp_path: Path) -> None:
    file = tmp_path / "history.csv"
    runs = [measured("floor:2", ["-c", PRINTS.format(value, value == "1.9")]) for value in ("1.9", "2.5")]
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


def test_every_benchmark_has_a_word() -> None:
    assert all(commands(name) == [["-m", "tests.benchmarks", name]] for name in BENCHMARKS)
    assert commands("floor:20")[-1][-2:] == ["floor", "20"]

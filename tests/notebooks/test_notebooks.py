"""The notebooks: stored output is in order, without a fault, and independent of the machine.

The short notebooks are run.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.notebooks.run import NOTEBOOKS, ROOT, execute, lacks

ALL = sorted(NOTEBOOKS.glob("*.ipynb"))
SHORT = ("own_driver", "own_effect")  # the others take most of a minute: make notebooks
MOST_BYTES = 150_000


def cells(path: Path) -> list[dict]:
    """Return the code cells of a notebook."""
    return [cell for cell in json.loads(path.read_text("utf-8"))["cells"] if cell["cell_type"] == "code"]


def test_there_are_four() -> None:
    assert {path.stem for path in ALL} == {"simulated", "ur10", *SHORT}


@pytest.mark.parametrize("path", ALL, ids=lambda path: path.stem)
def test_what_is_kept_was_run_in_order_and_names_no_machine(path: Path) -> None:
    found = cells(path)
    assert [cell["execution_count"] for cell in found] == list(range(1, len(found) + 1))
    outputs = [output for cell in found for output in cell["outputs"]]
    assert outputs
    assert not [output for output in outputs if output["output_type"] == "error"]
    text = path.read_text("utf-8")
    assert len(text) < MOST_BYTES
    for place in (str(ROOT), str(ROOT.parent), str(Path.home()), "/tmp/"):
        assert place not in text
    drawn = [output for output in outputs if "image/png" in output.get("data", {})]
    assert path.stem in SHORT or drawn


@pytest.mark.parametrize("name", SHORT)
def test_a_short_one_runs_and_says_the_same(name: str) -> None:
    """Text is compared, not pictures; what depends on the machine is in none of the two."""
    path = NOTEBOOKS / f"{name}.ipynb"
    done = execute(path)
    again = [cell for cell in done.cells if cell.cell_type == "code"]
    for cell, before in zip(again, cells(path), strict=True):
        assert _text(cell.outputs) == _text(before["outputs"])


def test_measurements_that_are_not_here_are_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("TRUEPOSE_UR10", str(tmp_path / "nowhere"))
    assert "name their folder in TRUEPOSE_UR10" in lacks(NOTEBOOKS / "ur10.ipynb")
    assert not lacks(NOTEBOOKS / "own_effect.ipynb")


def _text(outputs: list[dict]) -> str:
    """Join the output of a cell, which a busy machine cuts anywhere.

    A notebook file stores text as lists of lines.
    """
    said = [each.get("text") or each.get("data", {}).get("text/plain", "") for each in outputs]
    return "".join(line for each in said for line in each)

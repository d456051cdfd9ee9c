"""Run a notebook of the documentation from its first cell to its last.

It runs in a separate kernel and folder.
"""

from __future__ import annotations

import os
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

ROOT = Path(__file__).parents[2]
NOTEBOOKS = ROOT / "docs" / "notebooks"
MOST_S = 600  # for one cell: the real measurements take most of a minute on a free machine
UR10 = "TRUEPOSE_UR10"  # the folder of the published measurements
BESIDE = ROOT.parent / "shared" / "data" / "ur10_leica"


def read(path: Path) -> NotebookNode:
    """A notebook from its file."""
    return nbformat.read(path, as_version=4)


def lacks(path: Path) -> str:
    """Return the reason why this machine cannot run a notebook, or an empty text if it can."""
    if not any(UR10 in cell.source for cell in read(path).cells) or _measurements():
        return ""
    return f"the UR10 measurements are not here; name their folder in {UR10}"


def execute(path: Path) -> NotebookNode:
    """Return the notebook with the output and results of its cells.

    A cell that fails raises CellExecutionError.
    """
    notebook = read(path)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    given = {
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONPATH": str(ROOT),
        "PYDEVD_DISABLE_FILE_VALIDATION": "1",
        "TRUEPOSE_SOURCES": str(ROOT),
        UR10: str(_measurements() or ""),
    }
    with TemporaryDirectory() as folder, patch.dict(os.environ, given):
        client = NotebookClient(
            notebook, timeout=MOST_S, kernel_name="python3", resources={"metadata": {"path": folder}}
        )
        done: NotebookNode = client.execute()
    return done


def write(path: Path, notebook: NotebookNode) -> None:
    """Keep it: without times, and without the machine on which it ran."""
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
    notebook.metadata = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    nbformat.write(notebook, path)


def _measurements() -> Path | None:
    named = os.environ.get(UR10, "")
    folder = Path(named) if named else BESIDE
    return folder if folder.is_dir() else None

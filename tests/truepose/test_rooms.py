"""Packages of the user that have the names of ours: both work."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import truepose
from truepose.rooms import ROOMS

ROOT = Path(truepose.__file__).parents[1]
DATA = ROOT / "tests" / "certified" / "irb120_exact.csv"
SCRIPT = """
import calib, service
import truepose
data = truepose.read(DATA)
model = truepose.identify(data)
import acquisition, drivers, fleet, mocks, tests
import calib.own as own
mine = [acquisition, calib, drivers, fleet, mocks, service, tests]
assert [each.MINE for each in mine] == ["acquisition", "calib", "drivers", "fleet", "mocks", "service", "tests"]
assert own.MINE == calib.MINE
import pickle
assert pickle.loads(pickle.dumps(model)).error_mm == model.error_mm
try:
    truepose.read("none.csv")
except truepose.DataError as error:
    print(error.do, model)
"""
CHILD = """
import subprocess
from truepose import rooms
rooms.take()
from service.child import python
print(subprocess.run(python("mocks", "--help"), capture_output=True, text=True, check=True).stdout)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of a script, with packages and a module of the user."""
    for name in (*ROOMS, "tests"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(f"MINE = {name!r}\n", "utf-8")
    (tmp_path / "calib" / "own.py").write_text("MINE = 'calib'\n", "utf-8")
    (tmp_path / "mocks" / "__init__.py").unlink()
    (tmp_path / "mocks").rmdir()
    (tmp_path / "mocks.py").write_text("MINE = 'mocks'\n", "utf-8")
    return tmp_path


def python(folder: Path, *arguments: str) -> str:
    """Run Python in the folder, with the folder before the packages of TruePose."""
    path = os.pathsep.join([str(folder), str(ROOT)])
    environment = {**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-W", "error", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_script_has_its_packages_and_ours(folder: Path) -> None:
    (folder / "script.py").write_text(SCRIPT.replace("DATA", repr(str(DATA))), "utf-8")
    assert python(folder, "script.py").startswith("Check the name. <model of abb-irb120")


def test_the_command_line_has_ours(folder: Path) -> None:
    assert python(folder, "-m", "truepose", "--version").startswith("truepose ")
    assert "abb-irb120" in python(folder, "-m", "truepose", "robot", "list")
    assert "usage" in python(folder, "-c", CHILD).lower()


def test_nothing_is_moved_without_need(tmp_path: Path) -> None:
    asked = "import sys, truepose; truepose.read; print([type(each).__module__ for each in sys.meta_path])"
    assert "truepose" not in python(tmp_path, "-c", asked)

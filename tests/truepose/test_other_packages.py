"""Effects and drivers of other packages: found by their entry points, and named if broken."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from tests.service.campaigns import write_data

ROOT = Path(__file__).parents[2]
EFFECT = """
from calib.effects.kind import EffectKind
from calib.model.effect import effect
from calib.model.regressors import ApproachSide
from calib.scan import Candidate

KINDS = (EffectKind("leaning_axis", check="Push the arm across axis {joint}.", apart=()),)


def offer(survey):
    acts = {"lean": ("deg", 0.1, [("alpha3", ApproachSide(3))])}
    return [Candidate(effect("leaning_axis:j3", "structure", "robot", "Axis 3 leans.", acts))]
"""
DRIVER = """
from drivers import InstrumentDriver
from drivers.faro import declaration

DRIVERS = (InstrumentDriver(name="acme", maker="Acme", instrument="tracker", make=declaration.DRIVERS[0].make),)
"""
ASKED = """
import truepose
from calib.effects import check_of
from drivers import instrument_driver

print(check_of("leaning_axis:j3"))
print(instrument_driver("acme").maker)
print("leaning_axis:j3" in truepose.diagnose("DATA").power.index)
"""


def package(folder: Path, points: str, **modules: str) -> None:
    """A package as an installer leaves it."""
    for name, text in modules.items():
        (folder / f"{name}.py").write_text(text, "utf-8")
    about = folder / "acme-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n", "utf-8")
    (about / "entry_points.txt").write_text(points, "utf-8")


def python(folder: Path, code: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(folder), str(ROOT)])
    environment = {**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False, cwd=folder)


def test_an_effect_and_a_driver_of_another_package(tmp_path: Path) -> None:
    points = "[truepose.effects]\nleaning = acme_effect\n[truepose.drivers]\nacme = acme_driver\n"
    package(tmp_path, points, acme_effect=EFFECT, acme_driver=DRIVER)
    data = write_data(tmp_path, n=60)
    done = python(tmp_path, ASKED.replace("DATA", str(data)))
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["Push the arm across axis 3.", "Acme", "True"]


def test_one_that_cannot_be_loaded_is_named(tmp_path: Path) -> None:
    package(
        tmp_path, "[truepose.effects]\nlost = no_such_module\n[truepose.drivers]\nlost = no_such_module\n"
    )
    done = python(tmp_path, "from calib.effects import entries; entries()")
    assert (
        "effect 'lost' of the package acme: cannot be loaded: No module named 'no_such_module'."
        in done.stderr
    )
    done = python(tmp_path, "from drivers import robot_driver; robot_driver('acme')")
    assert "drivers 'lost' of the package acme cannot be loaded" in done.stderr
    assert python(tmp_path, "from drivers import robot_driver; robot_driver('abb')").returncode == 0

"""The wheel: all that the program needs and no more, run without the sources next to it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("acquisition", "calib", "drivers", "fleet", "mocks", "service", "truepose")
SCRIPT = """\
from pathlib import Path

import truepose

data = truepose.read(Path("irb120.csv"))
found: truepose.Diagnosis = truepose.diagnose(data, most=2, progress=print)
print(found.sentence, found.errors.loc["with effects", "rms"])
try:
    found.model.save("irb120.json")
except truepose.DataError as error:
    print(error.do)
corrected = truepose.compensate(found.model, joints_deg=[[10.0, 20.0, -30.0, 40.0, 50.0, 60.0]])
good: list[int] = [len(data)]
"""
MOST_BYTES = 3_000_000  # of sources and pages, three.js among them; pictures alone would be more


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel from a copy of the tree, without a network."""
    folder, source = tmp_path_factory.mktemp("wheel"), tmp_path_factory.mktemp("source")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(
        ROOT / "docs", source / "docs", ignore=shutil.ignore_patterns("build", "made", "__pycache__")
    )
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(source)]
    done = subprocess.run(build, capture_output=True, text=True, check=False, cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return next(folder.glob("*.whl"))


def test_it_holds_every_file_and_no_more(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    own = {name for name in names if ".dist-info/" not in name and ".data/" not in name}
    wanted = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert own == wanted
    assert any(name.endswith("licenses/LICENSE") for name in names)
    pages = {name.split("share/truepose/docs/")[1] for name in names if ".data/" in name}
    written = {path.relative_to(ROOT / "docs") for path in (ROOT / "docs").rglob("*.md")}
    assert {page for page in pages if page.endswith(".md")} == {
        path.as_posix() for path in written if path.parts[0] not in ("build", "made", "evidence")
    }
    assert wheel.stat().st_size < MOST_BYTES


@pytest.fixture(scope="module")
def scripts(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Programs of an environment with the wheel; its other packages are those of this one."""
    home = tmp_path_factory.mktemp("environment")
    venv.create(home, with_pip=False)
    scripts = home / ("Scripts" if os.name == "nt" else "bin")
    site = next(home.rglob("site-packages"))
    install = [sys.executable, "-m", "pip", "--python", str(scripts / "python"), "install", "--no-index"]
    run([*install, "--no-deps", "--quiet", str(wheel)], home)
    (site / "others.pth").write_text(sysconfig.get_path("purelib"), "utf-8")
    return scripts


def run(command: list[str], folder: Path) -> str:
    """Run a program without the sources, in which pip would find this version and do nothing."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_it_runs_where_there_are_no_sources(scripts: Path, tmp_path: Path) -> None:
    def truepose(*arguments: str) -> str:
        return run([str(scripts / "truepose"), *arguments], tmp_path)

    assert truepose("--version").startswith("truepose ")
    assert str(scripts.parent) in truepose("docs")
    assert "first-hour" in truepose("docs", "index")
    assert "backlash:j4" in truepose("demo", "--in-memory", "--effect", "backlash:j4", "--out", "d")
    asked = "import calib, truepose; print(calib.__file__, truepose.read)"
    assert str(scripts.parent) in run([str(scripts / "python"), "-c", asked], tmp_path)


def test_a_users_script_has_types(scripts: Path, tmp_path: Path) -> None:
    """Two programs that others wrote find the types of the wheel, and a mistake by them."""
    (tmp_path / "mine.py").write_text(SCRIPT, "utf-8")
    (tmp_path / "wrong.py").write_text(SCRIPT.replace("list[int]", "Path"), "utf-8")
    python, installed = str(scripts / "python"), sysconfig.get_path("scripts")
    mypy = [f"{installed}/mypy", "--strict", "--python-executable", python, "--cache-dir", str(tmp_path)]
    for reader in (mypy, [f"{installed}/pyright", "--pythonpath", python]):
        done = subprocess.run([*reader, "mine.py", "wrong.py"], capture_output=True, text=True, cwd=tmp_path)
        errors = [line for line in done.stdout.splitlines() if "error:" in line]
        assert len(errors) == 1, done.stdout + done.stderr
        assert "wrong.py" in errors[0]
        assert "Path" in errors[0]

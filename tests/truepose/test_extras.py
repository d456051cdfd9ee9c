"""Test the installation without extras, and the extra that each other command names.

A process stands for it in which every package is absent that the dependencies of pyproject.toml do not bring.
"""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path
from typing import Any

import pytest
from openpyxl import Workbook

from service.extras import EXTRAS
from service.http.wire import problems

ROOT = Path(__file__).parents[2]
ABOUT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
CELL = str(ROOT / "examples" / "irb120_faro" / "cell.toml")
MODULES = packages_distributions()
BASE = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ABSENT:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
"""
COMMANDS = """
import contextlib, io, json
from service.cli import main
for words in json.loads(sys.stdin.read()):
    told = io.StringIO()
    with contextlib.redirect_stderr(told), contextlib.redirect_stdout(told):
        code = main(words)
    print(json.dumps([code, told.getvalue()]))
"""
CALL = """
import truepose
try:
    {call}
except ImportError as error:
    print(error)
"""


MAP = """format = "truepose-map/1"
[[file]]
columns = {j1 = "A[deg]", x = "B[mm]", y = "C[mm]", z = "D[mm]"}
"""


def plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", re.split(r"[^\w.-]", name.strip())[0]).lower()


def closure(wanted: list[str]) -> set[str]:
    """Distributions that these requirements install, without those of other systems."""
    found: set[str] = set()
    wanted = list(wanted)
    while wanted:
        asked = wanted.pop()
        name, extra = plain(asked), re.search(r"\[(\w+)\]", asked)
        if name not in found or extra:
            try:
                below = requires(name) or []
            except PackageNotFoundError:
                continue
            found.add(name)
            of_extra = f'extra == "{extra[1]}"' if extra else "no extra"
            wanted += [each for each in below if "extra ==" not in each or of_extra in each]
    return found


@pytest.fixture(scope="module")
def base() -> str:
    kept = closure(ABOUT["dependencies"]) | {"truepose"}
    absent = {module for module, homes in MODULES.items() if not kept & {plain(home) for home in homes}}
    assert {"fastapi", "sqlalchemy", "openpyxl", "pandas", "yaml"} <= absent
    return f"ABSENT = {sorted(absent)}\n{BASE}"


def run(code: str, folder: Path, given: object = None) -> list[Any]:
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=json.dumps(given),
        capture_output=True,
        text=True,
        cwd=folder,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_data_need_no_extra(base: str, tmp_path: Path) -> None:
    page = (ROOT / "docs" / "first-hour.md").read_text("utf-8")
    lines = "".join(re.findall(r"^```sh\n(.*?)^```", page, re.DOTALL | re.MULTILINE)).splitlines()
    words = [shlex.split(line)[1:] for line in lines]
    assert [each[0] for each in words] == ["example", "convert", "diagnose", "compensate"]
    words += [["validate", "data.csv", "--model", "model.json"], ["export", "model.json", "--list"]]
    for asked, line in zip(words, run(base + COMMANDS, tmp_path, words), strict=True):
        code, told = json.loads(line)
        assert code == 0, f"{asked}: {told}"
    assert "play of joint 4" in (tmp_path / "report.html").read_text("utf-8")
    assert (tmp_path / "corrected.csv").is_file()


def test_other_commands_name_their_extra(base: str, tmp_path: Path) -> None:
    Workbook().save(tmp_path / "book.xlsx")
    asked = {
        "cell": [
            ["serve", "--record", "r"],
            ["history", "robots"],
            ["demo", "--out", "d"],
            [
                "campaign",
                "run",
                CELL,
                str(ROOT / "examples" / "irb120_faro" / "campaign.toml"),
                "--record",
                "r",
            ],
            ["calibrate", CELL, "--simulate"],
        ],
        "fleet": [["fleet", "serve"], ["fleet", "diagnose", "data.csv"], ["fleet", "learn", "--help"]],
        "excel": [["convert", "book.xlsx", "--propose", "m.toml"]],
        "parquet": [["identify", "data.parquet"], ["convert", "export.csv", "--out", "data.parquet"]],
    }
    words = [each for several in asked.values() for each in several]
    answers = dict(zip(map(tuple, words), run(base + COMMANDS, tmp_path, words), strict=True))
    for extra, several in asked.items():
        for each in several:
            code, told = json.loads(answers[tuple(each)])
            assert code == 2, f"{each}: {told}"
            last = told.splitlines()[-1]
            assert last.endswith(f'is not installed. Install it with: pip install "truepose[{extra}]"'), told
            assert "Traceback" not in told


def test_the_service_names_it() -> None:
    """A request that needs a workbook's reader is no fault of the program."""
    document = problems.of_error(ModuleNotFoundError("No module named 'openpyxl'", name="openpyxl.utils"))
    assert (document["status"], document["detail"]) == (501, "the package 'openpyxl' is not installed.")
    assert document["what_to_do"] == 'Install it with: pip install "truepose[excel]"'
    lost = problems.of_error(ModuleNotFoundError("No module named 'numpy'", name="numpy"))
    assert lost["what_to_do"] == 'Install it with: pip install "truepose"'


def test_python_names_the_extra(base: str, tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(MAP, "utf-8")
    Workbook().save(tmp_path / "book.xlsx")
    data = str(ROOT / "tests" / "certified" / "irb120_exact.csv")
    calls = {
        "excel": 'truepose.read("book.xlsx", map="m.toml")',
        "pandas": f"truepose.read({data!r}).readings",
    }
    for extra, call in calls.items():
        said = run(base + CALL.format(call=call), tmp_path)
        assert said[-1].endswith(f'pip install "truepose[{extra}]"'), said


def test_the_table_of_extras_is_that_of_the_package() -> None:
    """The extra installs each module of the table, and the table has each of its packages."""
    for extra, modules in EXTRAS.items():
        names = (extra, "cell") if extra == "fleet" else (extra,)
        listed = [each for name in names for each in ABOUT["optional-dependencies"][name]]
        listed = [each for each in listed if not each.startswith("truepose[")]
        installed, wanted = closure(listed), {plain(each) for each in listed}
        homes = {module: {plain(home) for home in MODULES[module]} for module in modules}
        assert all(found <= installed for found in homes.values()), extra
        assert wanted <= set().union(*homes.values()), extra

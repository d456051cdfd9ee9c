"""The examples in the docstrings of public names, run; and the docstrings' content.

These would catch: an example that no longer runs or prints another result, and a public name without one. They would
also catch an undocumented argument with a unit in its name, and a function that does not state its errors.
"""

from __future__ import annotations

import doctest
import inspect
import re
import shutil
from pathlib import Path

import pytest

import truepose
from tests.calib.campaigns import write_files
from tests.calib.test_sweeps import cell
from tests.service.campaigns import write_data

CELL = Path(__file__).parents[2] / "examples" / "irb120_faro" / "cell.toml"
CAMPAIGN = """format = "truepose-campaign/1"
seed = 1
settle_s = 1.0
samples = 10
warm_up_s = 0.0
[[block]]
kind = "poses"
set = "calibration"
count = 4
select = "random"
targets = ["T1"]
"""
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
NAMES = sorted(truepose.__all__)
FUNCTIONS = [name for name in NAMES if inspect.isfunction(getattr(truepose, name))]
UNITS = ("_deg", "_mm", "_s", "_c")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a data set of a robot with backlash in joint 4, a cell and a campaign.

    They have the names of the examples.
    """
    at = tmp_path_factory.mktemp("examples")
    csv = write_data(at)
    for ending in (".csv", ".toml"):
        shutil.copyfile(csv.with_suffix(ending), at / f"irb120{ending}")
    turned = cell()
    write_files(at, turned.rows, turned.header()).rename(at / "sweeps.csv")
    (at / "data.toml").rename(at / "sweeps.toml")
    shutil.copyfile(CELL, at / "cell.toml")
    (at / "campaign.toml").write_text(CAMPAIGN, "utf-8")
    return at


@pytest.mark.parametrize("name", NAMES)
def test_its_example_runs(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    own = getattr(truepose, name)
    found = doctest.DocTestParser().get_doctest(
        inspect.getdoc(own) or "", {"truepose": truepose, "DataError": truepose.DataError}, name, None, None
    )
    assert found.examples, f"{name} has no example"
    said: list[str] = []
    result = doctest.DocTestRunner(optionflags=FLAGS).run(found, out=said.append)
    assert result.failed == 0, "".join(said)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_says_what_it_raises_and_in_which_units_it_is_asked(name: str) -> None:
    own = getattr(truepose, name)
    said = (inspect.getdoc(own) or "").split(">>>")[0]
    assert "Raises" in said
    for argument in inspect.signature(own).parameters:
        if argument.endswith(UNITS):
            assert argument in said
        elif argument not in ("data", "path", "model", "source"):  # the first says what it is by its type
            assert argument in said, f"{name} says nothing of {argument}"
    for argument in ("joints_deg", "limits_deg"):
        if argument in inspect.signature(own).parameters:
            assert f"{argument}: (" in said, f"{name} does not say the shape of {argument}"


@pytest.mark.parametrize("name", ["Corrected", "Selection"])
def test_arrays_of_a_result_have_a_shape(name: str) -> None:
    said = " ".join((inspect.getdoc(getattr(truepose, name)) or "").split())
    assert re.search(r"joints_deg :? ?[^:]*\(n, N\),? as the controller counts", said)

"""Test readers on spoiled files of every format: a value or a project error, never a fault.

The suite runs a short part by the seed, `make fuzz` 100,000 cases per format. Warnings of the arithmetic are faults
too.
"""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest
from hypothesis import given, note
from hypothesis import strategies as st

from calib.errors import DataError
from drivers.errors import ConfigError
from tests.fuzz.formats import Format, formats

NAMES = (
    *("data.csv", "data.toml", "robot.toml", "cell.toml", "campaign.toml"),
    *("poses.csv", "model.json", "targets.csv"),
    *("program.mod", "program.ls", "program.script", "published.csv", "cleaned.csv"),
    *("maker.dat", "maker.src", "maker.jbi", "maker.dtx"),
    *("robot.csv", "tracker.csv", "points.txt"),
    *("arm.urdf", "table.csv", "own.csv", "own.xlsx", "map.toml", "history.jsonl", "typed.txt"),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def known(folder: Path) -> dict[str, Format]:
    found = formats(folder)
    assert sorted(found) == sorted(NAMES)
    return found


@pytest.mark.parametrize("name", NAMES)
def test_the_good_example_is_read(name: str, known: dict[str, Format], folder: Path) -> None:
    assert known[name].read(folder / name) is not None


@pytest.mark.parametrize("name", NAMES)
@given(seed=st.integers(0, 2**64 - 1))
def test_any_spoiled_file(name: str, known: dict[str, Format], folder: Path, seed: int) -> None:
    format_ = known[name]
    rng = Random(seed)
    data = rng.choice(format_.spoil)(format_.good, rng)
    note(repr(data[:4000]))
    path = folder / name
    path.write_bytes(data)
    try:
        format_.read(path)
    except (DataError, ConfigError) as error:
        refusal = error.message if isinstance(error, ConfigError) else str(error)
        assert len(refusal) > 10
        assert "Traceback" not in refusal
    finally:
        path.write_bytes(format_.good)

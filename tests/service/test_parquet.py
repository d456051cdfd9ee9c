"""Test data sets as Parquet: nothing is lost, and other programs read and write the same."""

from __future__ import annotations

import datetime
import json
import shutil
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pyarrow
import pytest
from pyarrow import parquet

import truepose
from calib.convert import ConvertedTable
from calib.data import Dataset, read_dataset
from calib.errors import DataError
from calib.text import TextTable
from service.cli import main

CERTIFIED = Path(__file__).parents[1] / "certified"
SETS = sorted(path.stem for path in CERTIFIED.glob("*.csv"))
UNITS = ("_deg", "_mm", "_s", "_c")
DATA = CERTIFIED / "irb120_mixed.csv"


def as_frame(csv: Path) -> pandas.DataFrame:
    """Cells as a user of pandas has them: text, except the doubles of columns with a unit."""
    frame = pandas.read_csv(csv, dtype=str, keep_default_na=False)
    for name in frame.columns:
        if name.endswith(UNITS):
            frame[name] = [float(cell or "nan") for cell in frame[name]]
    return frame


def beside(csv: Path, folder: Path) -> Path:
    """The name of a data set in a folder that has its header."""
    shutil.copy(csv.with_suffix(".toml"), folder)
    return folder / f"{csv.stem}.parquet"


def write(csv: Path, folder: Path) -> Path:
    """Write the Parquet of a data set, from the cells of its CSV."""
    frame = pandas.read_csv(csv, dtype=str, keep_default_na=False)
    columns = {name: frame[name].tolist() for name in frame.columns}
    path = folder / f"{csv.stem}.parquet"
    ConvertedTable(columns, csv.with_suffix(".toml").read_text("utf-8")).write(path)
    return path


def equal(one: Any, other: Any, name: str = "") -> None:
    """Compare everything that two data sets hold, but the names and hashes of their files."""
    if is_dataclass(one):
        for field in fields(one):
            if field.name not in ("path", "sha256"):
                equal(getattr(one, field.name), getattr(other, field.name), f"{name}.{field.name}")
    elif isinstance(one, np.ndarray):
        assert one.dtype.kind == other.dtype.kind, name
        assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f"), name
    elif isinstance(one, int | float | str | tuple):
        assert one == other, name


@pytest.mark.parametrize("name", SETS)
def test_every_cell_is_the_same(name: str, tmp_path: Path) -> None:
    csv = CERTIFIED / f"{name}.csv"
    path = write(csv, tmp_path)
    kept = TextTable.read(csv)
    for _ in range(2):
        found = TextTable.read(path)
        assert (found.names, found.lines) == (kept.names, kept.lines)
        for column in kept.names:
            if column.endswith(UNITS):
                assert np.array_equal(found.numbers(column), kept.numbers(column), equal_nan=True), column
            elif not column.startswith(("rot", "approach", "u_")):
                assert found.text(column).tolist() == kept.text(column).tolist(), column
        as_frame(csv).to_parquet(path)


@pytest.mark.parametrize("name", ["irb120_exact", "irb120_ballbar", "irb120_poses"])
def test_a_data_set_is_the_same(name: str, tmp_path: Path) -> None:
    csv = CERTIFIED / f"{name}.csv"
    path = write(csv, tmp_path)
    kept = read_dataset(csv)
    equal(kept, read_dataset(path))
    assert path.with_suffix(".toml").read_text("utf-8") == csv.with_suffix(".toml").read_text("utf-8")
    as_frame(csv).to_parquet(path)
    equal(kept, read_dataset(path))
    assert isinstance(truepose.read(path).dataset, Dataset)


def test_others_read_every_number(tmp_path: Path) -> None:
    path = write(DATA, tmp_path)
    wanted, found = as_frame(DATA), pandas.read_parquet(path)
    assert list(found.columns) == list(wanted.columns)
    for name in wanted.columns:
        if name.endswith(UNITS):
            assert found[name].dtype == np.float64, name
            assert np.array_equal(found[name], wanted[name], equal_nan=True), name
    assert str(parquet.read_schema(path).field("reading_id").type) == "string"


def test_a_name_that_looks_like_a_number_stays_one(tmp_path: Path) -> None:
    cells = {"reading_id": ["007", "7", "1e5"], "x_mm": ["0.1", "", "1e-300"], "waypoint": ["3", "", "0"]}
    ConvertedTable(cells, "").write(tmp_path / "a.parquet")
    table = parquet.read_table(tmp_path / "a.parquet")
    assert table.column("reading_id").to_pylist() == ["007", "7", "1e5"]
    assert table.column("x_mm").to_pylist() == [0.1, None, 1e-300]
    assert table.column("waypoint").to_pylist() == [3, None, 0]


def spoilt(name: str, values: list[Any]) -> pyarrow.Table:
    """The data set with another column of that name."""
    table = pyarrow.Table.from_pandas(as_frame(DATA), preserve_index=False)
    column = pyarrow.array((values * len(table))[: len(table)])
    rest = table.drop_columns([name]) if name in table.column_names else table
    return rest.append_column(name, column)


@pytest.mark.parametrize(
    ("name", "values", "says"),
    [
        ("j2_deg", [1.0, None], "line 3: column 'j2_deg' is empty"),
        ("j2_deg", [1.0, 2.0, float("inf")], "line 4: column 'j2_deg' is 'inf'"),
        ("x_mm", ["1.0", "far"], "line 3: column 'x_mm' is 'far', not a number"),
        ("t_s", [datetime.datetime(2026, 1, 1)], r"column 't_s' holds timestamp\[us\], neither"),
        ("x_mm", [[1.0, 2.0]], r"column 'x_mm' holds list<.*>, neither numbers nor text. Leave it out"),
        ("status", [True], "column 'status' holds bool"),
    ],
)
def test_a_cell_or_a_column_is_named(name: str, values: list[Any], says: str, tmp_path: Path) -> None:
    path = beside(DATA, tmp_path)
    parquet.write_table(spoilt(name, values), path)
    with pytest.raises(DataError, match=rf"irb120_mixed\.parquet.*{says}"):
        read_dataset(path)


def test_what_is_no_parquet_is_refused(tmp_path: Path) -> None:
    path = beside(DATA, tmp_path)
    whole = write(DATA, tmp_path).read_bytes()
    for content in (b"", b"PAR1", DATA.read_bytes(), whole[:-9], whole[:200] + b"\xff" * 300 + whole[500:]):
        path.write_bytes(content)
        with pytest.raises(DataError, match=r"irb120_mixed\.parquet: cannot be read as Parquet"):
            read_dataset(path)
    parquet.write_table(spoilt("x_mm", [1.0]).slice(0, 0), path)
    with pytest.raises(DataError, match="has no readings"):
        read_dataset(path)


def test_commands_read_and_write_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["example"]) == 0
    pandas.read_csv("export.csv", sep=";").to_parquet("export.parquet")
    for source, out in (
        ("export.csv", "a.csv"),
        ("export.csv", "b.parquet"),
        ("export.parquet", "c.parquet"),
    ):
        asked = ["convert", source, "--robot", "abb-irb120", "--sigma", "0.025", "--out", out]
        assert main(asked) == 0
    for other in ("b.parquet", "c.parquet"):
        equal(read_dataset("a.csv").conditions, read_dataset(other).conditions)
    assert main(["identify", "a.csv", "--json", "a.json"]) == 0
    assert main(["identify", "b.parquet", "--json", "b.json"]) == 0
    documents = [json.loads(Path(name).read_text("utf-8")) for name in ("a.json", "b.json")]
    assert documents[0]["parameters"] == documents[1]["parameters"]
    assert main(["convert", "export.csv", "--robot", "abb-irb120", "--out", "a.xlsx"]) == 2

"""Test that missing files, files that are not text, and other tables are refused.

The refusal names file and line.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from calib import DataError, read_dataset
from tests.calib.campaigns import write_files
from tests.calib.test_bad_input import CAMPAIGN, named


def test_files_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"nothing\.csv.*no such file"):
        read_dataset(tmp_path / "nothing.csv")
    path = write_files(tmp_path, CAMPAIGN.rows, CAMPAIGN.header)
    path.with_suffix(".toml").unlink()
    with pytest.raises(DataError, match=r"data\.toml.*missing.*[Ww]rite the header"):
        read_dataset(path)


@pytest.mark.parametrize(
    ("text", "line", "word"),
    [
        ("", None, "empty"),
        ("reading_id,j1_deg\n", None, "no readings"),
        ("reading_id;j1_deg;j2_deg\n1;2;3\n", 1, "semicolons"),
        ("reading_id\tj1_deg\tj2_deg\n1\t2\t3\n", 1, "tabs"),
        ("j1_deg,j1_deg\n1,2\n", 1, "twice"),
        ("j1_deg,j2_deg\n1,2\n1\n", 3, "cells"),
    ],
)
def test_tables_that_are_none(text: str, line: int | None, word: str, tmp_path: Path) -> None:
    path = write_files(tmp_path, CAMPAIGN.rows, CAMPAIGN.header)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match=word) as caught:
        read_dataset(path)
    named(caught.value, path, line)


def test_latin_1_is_refused(tmp_path: Path) -> None:
    path = write_files(tmp_path, CAMPAIGN.rows, CAMPAIGN.header)
    path.write_bytes(path.read_bytes().replace(b"ok", "rejected:Störung".encode("latin-1"), 1))
    with pytest.raises(DataError, match="UTF-8") as caught:
        read_dataset(path)
    named(caught.value, path, None)


def test_a_broken_header_is_refused(tmp_path: Path) -> None:
    path = write_files(tmp_path, CAMPAIGN.rows, CAMPAIGN.header)
    path.with_suffix(".toml").write_text("robot = \n", encoding="utf-8")
    with pytest.raises(DataError, match="TOML") as caught:
        read_dataset(path)
    named(caught.value, path.with_suffix(".toml"), None)


def test_a_number_has_no_underscore(tmp_path: Path) -> None:
    """Python reads 1_5 as 15."""
    rows = [dict(row) for row in CAMPAIGN.rows]
    rows[3]["j2_deg"] = "1_5"
    path = write_files(tmp_path, rows, CAMPAIGN.header)
    with pytest.raises(DataError, match="'j2_deg' is '1_5', not a number") as caught:
        read_dataset(path)
    named(caught.value, path, 5)


def test_one_point_in_many_postures_is_none(tmp_path: Path) -> None:
    """Any numbers that an instrument shows without a target, or its last ones, are refused."""
    for shown in ((-999.0, -999.0, -999.0), tuple(CAMPAIGN.rows[3][f"{axis}_mm"] for axis in "xyz")):
        rows = [dict(row) for row in CAMPAIGN.rows]
        for row in rows[4:7]:
            row |= dict(zip(("x_mm", "y_mm", "z_mm"), shown, strict=True))
        path = write_files(tmp_path, rows, CAMPAIGN.header)
        with pytest.raises(DataError, match=r"in [34] readings \(.*different postures"):
            read_dataset(path)
        for row in rows[4:7]:
            row["status"] = "rejected:nothing seen"
        read_dataset(write_files(tmp_path, rows, CAMPAIGN.header))

"""Bad input, refused. Every case of the bad-input list must name file, and line or key, and say what to do; the
messages are checked by what an engineer would look for in them, not word by word.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from calib.dataset import read_dataset
from calib.errors import DataError
from calib.identify import identify
from mocks.campaign import make_campaign
from tests.calib.campaigns import Row, write_files

CAMPAIGN = make_campaign(seed=3, n=60, n_validation=10, effects=[])
Change = Callable[[list[Row], dict[str, Any]], None]


def rename(old: str, new: str) -> Change:
    def change(rows: list[Row], header: dict[str, Any]) -> None:
        for row in rows:
            row[new] = row.pop(old)

    return change


def drop(*names: str) -> Change:
    def change(rows: list[Row], header: dict[str, Any]) -> None:
        for row in rows:
            for name in names:
                del row[name]

    return change


def cell(name: str, value: Any, row: int = 7) -> Change:
    def change(rows: list[Row], header: dict[str, Any]) -> None:
        rows[row][name] = value

    return change


def every(name: str, value: Any) -> Change:
    def change(rows: list[Row], header: dict[str, Any]) -> None:
        for row in rows:
            row[name] = value

    return change


def head(key: str, value: Any) -> Change:
    def change(rows: list[Row], header: dict[str, Any]) -> None:
        table, _, inner = key.partition(".")
        if inner:
            header[table] = {**header.get(table, {}), inner: value}
        else:
            header[table] = value

    return change


def no_head(key: str) -> Change:
    def change(rows: list[Row], header: dict[str, Any]) -> None:
        table, _, inner = key.partition(".")
        if inner:
            header[table] = {k: v for k, v in header[table].items() if k != inner}
        else:
            del header[table]

    return change


def radians(rows: list[Row], header: dict[str, Any]) -> None:
    for row in rows:
        for k in range(1, 7):
            row[f"j{k}_deg"] *= 0.0174532925


def same(rows: list[Row], header: dict[str, Any]) -> None:
    for row in rows:
        row |= {k: v for k, v in rows[0].items() if k[0] in "jxyz" or k.startswith(("app", "prev", "tool"))}


def few(count: int) -> Change:
    def change(rows: list[Row], header: dict[str, Any]) -> None:
        kept = [row for row in rows if row["set"] == "calibration"][:count]
        rows[:] = kept

    return change


def one_target(rows: list[Row], header: dict[str, Any]) -> None:
    rows[:] = [row for row in rows if row["tool_target"] == "T1"] * 1
    for i in range(len(rows)):
        rows[i] = dict(rows[i])


def no_targets_named(rows: list[Row], header: dict[str, Any]) -> None:
    header["tool_targets"] = {}


CSV, TOML = "data.csv", "data.toml"
# what is done, the file that must be named, the line or key, words the message must hold
CASES: dict[str, tuple[Change, str, int | str | None, str]] = {
    "joint without unit": (rename("j2_deg", "j2"), CSV, 1, "'j2'.*deg"),
    "point without unit": (rename("x_mm", "x"), CSV, 1, "'x'.*mm"),
    "time without unit": (rename("t_s", "t"), CSV, 1, "'t'.*t_s"),
    "point in metres": (rename("z_mm", "z_m"), CSV, 1, "z_mm"),
    "joints in radians by name": (rename("j1_deg", "j1_rad"), CSV, 1, "j1_deg"),
    "missing joint": (drop("j4_deg"), CSV, 1, "j4_deg.*6 joints"),
    "missing point": (drop("y_mm"), CSV, 1, "y_mm"),
    "empty header": (lambda r, h: h.clear(), TOML, "format", "missing"),
    "too many joints": (every("j7_deg", 1.0), CSV, 1, "j7_deg.*6 joints"),
    "nan in a joint": (cell("j3_deg", "nan"), CSV, 9, "j3_deg.*nan"),
    "nan in a point": (cell("x_mm", "NaN"), CSV, 9, "x_mm.*[Ee]mpty"),
    "infinite point": (cell("x_mm", "inf"), CSV, 9, "x_mm"),
    "empty joint": (cell("j3_deg", ""), CSV, 9, "j3_deg.*empty"),
    "text for a number": (cell("y_mm", "12,5"), CSV, 9, "y_mm.*decimal point"),
    "half a point": (cell("y_mm", ""), CSV, 9, "[Ff]ill"),
    "a point of zeros": (
        lambda r, h: r[7].update({"x_mm": 0.0, "y_mm": 0.0, "z_mm": 0.0}), CSV, 9, "empty",
    ),
    "radians": (radians, CSV, "j1_deg", "radians.*degrees"),
    "unknown robot": (head("robot", "kuka-kr6"), TOML, "robot", "kuka-kr6.*abb-irb120"),
    "no robot": (no_head("robot"), TOML, "robot", "missing"),
    "wrong joint count": (head("robot", "ur5-extra"), TOML, "robot", "ur5-extra"),
    "no calibration rows": (every("set", "validation"), CSV, "set", "calibration"),
    "all rejected": (every("status", "rejected:fog"), CSV, "set", "calibration"),
    "unknown set": (cell("set", "calib"), CSV, 9, "calib.*calibration"),
    "all the same": (same, CSV, None, "same"),
    "unknown target": (cell("tool_target", "T9"), CSV, 9, "T9.*T1"),
    "no target named": (cell("tool_target", ""), CSV, 9, "tool_target"),
    "no targets at all": (no_targets_named, TOML, "tool_targets", "tool_targets"),
    "id twice": (cell("reading_id", 3), CSV, 9, "3"),
    "empty id": (cell("reading_id", ""), CSV, 9, "id"),
    "side of two": (cell("approach2", 2), CSV, 9, "approach2"),
    "wrong format": (head("format", "truepose-dataset/2"), TOML, "format", "truepose-dataset/1"),
    "unknown coupling": (head("joint_coupling", "fanuc-j23"), TOML, "joint_coupling", "none"),
    "unknown world": (head("world", "flat"), TOML, "world", "free"),
    "unknown group": (head("model.fit", ["base", "magic"]), TOML, "fit", "magic.*geometry"),
    "group twice": (head("model.fit", ["base", "base"]), TOML, "fit", "twice"),
    "no noise": (no_head("noise"), TOML, "noise", "missing"),
    "noise of zero": (head("noise", {"kind": "isotropic", "sigma_mm": 0.0}), TOML, "noise", "zero"),
    "negative noise": (head("noise.range_mm", -0.1), TOML, "noise.range_mm", "-0.1"),
    "no station": (no_head("noise.station_mm"), TOML, "noise.station_mm", "three numbers"),
    "target of two numbers": (head("tool_targets.T1", [1.0, 2.0]), TOML, "tool_targets.T1", "three"),
    "load on no link": (
        head("loads", [{"link": 9, "mass_kg": 1.0, "cog_mm": [0, 0, 0]}]), TOML, "loads", "link 9",
    ),
    "per-row noise without rows": (head("noise", {"kind": "per-row"}), CSV, 2, "u_x_mm"),
}  # fmt: skip


@pytest.mark.parametrize("case", sorted(CASES))
def test_it_is_refused_by_name(case: str, tmp_path: Path) -> None:
    change, file, place, words = CASES[case]
    rows, header = [dict(row) for row in CAMPAIGN.rows], dict(CAMPAIGN.header)
    read_dataset(write_files(tmp_path, rows, header))  # it is the change that is refused
    change(rows, header)
    with pytest.raises(DataError, match=f"(?s){words}") as caught:
        read_dataset(write_files(tmp_path, rows, header))
    named(caught.value, tmp_path / file, place)


def named(error: DataError, path: Path | str, place: int | str | None) -> None:
    text = str(error)
    assert str(path) in text
    assert len(error.do.split()) >= 2
    assert text.endswith(".")
    if isinstance(place, int):
        assert error.line == place
        assert f"line {place}" in text
    elif place is not None:
        assert error.key is not None
        assert place in error.key
        assert place in text


FIT_CASES: dict[str, tuple[Change, str, str]] = {
    "fewer readings than parameters": (few(9), "set", "readings.*parameters"),
    "one target on the axis": (one_target, "tool_targets", "axis of the last joint.*second target"),
}


@pytest.mark.parametrize("case", sorted(FIT_CASES))
def test_what_cannot_be_identified_is_refused_by_name(case: str, tmp_path: Path) -> None:
    change, key, words = FIT_CASES[case]
    rows, header = [dict(row) for row in CAMPAIGN.rows], dict(CAMPAIGN.header)
    change(rows, header)
    data = read_dataset(write_files(tmp_path, rows, header))
    with pytest.raises(DataError, match=f"(?s){words}") as caught:
        identify(data)
    named(caught.value, "data.csv", key)


def test_only_as_many_readings_as_parameters(tmp_path: Path) -> None:
    """31 + beta parameters and 11 readings of three numbers: nothing is left to judge the fit by, but one number."""
    rows = [dict(row) for row in CAMPAIGN.rows if row["set"] == "calibration"][:11]
    data = read_dataset(write_files(tmp_path, rows, CAMPAIGN.header))
    result = identify(data)
    assert result.degrees_of_freedom >= 1


def test_a_series_that_was_only_validated_is_refused(tmp_path: Path) -> None:
    """Where the base of a series stands, only its own calibration rows can tell."""
    rows = [dict(row) for row in CAMPAIGN.rows]
    for row in rows:
        row["series"] = "night" if row["set"] == "validation" else "day"
    with pytest.raises(DataError, match="night"):
        read_dataset(write_files(tmp_path, rows, {**CAMPAIGN.header, "world": "free"}))


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

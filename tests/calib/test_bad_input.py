"""Test that bad input is refused.

Every case of the bad-input list must name file, and line or key, and state a remedy. The messages are checked for
the terms that an engineer would look for, not word by word.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from calib import DataError, identify, read_dataset
from mocks.campaign import make_campaign
from tests.calib.campaigns import Row, write_files
from tests.calib.cells import POSE, Cell

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


def kelvin(rows: list[Row], header: dict[str, Any]) -> None:
    for row in rows:
        row["t_air_c"] += 273.15


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
    "joint read back, without unit": (rename("reading_id", "j2_read"), CSV, 1, "'j2_read'.*j2_read_deg"),
    "joint read back, misspelt": (rename("reading_id", "j2_read_degs"), CSV, 1, "mean 'j2_read_deg'"),
    "temperature in kelvin": (kelvin, CSV, 2, "t_air_c.*is 29.*degC"),
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
    "unknown robot": (head("robot", "kuka-kr6"), TOML, "robot", "kuka-kr6.*kuka-kr6-r900"),
    "no robot": (no_head("robot"), TOML, "robot", "missing"),
    "wrong joint count": (head("robot", "ur5-extra"), TOML, "robot", "ur5-extra"),
    "all rejected": (every("status", "rejected:fog"), CSV, "set", "measured"),
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
    "noise of nearly zero": (
        head("noise", {"kind": "isotropic", "sigma_mm": 1e-200}), TOML, "noise.sigma_mm", "1e-200",
    ),
    "row noise of nearly zero": (
        lambda r, h: r[7].update({f"u_{k}_mm": 1e-200 for k in "xyz"}), CSV, 9, "u_x_mm.*above zero",
    ),
    "load without mass": (
        head("loads", [{"link": 6, "mass_kg": 0, "cog_mm": [0, 0, 0]}]), TOML, "loads", "0.0 kg.*above zero",
    ),
    "load on half a link": (
        head("loads", [{"link": 1.5, "mass_kg": 1, "cog_mm": [0, 0, 0]}]), TOML, "loads", "link 1.5",
    ),
    "gravity in mm": (head("gravity_base", [0, 0, -9810.0]), TOML, "gravity_base", "9810.*m/s2"),
    "gravity as a direction": (head("gravity_base", [0, 0, -1.0]), TOML, "gravity_base", "9.81"),
    "a level that is none": (head("model", {"level": 4}), TOML, "model.level", "1, 2 or 3"),
    "a list of levels": (head("model", {"level": [3]}), TOML, "model.level", "1, 2 or 3"),
    "level and groups": (head("model.level", 2), TOML, "model.level", "beside 'fit'"),
    "prior of zero": (head("model.priors", {"d3": 0.0}), TOML, "model.priors.d3", "hold"),
    "hold is no list": (head("model.hold", "d3"), TOML, "model.hold", "list"),
    "a far point": (cell("x_mm", 1e200), CSV, 9, "x_mm.*mm"),
    "a far target": (head("tool_targets.T1", [1e200, 0.0, 0.0]), TOML, "tool_targets.T1", "mm"),
    "encoder counts": (cell("j2_deg", 7340032), CSV, 9, "j2_deg.*degrees"),
    "base targets known too well": (head("base_targets_u_mm", 1e-200), TOML, "base_targets_u_mm", "0 for exact"),
    "a base target that is text": (head("base_targets", {"B1": "fre"}), TOML, "base_targets.B1", "three"),
}  # fmt: skip


@pytest.mark.parametrize("case", sorted(CASES))
def test_it_is_refused_by_name(case: str, tmp_path: Path) -> None:
    change, file, place, words = CASES[case]
    rows, header = [dict(row) for row in CAMPAIGN.rows], dict(CAMPAIGN.header)
    read_dataset(write_files(tmp_path, rows, header))  # it is the change that is refused
    change(rows, header)
    for row in rows:
        row |= {k: "" for k in rows[7] if k not in row}  # a column that only one row fills
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


def mirrored(rows: list[Row], header: dict[str, Any]) -> None:
    for row in rows:
        row["y_mm"] = -row["y_mm"]


def swapped_axes(rows: list[Row], header: dict[str, Any]) -> None:
    header["world"] = "free"
    for row in rows:
        row["x_mm"], row["y_mm"] = row["y_mm"], row["x_mm"]


def mirrored_tool_unknown(rows: list[Row], header: dict[str, Any]) -> None:
    mirrored(rows, header)
    header["world"] = "free"
    header["model"] = {"fit": [*header["model"]["fit"], "tool"]}
    header["tool_targets"] = {t: [x + 60, y - 30, z + 50] for t, (x, y, z) in header["tool_targets"].items()}


def times(factor: float) -> Change:
    def change(rows: list[Row], header: dict[str, Any]) -> None:
        for row in rows:
            for axis in ("x_mm", "y_mm", "z_mm"):
                row[axis] *= factor

    return change


def joints(order: Sequence[int]) -> Change:
    """Reorder the columns of the joints; a negative number also changes the sign."""

    def change(rows: list[Row], header: dict[str, Any]) -> None:
        for row in rows:
            read = [row[f"j{abs(k)}_deg"] * (1.0 if k > 0 else -1.0) for k in order]
            row |= {f"j{k}_deg": value for k, value in enumerate(read, start=1)}

    return change


def late_in_metres(rows: list[Row], header: dict[str, Any]) -> None:
    times(0.001)(rows, header)
    measured = [{key: row[key] for key in ("tool_target", "x_mm", "y_mm", "z_mm")} for row in rows]
    for row, before in zip(rows[1:], measured, strict=False):
        row |= before


FIT_CASES: dict[str, tuple[Change, str, str]] = {
    "fewer readings than parameters": (few(9), "set", "readings.*parameters"),
    "one target on the axis": (one_target, "tool_targets", "axis of the last joint.*second target"),
    "left-handed frame": (mirrored, "x_mm", "left-handed.*'main'.*sign of one axis"),
    "two axes in each other's place": (swapped_axes, "x_mm", "left-handed.*swap two"),
    "left-handed frame, tool unknown": (mirrored_tool_unknown, "x_mm", "left-handed"),
    "metres": (times(0.001), "x_mm", "metres.*Multiply them by 1000"),
    "inches": (times(1.0 / 25.4), "x_mm", "inches.*Multiply them by 25.4"),
    "micrometres": (times(1000.0), "x_mm", "micrometres.*Multiply them by 0.001"),
    "counted as KUKA does": (joints((-1, 2, 3, -4, 5, -6)), "j1_deg", "joints 1, 4, 6 move in the other"),
    "two pairs of columns": (joints((1, 3, 2, 5, 4, 6)), "j4_deg", "joints 4 and 5.*joints 2 and 3"),
    "rows late, and metres": (late_in_metres, "x_mm", "metres.*1 row too late"),
}


@pytest.mark.parametrize("case", sorted(FIT_CASES))
def test_what_cannot_be_identified_is_refused_by_name(case: str, tmp_path: Path) -> None:
    change, key, words = FIT_CASES[case]
    rows, header = [dict(row) for row in CAMPAIGN.rows], dict(CAMPAIGN.header)
    change(rows, header)
    path = write_files(tmp_path, rows, header)
    with pytest.raises(DataError, match=f"(?s){words}") as caught:
        identify(read_dataset(path))
    named(caught.value, "data.csv", key)


class TestLengthsAndTurns:
    """Distances and orientations that are consistent among themselves and mean something else."""

    def refused(self, cell: Cell, folder: Path, key: str, words: str, **header: Any) -> None:
        with pytest.raises(DataError, match=f"(?s){words}") as caught:
            identify(cell.dataset(folder, **header))
        assert caught.value.key == key

    @pytest.mark.parametrize("zero", [False, True])
    @pytest.mark.parametrize(("factor", "unit"), [(1000.0, "metres"), (25.4, "inches")])
    def test_unit_of_lengths(self, factor: float, unit: str, zero: bool, tmp_path: Path) -> None:
        cell = Cell(place=POSE)
        cell.measure("l", 120)
        for row in cell.rows:
            row["length_mm"] /= factor
        model = {"fit": ["base", "geometry"] + ["length_zero"] * zero}
        self.refused(cell, tmp_path, "length_mm", f"{unit}.*by {factor:g}", model=model)

    @pytest.mark.parametrize("world", ["free", "nominal"])
    def test_mirrored_base_targets(self, world: str, tmp_path: Path) -> None:
        cell = Cell(place=None if world == "nominal" else POSE)
        cell.measure("l", 160)
        given = {name: [-x, y, z] for name, (x, y, z) in cell.base_targets.items()}
        self.refused(cell, tmp_path, "base_targets", "left-handed", base_targets=given, world=world)

    @pytest.mark.parametrize(
        ("cells", "words"),
        [
            (("rot_x", "rot_y", "rot_z", "rot_w"), "scalar last"),
            (("rot_w", "-rot_x", "-rot_y", "-rot_z"), "in the other direction"),
        ],
    )
    def test_quaternions_read_wrongly(self, cells: tuple[str, ...], words: str, tmp_path: Path) -> None:
        cell = Cell(place=POSE)
        cell.measure("po", 40, ["T2"])
        for row in cell.rows:
            read = [-row[name[1:]] if name[0] == "-" else row[name] for name in cells]
            row |= zip(("rot_w", "rot_x", "rot_y", "rot_z"), read, strict=True)
        self.refused(cell, tmp_path, "rot_w..rot_z", words)


def twice(rows: list[Row], header: dict[str, Any]) -> None:
    for i in (21, 33, 41):
        rows[i] = {**rows[i - 1], "reading_id": 1000 + i, "set": "calibration"}
        rows[i - 1]["set"] = "calibration"


def narrow(rows: list[Row], header: dict[str, Any]) -> None:
    """The four calibration readings whose joint 4 stood closest together."""
    by_angle = sorted((r for r in rows if r["set"] == "calibration"), key=lambda row: row["j4_deg"])
    fours = [by_angle[i : i + 4] for i in range(len(by_angle) - 3)]
    rows[:] = min(fours, key=lambda four: four[-1]["j4_deg"] - four[0]["j4_deg"])
    header["model"] = {"fit": ["base"]}


def one_side(rows: list[Row], header: dict[str, Any]) -> None:
    for row in rows:
        row |= {"approach2": 1, "approach5": 1}


# what is done, and the words of a warning that must then be there and is not there else
TOLD: dict[str, tuple[Change, str]] = {
    "readings that are given twice": (twice, r"3 readings repeat.*1021, 1033, 1041"),
    "a joint that hardly moves": (narrow, r"Joint 4 moves only from .* deg"),
    "one side": (one_side, r"Joints 2, 5 always arrived from the same side.*backlash"),
    "noise in metres": (
        head("noise", {"kind": "isotropic", "sigma_mm": 2e-5}), r"times the declared noise.*too small",
    ),
    "noise in micrometres": (
        head("noise", {"kind": "isotropic", "sigma_mm": 20.0}), r"times the declared noise.*too large",
    ),
    "series without readings": (
        head("series", {"nihgt": {"tool_targets": {"T1": [0.0, 0.0, 1.0]}}}), r"series 'nihgt' has no readings",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", sorted(TOLD))
def test_what_limits_the_result_is_told(case: str, tmp_path: Path) -> None:
    change, words = TOLD[case]
    rows, header = [dict(row) for row in CAMPAIGN.rows], dict(CAMPAIGN.header)
    plain = identify(read_dataset(write_files(tmp_path / "1", rows, header)))
    assert not [w for w in plain.warnings if re.search(words, w)]
    change(rows, header)
    found = identify(read_dataset(write_files(tmp_path / "2", rows, header)))
    assert [w for w in found.warnings if re.search(words, w)], found.warnings


def test_a_length_measured_twice_is_no_copy(tmp_path: Path) -> None:
    """One number may come back to the last digit; only with the same time it is the same row."""
    cell = Cell()
    cell.measure("l", 120)
    for i, row in enumerate(cell.rows):
        row["t_s"] = 10.0 * i
    cell.rows[5] = {**cell.rows[4], "reading_id": "again", "t_s": 50.0}
    fine = identify(cell.dataset(tmp_path / "1"))
    assert not [w for w in fine.warnings if "repeat" in w]
    cell.rows[5]["t_s"] = 40.0
    found = identify(cell.dataset(tmp_path / "2"))
    assert [w for w in found.warnings if "1 reading repeats an earlier one" in w and "again" in w]


def test_only_as_many_readings_as_parameters(tmp_path: Path) -> None:
    """31 + beta parameters and 11 readings leave one number by which to judge the fit."""
    rows = [dict(row) for row in CAMPAIGN.rows if row["set"] == "calibration"][:11]
    data = read_dataset(write_files(tmp_path, rows, CAMPAIGN.header))
    result = identify(data)
    assert result.degrees_of_freedom >= 1


def test_a_series_that_was_only_validated_is_refused(tmp_path: Path) -> None:
    """The base of a series needs calibration rows of that series."""
    rows = [dict(row) for row in CAMPAIGN.rows]
    for row in rows:
        row["series"] = "night" if row["set"] == "validation" else "day"
    with pytest.raises(DataError, match="night"):
        read_dataset(write_files(tmp_path, rows, {**CAMPAIGN.header, "world": "free"}))

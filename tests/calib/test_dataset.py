"""Test the reading of data sets.

These would catch: a number that changes on its way through the files, a side or a previous pose taken from the
wrong row, validation rows that count as calibration rows, and rejected rows that take part. They would also catch
any text that causes a traceback instead of a message.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib import DataError, Dataset, identify, read_dataset
from calib.units import DEG
from mocks.campaign import make_campaign
from mocks.world.dataset import csv_text
from tests.calib.campaigns import Row, write_files

CAMPAIGN = make_campaign(seed=3, n=30, n_validation=10, effects=[], reference_every=10)


def column(rows: list[Row], name: str) -> np.ndarray:
    return np.array([row[name] for row in rows], dtype=float)


def fresh() -> list[Row]:
    return [dict(row) for row in CAMPAIGN.rows]


def test_a_good_file_arrives_whole(tmp_path: Path) -> None:
    rows = fresh()
    rows[4]["status"] = "rejected:beam broken"
    rows[7] |= {"x_mm": "", "y_mm": "", "z_mm": ""}
    data = read_dataset(write_files(tmp_path, rows, CAMPAIGN.header))
    assert data.name == "data.csv"
    assert data.reading_id == tuple(str(row["reading_id"]) for row in rows)
    assert list(data.sets) == [row["set"] for row in rows]
    measured = [i for i in range(len(rows)) if i != 7]
    np.testing.assert_array_equal(
        data.points[measured], [[rows[i][f"{axis}_mm"] for axis in "xyz"] for i in measured]
    )
    assert np.isnan(data.points[7]).all()
    c = data.conditions
    for k in range(6):
        np.testing.assert_allclose(c.joints[:, k], column(rows, f"j{k + 1}_deg") * DEG, rtol=1e-15)
        np.testing.assert_allclose(c.previous[:, k], column(rows, f"prev{k + 1}_deg") * DEG, rtol=1e-15)
        np.testing.assert_array_equal(c.side[:, k], column(rows, f"approach{k + 1}"))
    np.testing.assert_array_equal(c.time, column(rows, "t_s"))
    np.testing.assert_array_equal(c.temperature, column(rows, "t_air_c"))
    np.testing.assert_array_equal(c.order, np.arange(len(rows)))
    assert [c.target_names[i] for i in c.target] == [row["tool_target"] for row in rows]
    assert c.series_names == ("main",)
    assert not data.usable[4]
    assert not data.usable[7]
    assert data.usable.sum() == len(rows) - 2
    assert not np.any(data.fit_rows & data.validation_rows)
    assert set(data.sets[data.fit_rows]) == {"calibration", "reference"}
    header = data.header
    assert (header.robot.name, header.world, header.coupling) == ("abb-irb120", "nominal", "none")
    assert header.targets == {name: tuple(v) for name, v in CAMPAIGN.header["tool_targets"].items()}
    assert header.noise.repeatability == pytest.approx(0.0008 * DEG)
    assert header.groups == ("base", "geometry", "parallel_twist", "compliance")


def test_the_hash_is_that_of_both_files(tmp_path: Path) -> None:
    rows = fresh()
    one = read_dataset(write_files(tmp_path / "1", rows, CAMPAIGN.header)).sha256
    assert one == read_dataset(write_files(tmp_path / "2", rows, CAMPAIGN.header)).sha256
    assert (
        one != read_dataset(write_files(tmp_path / "3", rows, {**CAMPAIGN.header, "instrument": "x"})).sha256
    )
    rows[3]["x_mm"] += 0.001
    assert one != read_dataset(write_files(tmp_path / "4", rows, CAMPAIGN.header)).sha256


def test_unknown_columns_blank_lines_and_a_byte_order_mark_do_no_harm(tmp_path: Path) -> None:
    plain = read_dataset(write_files(tmp_path / "1", fresh(), CAMPAIGN.header))
    rows = [{**row, "j1_read_deg": 1.5, "operator": "Anna", "t_gear_c": 30.1} for row in fresh()]
    path = write_files(tmp_path / "2", rows, CAMPAIGN.header)
    text = path.read_text(encoding="utf-8").replace("\n", "\r\n", 5)
    path.write_bytes(b"\xef\xbb\xbf" + (text + "\n,,,\n\n").replace("\n,,,", "").encode())
    other = read_dataset(path)
    np.testing.assert_array_equal(plain.points, other.points)
    np.testing.assert_array_equal(plain.conditions.joints, other.conditions.joints)


@pytest.mark.parametrize(
    ("off", "said"),
    [(0.27, "joint 2 by up to 0.270 deg"), (-0.27, "joint 2 by up to"), (360.004, ""), (0.004, "")],
)
def test_joints_read_back_are_compared_with_those_commanded(off: float, said: str, tmp_path: Path) -> None:
    rows = fresh()
    for i, row in enumerate(rows):
        row["j1_read_deg"] = row["j1_deg"]
        row["j2_read_deg"] = float(row["j2_deg"]) + (off if i % 3 else 0.0) if i else ""
    path = write_files(tmp_path, rows, CAMPAIGN.header)
    words = [line for line in identify(read_dataset(path)).warnings if "read joints back" in line]
    assert len(words) == bool(said)
    assert not said or said in words[0]
    assert not any("joint 1 by" in line for line in words)


def test_a_point_at_the_origin_counts_where_the_header_says_so(tmp_path: Path) -> None:
    """A point at the origin counts if the header says that the frame begins there.

    Such a frame begins at the first point. Trackers send the same values when they see nothing.
    """
    rows = fresh()
    first = [float(rows[0][f"{axis}_mm"]) for axis in "xyz"]
    for row in rows:
        row |= {
            f"{axis}_mm": float(row[f"{axis}_mm"]) - shift for axis, shift in zip("xyz", first, strict=True)
        }
    header = {**CAMPAIGN.header, "world": "free"}
    with pytest.raises(DataError, match="measured_at_origin = true"):
        read_dataset(write_files(tmp_path, rows, header))
    data = read_dataset(write_files(tmp_path, rows, {**header, "measured_at_origin": True}))
    assert data.usable[0]


def test_sides_and_previous_poses_follow_the_order_in_time(tmp_path: Path) -> None:
    """Recorded values win; otherwise the row before in t_s counts, not the row above."""
    rows = fresh()
    for row in rows:
        for k in range(1, 7):
            del row[f"approach{k}"], row[f"prev{k}_deg"]
    rows[5]["j3_deg"] = rows[4]["j3_deg"]  # joint 3 rests on the side of its last move
    shuffled = [rows[i] for i in np.random.default_rng(1).permutation(len(rows))]
    data = read_dataset(write_files(tmp_path, shuffled, CAMPAIGN.header))
    place = {name: i for i, name in enumerate(data.reading_id)}
    expected = [1.0] * 6
    for now, row in enumerate(rows):
        got = place[str(row["reading_id"])]
        before = rows[max(now - 1, 0)]
        for k in range(6):
            angle, last = row[f"j{k + 1}_deg"], before[f"j{k + 1}_deg"]
            if angle != last:
                expected[k] = 1.0 if angle > last else -1.0
            assert data.conditions.previous[got, k] == pytest.approx(last * DEG, rel=1e-14)
            if now > 0:
                assert data.conditions.side[got, k] == expected[k], (now, k)
        assert data.conditions.order[got] == now
    assert len({tuple(s) for s in data.conditions.side}) > 10


def test_previous_angles_alone_give_the_sides(tmp_path: Path) -> None:
    rows = fresh()
    for row in rows:
        for k in range(1, 7):
            del row[f"approach{k}"]
    data = read_dataset(write_files(tmp_path, rows, CAMPAIGN.header))
    recorded = np.array([[row[f"approach{k}"] for k in range(1, 7)] for row in CAMPAIGN.rows], dtype=float)
    np.testing.assert_array_equal(data.conditions.side, recorded)


def test_series_have_their_own_targets(tmp_path: Path) -> None:
    rows = [{**row, "series": "night" if i % 2 else "day"} for i, row in enumerate(fresh())]
    header = {**CAMPAIGN.header, "series": {"night": {"tool_targets": {"T1": [0.0, 0.0, 124.0]}}}}
    data = read_dataset(write_files(tmp_path, rows, header))
    assert data.conditions.series_names == ("day", "night")
    assert data.header.targets_of("night")["T1"] == (0.0, 0.0, 124.0)
    assert data.header.targets_of("night")["T2"] == data.header.targets_of("day")["T2"]
    assert data.header.targets_of("day")["T1"] == (0.0, 0.0, 125.0)


def attempt(path: Path) -> Dataset | DataError:
    """Return the data set or the refusal; any other exception escapes and fails the test."""
    try:
        return read_dataset(path)
    except DataError as error:
        return error


CELLS = st.one_of(
    st.sampled_from(
        ["", " ", "nan", "inf", "-inf", "1e400", "1,5", "0", "-1", "1", "T1", "T9", "validation", "ok", "1_0",
         "٣", "rejected:x", "x" * 40, '"', "'", "\x00", "1e-320", "0x10", "True", "None"]
    ),
    st.floats().map(repr),
    st.text(max_size=6),
)  # fmt: skip
NAMES = st.one_of(
    st.sampled_from([*CAMPAIGN.rows[0], "", "j1", "j7_deg", "x", "t", "j1_rad", "x_m", "rot_w", "u_x_mm", "series"]),
    st.text(max_size=6),
)  # fmt: skip


@given(data=st.data())
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_only_sentences_come_back_from_any_table(tmp_path: Path, data: st.DataObject) -> None:
    table = list(csv.reader(io.StringIO(csv_text(CAMPAIGN.rows[:8]))))
    for _ in range(data.draw(st.integers(1, 4), label="changes")):
        kind = data.draw(st.sampled_from(["cell", "name", "column", "drop", "short", "row"]), label="kind")
        row = data.draw(st.integers(1, len(table) - 1), label="row") if len(table) > 1 else 0
        place = data.draw(st.integers(0, len(table[0]) - 1), label="place") if table[0] else 0
        if kind == "cell" and place < len(table[row]):
            table[row][place] = data.draw(CELLS, label="text")
        elif kind == "name" and table[0]:
            table[0][place] = data.draw(NAMES, label="text")
        elif kind == "column":
            table[0].append(data.draw(NAMES, label="text"))
            for line in table[1:]:
                line.append(data.draw(CELLS, label="cell"))
        elif kind == "drop" and table[0]:
            for line in table:
                del line[place : place + 1]
        elif kind == "short":
            table[row] = table[row][:place]
        elif kind == "row" and len(table) > 1:
            del table[row]
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(table)
    path = tmp_path / "fuzz.csv"
    path.write_text(text.getvalue(), encoding="utf-8", errors="replace", newline="")
    path.with_suffix(".toml").write_text(tomli_w.dumps(CAMPAIGN.header), encoding="utf-8")
    result = attempt(path)
    if isinstance(result, Dataset):
        assert np.isfinite(result.conditions.joints).all()
        assert result.fit_rows.any()
        assert np.isfinite(result.points[result.usable]).all()
    else:
        assert str(path) in str(result) or str(path.with_suffix(".toml")) in str(result)
        assert len(result.do) > 5


@given(text=st.text(max_size=200) | st.binary(max_size=200))
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_only_sentences_come_back_from_any_bytes(tmp_path: Path, text: str | bytes) -> None:
    path = tmp_path / "bytes.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "replace"))
    path.with_suffix(".toml").write_text(tomli_w.dumps(CAMPAIGN.header), encoding="utf-8")
    with pytest.raises(DataError):
        read_dataset(path)


HEADER_VALUES = st.one_of(
    st.none().map(lambda _: "none"),
    st.booleans(),
    st.integers(-3, 3),
    st.floats(),
    st.text(max_size=5),
    st.lists(st.floats(), max_size=4),
    st.lists(st.text(max_size=3), max_size=3),
    st.dictionaries(st.text(min_size=1, max_size=3), st.floats() | st.text(max_size=3), max_size=3),
    st.lists(st.dictionaries(st.sampled_from(["link", "mass_kg", "cog_mm"]), st.floats() | st.text(max_size=3)),
             max_size=2),
)  # fmt: skip
HEADER_KEYS = (
    "format", "robot", "instrument", "world", "joint_coupling", "gravity_base", "model", "noise", "tool_targets",
    "base_targets", "loads", "series", "holdout", "model.fit", "noise.kind", "noise.station_mm",
    "noise.range_mm", "noise.repeatability_deg", "tool_targets.T1", "series.main",
)  # fmt: skip


@given(key=st.sampled_from(HEADER_KEYS), value=HEADER_VALUES)
@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_only_sentences_come_back_from_any_header(tmp_path: Path, key: str, value: Any) -> None:
    path = write_files(tmp_path, CAMPAIGN.rows[:8], CAMPAIGN.header)
    header = {k: dict(v) if isinstance(v, dict) else v for k, v in CAMPAIGN.header.items()}
    table, _, inner = key.partition(".")
    if inner:
        header.setdefault(table, {})[inner] = value
    else:
        header[table] = value
    path.with_suffix(".toml").write_text(tomli_w.dumps(header), encoding="utf-8")
    result = attempt(path)
    assert isinstance(result, Dataset) or str(tmp_path) in str(result)


def test_readings_of_one_waypoint_are_one_pose(tmp_path: Path) -> None:
    rows = fresh()[:8]
    for row, waypoint in zip(rows, (0, 1, 2, 1, "", "", 7, 7), strict=True):
        row["waypoint"] = waypoint
    for joint in range(1, 7):
        rows[5][f"j{joint}_deg"] = rows[4][f"j{joint}_deg"]
        rows[3][f"j{joint}_deg"] += 0.003
    data = read_dataset(write_files(tmp_path, rows, CAMPAIGN.header))
    assert list(data.waypoint) == [0, 1, 2, 1, -1, -1, 7, 7]
    pose = data.conditions.pose
    alike = pose[:, None] == pose[None, :]
    assert {(int(i), int(k)) for i, k in np.argwhere(alike) if i < k} == {(1, 3), (4, 5), (6, 7)}
    np.testing.assert_array_equal(data.conditions.take([3, 4]).waypoint, [1, -1])


@pytest.mark.parametrize("number", [-1, 0.5, 1e12])
def test_a_waypoint_is_a_whole_number(tmp_path: Path, number: float) -> None:
    rows = [row | {"waypoint": number} for row in fresh()]
    with pytest.raises(DataError, match=r"line 2.*'waypoint' is .* Number the poses 0, 1, 2"):
        read_dataset(write_files(tmp_path, rows, CAMPAIGN.header))

"""Test the import of published measurements.

These would catch: a layout, decimal comma, angle unit or Euler convention read wrongly, a hold-out that differs
from its description, and foreign files that are taken for the published ones.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import DataError, read_dataset
from calib.convert import IMPORTERS, ConvertedTable
from calib.convert.ipa_ur10 import read
from tests.fuzz import formats

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "ur10_leica"
needs_data = pytest.mark.skipif(
    not (DATA / "series_B.csv").is_file(), reason="the measured UR10 is not beside the repository"
)

ROS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def small(rows: int = 30) -> list[dict[str, float]]:
    rng = np.random.default_rng(3)
    out = []
    for _ in range(rows):
        row = {f"q{k}_rad": float(rng.uniform(-3.0, 3.0)) for k in range(1, 7)}
        row |= {f"{axis}_mm": float(rng.uniform(-2000.0, 2000.0)) for axis in "xyz"}
        row |= {f"r{axis}_deg_XYZintrinsic": float(rng.uniform(-80.0, 80.0)) for axis in "xyz"}
        out.append({**row, "temp_C": float(rng.uniform(21.0, 24.0))})
    return out


def stamp(i: int) -> str:
    return f"20200714{16 + i // 60:02d}{i % 60:02d}04"


def cleaned(path: Path, rows: list[dict[str, float]]) -> Path:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["timestamp", *rows[0]])
        writer.writerows([stamp(i), *(repr(v) for v in row.values())] for i, row in enumerate(rows))
    return path


def published(path: Path, rows: list[dict[str, float]]) -> Path:
    names = {f"q{k + 1}_rad": f"{name}_joint" for k, name in enumerate(ROS)} | {
        "temp_C": "measurement_temperature"
    }
    names |= {f"{axis}_mm": f"measurement_{axis}" for axis in "xyz"}
    names |= {f"r{axis}_deg_XYZintrinsic": f"measurement_r{axis}" for axis in "xyz"}
    lines = [";".join(["Timestamp", *(names[key] for key in rows[0])])]
    for i, row in enumerate(rows):
        lines.append(";".join([stamp(i), *(repr(v).replace(".", ",") for v in row.values())]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8-sig")
    return path


def test_both_layouts_give_the_same_table(tmp_path: Path) -> None:
    rows = small()
    one, other = read(cleaned(tmp_path / "a.csv", rows)), read(published(tmp_path / "b.csv", rows))
    assert one == other
    assert len(one) == 30


def test_every_number_arrives(tmp_path: Path) -> None:
    rows = small()
    table = IMPORTERS["ipa-ur10"](published(tmp_path / "b.csv", rows)).hold_out("random", 0.2, 5)
    table.write(tmp_path / "out.csv")
    data = read_dataset(tmp_path / "out.csv")
    assert data.header.robot.name == "ur10"
    assert data.header.world == "free"
    assert "tool" in data.header.groups
    assert data.header.holdout == "random"
    for k in range(6):
        expected = [row[f"q{k + 1}_rad"] for row in rows]
        np.testing.assert_allclose(data.conditions.joints[:, k], expected, atol=1e-8)
    np.testing.assert_allclose(data.points, [[row[f"{a}_mm"] for a in "xyz"] for row in rows], atol=1e-6)
    np.testing.assert_allclose(data.conditions.temperature, [row["temp_C"] for row in rows], atol=1e-4)
    np.testing.assert_array_equal(data.conditions.time, 60.0 * np.arange(30))
    for got, row in zip(data.orientation, rows, strict=True):
        a, b, c = (math.radians(row[f"r{axis}_deg_XYZintrinsic"]) for axis in "xyz")
        # intrinsic: Rx(a) Ry(b) Rz(c), each about the axis that the last has made
        ra = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
        rb = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
        rc = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
        found = Rotation.from_quat(got, scalar_first=True).as_matrix()
        np.testing.assert_allclose(found, ra @ rb @ rc, atol=1e-7)


def test_holdouts_are_what_they_say(tmp_path: Path) -> None:
    table = read(cleaned(tmp_path / "a.csv", small(100)))
    held = {}
    for kind in ("random", "block"):
        marked = table.hold_out(kind, 0.2, 1)  # pyright: ignore[reportArgumentType]
        held[kind] = np.array(marked.columns["set"]) == "validation"
        assert held[kind].sum() == 20
        assert set(marked.columns["set"]) == {"validation", "calibration"}
        assert f'kind = "{kind}"' in marked.header
        assert marked == table.hold_out(kind, 0.2, 1)  # pyright: ignore[reportArgumentType]
        assert marked.columns != table.hold_out(kind, 0.2, 2).columns  # pyright: ignore[reportArgumentType]
    assert "set" not in table.columns
    runs = {kind: int(np.sum(np.diff(mask.astype(int)) != 0)) for kind, mask in held.items()}
    assert runs["block"] <= 8 < runs["random"]


def test_samples_of_one_waypoint_are_held_out_together() -> None:
    n = 60
    joints = [f"{i / 1000:.4f}" for i in range(n)]  # each sample of a moving robot has its own
    columns = {
        "reading_id": [str(i) for i in range(n)],
        "waypoint": [str(i % 6) for i in range(n)],
        "j1_deg": joints,
    }
    marked = ConvertedTable(columns, "").hold_out("random", 1.0 / 3.0, 1).columns
    held = [{marked["set"][i] for i in range(n) if i % 6 == waypoint} for waypoint in range(6)]
    assert sorted(map(sorted, held)) == [["calibration"]] * 4 + [["validation"]] * 2


def poses_of(joints: np.ndarray, **more: list[str]) -> ConvertedTable:
    """A table of joints (n, 2), deg."""
    columns = {"reading_id": [str(i) for i in range(len(joints))]}
    columns |= {f"j{k + 1}_deg": [f"{value:.6f}" for value in joints[:, k]] for k in range(2)}
    return ConvertedTable({**columns, **more}, "")


def test_what_is_held_out_unless_told() -> None:
    """The default hold-out keeps poses whole.

    These would catch: a pose that is split because its joints were read back, invalid readings that are counted,
    and a path drawn point by point.
    """
    rng = np.random.default_rng(2)
    poses = rng.uniform(-90.0, 90.0, (50, 2))
    read_back = np.repeat(poses, 3, axis=0) + rng.uniform(-0.02, 0.02, (150, 2))
    lost = ["lost" if i < 60 else "ok" for i in range(150)]
    found = poses_of(read_back, status=lost).hold_out()
    held = (np.array(found.columns["set"]) == "validation").reshape(50, 3)
    assert (held.all(axis=1) == held.any(axis=1)).all(), "poses stay together"
    assert held.any(axis=1).sum() == 6, "20 % of the 30 poses that were measured"
    assert not held[:20].any()
    assert found.holdout == "random"
    assert "6 of 30 poses" in found.note
    path = np.column_stack([np.linspace(-90.0, 90.0, 300), np.linspace(0.0, 40.0, 300)])
    along = poses_of(path).hold_out()
    runs = np.diff((np.array(along.columns["set"]) == "validation").astype(int))
    assert (along.holdout, along.columns["set"].count("validation")) == ("block", 60)
    assert np.count_nonzero(runs) <= 8


def test_what_is_not_held_out() -> None:
    few = poses_of(np.random.default_rng(3).uniform(-90.0, 90.0, (21, 2)))
    assert "set" not in few.hold_out().columns
    many = np.random.default_rng(1).uniform(-90.0, 90.0, (40, 2))
    assert "set" not in poses_of(many).hold_out("none").columns
    told = poses_of(many, set=["validation"] * 3 + ["calibration"] * 37)
    assert told.hold_out().columns == told.columns
    with pytest.raises(DataError, match="column 'set'"):
        told.hold_out("random")
    # a target that is seen four times: one of them is spared
    rare = poses_of(many, tool_target=["T2"] * 4 + ["T1"] * 36).hold_out("random", 0.9)
    left = [
        t for t, s in zip(rare.columns["tool_target"], rare.columns["set"], strict=True) if s == "calibration"
    ]
    assert left.count("T2") >= 3
    assert left.count("T1") >= 3


@pytest.mark.parametrize("share", [0.0, 1.0, -0.2, 1.5, math.nan])
def test_a_share_that_cannot_be(share: float) -> None:
    with pytest.raises(DataError, match="share"):
        ConvertedTable({"reading_id": ["1", "2"]}, "").hold_out("random", share, 1)


REFUSED: dict[str, tuple[Callable[[str], str], int | None, str]] = {
    "another file": (lambda _: "a,b,c\n1,2,3\n", 1, "not one of the published"),
    "empty": (lambda _: "", 1, "not one of the published"),
    "a column less": (lambda t: t.replace("temp_C", "temperature"), 1, "temp_C"),
    "text for a number": (lambda t: t.replace(t.splitlines()[4].split(",")[1], "broken"), 5, "q1_rad"),
    "a line cut short": (
        lambda t: "\n".join(t.splitlines()[:3]) + "\n" + "20200714160304,1.0\n",
        4,
        "number",
    ),
}


@pytest.mark.parametrize("case", sorted(REFUSED))
def test_foreign_files_are_refused(case: str, tmp_path: Path) -> None:
    change, line, word = REFUSED[case]
    path = cleaned(tmp_path / "a.csv", small())
    text = path.read_text(encoding="utf-8")
    assert change(text) != text
    path.write_text(change(text), encoding="utf-8")
    with pytest.raises(DataError, match=word) as caught:
        read(path)
    assert caught.value.line == line
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("case", ["missing", "header only", "binary"])
def test_files_that_hold_nothing_are_refused(case: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    if case == "header only":
        cleaned(path, small())
        path.write_text(path.read_text(encoding="utf-8").splitlines()[0] + "\n", encoding="utf-8")
    elif case == "binary":
        path.write_bytes(b"PK\x03\x04\xff\xfe\x00")
    with pytest.raises(DataError, match=str(path)):
        read(path)


@needs_data
@pytest.mark.parametrize("series", ["A", "B"])
def test_both_published_layouts_of_the_real_data_agree(series: str) -> None:
    one, other = read(DATA / f"series_{series}.csv"), read(DATA / f"original_series_{series}.csv")
    assert len(one) == {"A": 11911, "B": 1495}[series]
    assert one.header == other.header
    times = one.columns.pop("t_s"), other.columns.pop("t_s")
    assert one.columns == other.columns
    if series == "A":
        assert times[0] == times[1]
    else:
        assert set(times[0]) == set(times[1]) == {""}, "stamps rounded to the month are no time"


@pytest.mark.parametrize("cell", ["nan", "inf", "1e308", "1e400"])
def test_numbers_that_cannot_be_are_refused_by_line(cell: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(formats.cleaned().replace(b"0.1", cell.encode(), 1))
    with pytest.raises(DataError, match=r"line 2: column 'q1_rad'"):
        read(path)


def test_stamps_that_are_no_date_leave_the_time_empty(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(formats.cleaned().replace(b"20200101", b"20209999"))
    assert set(read(path).columns["t_s"]) == {""}

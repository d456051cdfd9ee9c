"""Test files of streams and points from other programs.

These would catch: a point's name taken for a coordinate or the reverse, an offset behind the coordinates taken for
one, a date misread, and a line without a point that is accepted.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.errors import DataError
from calib.foreign.files.number import seconds_of
from calib.foreign.map.entry import Column, parse_map
from calib.motion.read import read_export, read_points

HEAD = "// SpatialAnalyzer 2022.2\n// Frame: A::WORLD\n// X Y Z, Cartesian\n\n"


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("A::Path::p1, 1.5, -2.25, 3e2", "A::Path::p1"),
        ("A, Path, p1, 1.5, -2.25, 300.0", "A::Path::p1"),
        ("A Path 12 1.5 -2.25 300.0", "A::Path::12"),
        ("Path\t7\t1.5\t-2.25\t300.0", "Path::7"),
        ('"A B" p1 1.5 -2.25 300.0', "A B::p1"),
        ("A, my path, p 1, 1.5, -2.25, 300.0", "A::my path::p 1"),
        ("p1 1.5 -2.25 300.0 0.75 0.0", "p1"),  # planar and radial offset
        ("p1, 1.5, -2.25, 300.0, 0.002, 0.002, 0.003, nest 4", "p1"),  # uncertainties and a comment
        ("1.5 -2.25 300.0", ""),
    ],
)
def test_a_point_is_found_behind_its_name(tmp_path: Path, line: str, name: str) -> None:
    file = tmp_path / "points.txt"
    file.write_text(f"{HEAD}{line}\r\n{line}\r\n", encoding="utf-8")
    found = read_export(file, 25.4)
    assert found.names == (name, name)
    assert found.time is None
    np.testing.assert_allclose(found.points, [[38.1, -57.15, 7620.0]] * 2)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("11/22/2026 08:15:30.125", "11/22/2026 08:15:30.625"),
        ("11/22/2026 11:59:59.75 AM", "11/22/2026 12:00:00.25 PM"),
        ("2026-11-22T08:15:30.125Z", "2026-11-22T08:15:30.625Z"),
        ("2026-12-31 23:59:59.900", "2027-01-01 00:00:00.400"),
    ],
)
def test_time_stamps_of_points(tmp_path: Path, first: str, second: str) -> None:
    file = tmp_path / "points.txt"
    file.write_text(
        f"{HEAD}A::P::1, 1.0, 2.0, 3.0, {first}\nA::P::2, 1.0, 2.0, 3.5, {second}\n", encoding="utf-8"
    )
    found = read_export(file, 1.0)
    assert found.time is not None
    assert np.diff(found.time) == pytest.approx([0.5], abs=1e-6)
    assert found.names == ("A::P::1", "A::P::2")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("A::P::1, 1.0, 2.0\n", "line 5: is not a point"),
        ("A, B, C, D, 1.0, 2.0, 3.0\n", "line 5: is not a point"),
        ("A 1.0 nan 2.0\n", "line 5: is not a point"),
        ("", "holds no points"),
        (
            "p 1.0 2.0 3.0 2026-11-22 08:15:30\nq 1.0 2.0 3.0\n",
            "line 6: has no time stamp where other points",
        ),
    ],
)
def test_what_is_no_export_is_refused_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "points.txt"
    file.write_text(HEAD + text, encoding="utf-8")
    with pytest.raises(DataError, match=message):
        read_export(file, 1.0)


def test_points_without_times_are_no_stream(tmp_path: Path) -> None:
    file = tmp_path / "points.txt"
    file.write_text("p1 1.0 2.0 3.0\n" * 30, encoding="utf-8")
    with pytest.raises(
        DataError, match=r"without time stamps.* Export the points again with their time stamps"
    ):
        read_points(file, "spatial-analyzer[mm]")
    with pytest.raises(DataError, match="gives the unit 'ft'"):
        read_points(file, "spatial-analyzer[ft]")


def test_lost_points_of_a_stream_are_left_out(tmp_path: Path) -> None:
    file = tmp_path / "tracker.csv"
    rows = [f"{100.0 + 0.1 * i:.1f},{i + 1.0},2.0,3.0,ok" for i in range(40)]
    rows[5] = "100.5,0.0,0.0,0.0,ok"
    rows[6] = "100.6,,,,ok"
    rows[7:9] = ["100.7,8.0,2.0,3.0,lost", "100.8,9.0,2.0,3.0,Beam broken"]
    file.write_text("\n".join(["t_s,x_mm,y_mm,z_mm,status", *rows]), encoding="utf-8")
    stream = read_points(file)
    assert (len(stream.time), stream.zero) == (36, 100.0)
    assert [gap.lost for gap in stream.gaps] == [4]
    dated = file.with_name("dated.csv")
    lines = [f"2026-11-22 08:00:{i:02},{i + 1},2,3" for i in range(40)]
    dated.write_text("\n".join(["when,X,Y,Z", *lines]), encoding="utf-8")
    stream = read_points(dated, "time=when[date], x=X[in], y=Y[in], z=Z[in]")
    np.testing.assert_allclose(stream.time, np.arange(40.0))
    np.testing.assert_allclose(stream.points[0], [25.4, 50.8, 76.2])


@pytest.mark.parametrize("text", ["", "12/32/2026 10:00:00", "2026-13-01 10:00:00", "yesterday", "10:00:00"])
def test_what_is_no_date(text: str) -> None:
    assert seconds_of(text) is None


def test_a_map_names_columns_and_units() -> None:
    found = parse_map(
        "time=Time [ms][ms], x = X, of part [m] ,y=y[mm],z=z[mm]", ("time", "x", "y", "z"), "map"
    )
    assert found["time"] == Column("Time [ms]", "ms", 1e-3)
    assert found["x"] == Column("X, of part", "m", 1000.0)
    for text, message in (
        ("time=t[s],time=u[s]", "names 'time'. Name time, x, each once"),
        ("time=t[s]", "does not name 'x'"),
        ("time=t[s],x=x[s]", "gives x the unit 's'"),
        ("time=t[s],x", "'x' cannot be read"),
        ("time=t[s],w=x[mm]", "names 'w'"),
    ):
        with pytest.raises(DataError) as refusal:
            parse_map(text, ("time", "x"), "map")
        assert message in str(refusal.value)

"""`truepose align` and its HTTP request: from two files to a data set for `identify`.

Refusals are tested too.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.arm.robot import BUILT_IN
from calib.data.read import read_dataset
from calib.motion import SLOW_MM_S
from service.cli import main
from service.results.files import alignment_request
from tests.calib.moving import TOOL, Moving, simulate, write_robot, write_tracker
from tests.service.test_http_support import problem, served

ZERO_S = 1000.0  # where the robot's clock begins


@pytest.fixture(scope="module")
def moving() -> Moving:
    return simulate(4, legs=16, duration=160.0, robot_hz=50.0, rest=1.5, jump=(90.0, 0.010))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, moving: Moving) -> Path:
    out = tmp_path_factory.mktemp("streams")
    write_robot(out / "robot.csv", moving, zero=ZERO_S)
    write_tracker(out / "tracker.csv", moving)
    return out


def align(folder: Path, out: Path, *options: str, robot: str = "ur5", code: int = 0) -> dict[str, Any]:
    command = ["align", str(folder / "robot.csv"), str(folder / "tracker.csv"), str(out), "--robot", robot]
    command += ["--tool", *map(str, TOOL), "--json", str(out.with_suffix(".json")), *options]
    assert main(command) == code
    return json.loads(out.with_suffix(".json").read_text("utf-8")) if code == 0 else {}


def refused(capsys: pytest.CaptureFixture[str], folder: Path, out: Path, *options: str) -> str:
    align(folder, out, *options, code=2)
    assert not out.exists()
    return capsys.readouterr().err.splitlines()[-1]


def test_two_streams_become_a_data_set(
    folder: Path, moving: Moving, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "speeds.svg"
    found = align(folder, tmp_path / "out.csv", "--picture", str(picture), "--instrument", "leica-at960")
    assert found["format"] == "truepose-alignment/1"
    clocks = found["clocks"]
    assert clocks["offset_s"] == pytest.approx(moving.offset + ZERO_S, abs=1e-3)
    assert clocks["rate_ppm"] == pytest.approx(1e6 * moving.rate, abs=2.0)
    assert found["jump"]["step_s"] == pytest.approx(0.010, abs=1e-3)
    assert found["warnings"][0].startswith("Clock jump: from ")
    shown = capsys.readouterr().out
    assert "Clock jump: from" in shown
    # the first and the last are seen where the robot still creeps there
    assert 14 <= found["waypoints"] <= 16
    assert f"at {found['waypoints']} waypoints" in shown
    assert "lag, ms" in shown
    data = read_dataset(tmp_path / "out.csv")
    assert (len(data), data.header.instrument) == (found["rows"], "leica-at960")
    assert not set(data.waypoint[data.validation_rows]) & set(data.waypoint[data.fit_rows])
    assert data.validation_rows.sum() == found["validation"] > 0
    assert picture.read_text("utf-8").startswith("<svg ")
    assert "Speeds on one clock" in picture.read_text("utf-8")
    assert main(["identify", str(tmp_path / "out.csv")]) == 0


def test_the_uncertainty_of_the_instrument_is_the_least_of_a_row(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The uncertainty comes from the option, otherwise from the header of the stream.

    An assumed value is reported.
    """
    stated, tracker = "The instrument's uncertainty is not stated", tmp_path / "tracker.toml"
    for name in ("robot.csv", "tracker.csv"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    for options, header, least in (
        ([], "", 0.05),
        ([], '[noise]\nkind = "isotropic"\nsigma_mm = 0.2\n', 0.2),
        ([], '[noise]\nkind = "tracker"\nstation_mm = [0, 0, 0]\nrange_mm = 0.3\ntransverse_mm = 0.3\n', 0.3),
        (["--sigma", "0.4"], '[noise]\nkind = "isotropic"\nsigma_mm = 0.2\n', 0.4),
    ):
        tracker.write_text(header, "utf-8") if header else tracker.unlink(missing_ok=True)
        found = align(tmp_path, tmp_path / "out.csv", *options)
        assert any(stated in line for line in found["warnings"]) == (not header)
        assert np.nanmin(read_dataset(tmp_path / "out.csv").u_point) == pytest.approx(least, abs=0.01)
    for options, header, message in (
        (["--sigma", "0"], "", "'--sigma': is 0"),
        ([], '[noise]\nkind = "per-row"\n', "'noise.kind': is 'per-row'"),
        ([], '[noise]\nkind = "isotropic"\n', "tracker.toml"),
    ):
        tracker.write_text(header, "utf-8")
        assert message in refused(capsys, tmp_path, tmp_path / "none.csv", *options)


def test_a_foreign_recording_is_read_by_a_map(folder: Path, moving: Moving, tmp_path: Path) -> None:
    rows = np.column_stack([moving.robot_time * 1e3, moving.joints])
    header = "Timestamp, axis 1,axis 2,axis 3,axis 4,axis 5,axis 6"
    np.savetxt(tmp_path / "robot.csv", rows, "%.7f", delimiter=",", header=header, comments="")
    lines = ["// SpatialAnalyzer", "// Units: metres"]
    for i, (time, point) in enumerate(zip(moving.tracker_time + 100.0, moving.points / 1e3, strict=True)):
        stamp = f"11/22/2026 10:{int(time) // 60:02}:{time % 60:09.6f}"
        lines.append(f"A, Path, p{i}, {point[0]:.7f}, {point[1]:.7f}, {point[2]:.7f}, {stamp}")
    (tmp_path / "tracker.csv").write_text("\n".join(lines), encoding="utf-8")
    joints = ",".join(f"j{k}=axis {k}[rad]" for k in range(1, 7))
    found = align(
        tmp_path,
        tmp_path / "out.csv",
        "--robot-columns",
        f"time=Timestamp[ms],{joints}",
        "--tracker-columns",
        "spatial-analyzer[m]",
        "--holdout",
        "0",
        "--every-sample",
        "--tool-known",
    )
    assert found["jump"]["step_s"] == pytest.approx(0.010, abs=1e-3)
    assert (found["validation"], found["rows"]) == (0, found["still_samples"])
    assert read_dataset(tmp_path / "out.csv").header.targets == {"T1": TOOL}


def written(path: Path, head: str, time: np.ndarray, values: np.ndarray) -> None:
    """Write a stream whose times are whole numbers."""
    rows = zip(time.tolist(), values.tolist(), strict=True)
    lines = [",".join([str(at), *(f"{x:.6f}" for x in row)]) for at, row in rows]
    path.write_text("\n".join([head, *lines]), "utf-8")


def in_whole(folder: Path, moving: Moving, per_s: int, zero_s: int) -> None:
    """Write both streams with times in whole units, `per_s` of them per second, from `zero_s` on."""
    joints = "t_s," + ",".join(f"j{k}_deg" for k in range(1, 7))
    for name, head, time, values in (
        ("robot.csv", joints, moving.robot_time, np.degrees(moving.joints)),
        ("tracker.csv", "t_s,x_mm,y_mm,z_mm", moving.tracker_time, moving.points),
    ):
        written(folder / name, head, zero_s * per_s + np.round(time * per_s).astype(np.int64), values)


@pytest.mark.parametrize(
    ("per_s", "name"), [(10**3, "milliseconds"), (10**6, "microseconds"), (10**9, "nanoseconds")]
)
def test_whole_times_since_1970_are_known_by_their_size(
    moving: Moving, tmp_path: Path, capsys: pytest.CaptureFixture[str], per_s: int, name: str
) -> None:
    in_whole(tmp_path, moving, per_s, 1_764_000_000)
    found = align(tmp_path, tmp_path / "out.csv")
    assert found["clocks"]["offset_s"] == pytest.approx(moving.offset, abs=1e-3)
    assert found["streams"]["robot"]["begin_s"] == pytest.approx(
        1_764_000_000 + moving.robot_time[0], abs=1e-3
    )
    said = f"column 't_s' are {name} since 1970"
    assert sum(said in line for line in found["warnings"]) == 2
    assert said in " ".join(capsys.readouterr().out.split())


def test_times_in_another_unit_than_seconds_are_refused(
    moving: Moving, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.csv"
    in_whole(tmp_path, moving, 10**9, 1_764_000_000)
    declared = "time=t_s[s]," + ",".join(f"j{k}=j{k}_deg[deg]" for k in range(1, 7))
    said = refused(capsys, tmp_path, out, "--robot-columns", declared)
    assert "'t_s': holds nanoseconds since 1970, and [s] is declared. Declare [ns]" in said
    in_whole(tmp_path, moving, 10**3, 0)
    assert "'t_s': has whole numbers 20 apart" in refused(capsys, tmp_path, out)
    for per_s in (10**6, 10**9):
        in_whole(tmp_path, moving, per_s, 0)
        assert "whole numbers" in refused(capsys, tmp_path, out)
    in_whole(tmp_path, moving, 10**9, 0)
    points = "time=t_s[ns],x=x_mm[mm],y=y_mm[mm],z=z_mm[mm]"
    found = align(
        tmp_path, out, "--robot-columns", declared.replace("[s]", "[ns]"), "--tracker-columns", points
    )
    assert found["clocks"]["offset_s"] == pytest.approx(moving.offset, abs=1e-3)


def test_a_robot_file_is_named_from_the_data_set(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.toml").write_bytes((BUILT_IN / "ur5.toml").read_bytes())
    (tmp_path / "sets").mkdir()
    monkeypatch.chdir(tmp_path)
    align(folder, Path("sets/out.csv"), robot="mine.toml")
    assert 'robot = "../mine.toml"' in Path("sets/out.toml").read_text("utf-8")


def test_what_cannot_be_asked_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.csv"
    for options, message in (
        (("--tool", "nan", "0", "0"), "'--tool': is not a point on a tool"),
        (("--slower-than", "0"), "'--slower-than': is 0"),
        (("--holdout", "1"), "'--holdout': is 1"),
        (("--coupling", "fanuc-j23"), "'--coupling': is 'fanuc-j23'. Use none"),
        (("--robot-columns", "time=t_s[s]"), "'--robot-columns': does not name 'j1'"),
        (
            ("--robot-columns", "time"),
            "'--robot-columns': 'time' cannot be read. Write quantity=column[unit]",
        ),
        (("--tracker-columns", "time=t_s[h]"), "'--tracker-columns': gives time the unit 'h'"),
        (("--tracker-columns", "spatial-analyzer[mm]"), "tracker.csv, line 1: is not a point"),
        (
            ("--tracker-columns", "time=t_s[date],x=x_mm[mm],y=y_mm[mm],z=z_mm[mm]"),
            "column 't_s' is not a date",
        ),
    ):
        assert message in refused(capsys, folder, out, *options)
    align(folder, folder / "robot.csv", code=2)
    assert "would be written over" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("head", "rows", "message"),
    [
        ("t_s,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg", 6, "column 'j6_deg' is missing"),
        ("t_s,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg,j7_deg", 8, "the robot ur5 has 6 joints"),
        ("t_s,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg", 7, "these can only be radians"),
        ("timestamp," + ",".join(f"actual_q_{k}" for k in range(6)), -7, "these can only be degrees"),
    ],
)
def test_a_stream_of_other_joints_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], head: str, rows: int, message: str
) -> None:
    values = np.ones((50, abs(rows))) * (40.0 if rows < 0 else 1.0)
    values[:, 0] = 0.01 * np.arange(50)
    np.savetxt(tmp_path / "robot.csv", values, delimiter=",", header=head, comments="")
    (tmp_path / "tracker.csv").write_bytes((folder / "tracker.csv").read_bytes())
    assert message in refused(capsys, tmp_path, tmp_path / "out.csv")


def test_over_http(folder: Path, moving: Moving, tmp_path: Path) -> None:
    form = {
        "robot": "ur5",
        "tool_x_mm": TOOL[0],
        "tool_y_mm": TOOL[1],
        "tool_z_mm": TOOL[2],
        "name": "on the move",
    }
    streams = {f"{name}_csv": (folder / f"{name}.csv").read_bytes() for name in ("robot", "tracker")}
    with served(tmp_path / "record") as service:
        key = {"Idempotency-Key": "alignment-1"}
        first, again = (
            service.client.post("/alignments", data=form, files=streams, headers=key) for _ in range(2)
        )
        assert first.status_code == 202, first.text
        assert first.json()["id"] == again.json()["id"]
        path = f"/alignments/{first.json()['id']}"
        done = service.until(path, "succeeded", "failed")
        assert done["result"]["clocks"]["offset_s"] == pytest.approx(moving.offset + ZERO_S, abs=1e-3)
        assert done["result"]["warnings"][0].startswith("Clock jump")
        kept = service.client.get(f"/datasets/{done['dataset_id']}").json()
        assert (kept["name"], kept["robot"], kept["validation"]) == (
            "on the move",
            "ur5",
            done["result"]["validation"],
        )
        picture = service.client.get(f"{path}/picture.svg")
        assert picture.headers["content-type"].startswith("image/svg+xml")
        assert "sandbox" in picture.headers["content-security-policy"]
        swapped = {"robot_csv": streams["tracker_csv"], "tracker_csv": streams["robot_csv"]}
        wrong = service.client.post("/alignments", data=form, files=swapped).json()
        failed = service.until(f"/alignments/{wrong['id']}", "succeeded", "failed")
        assert failed["state"] == "failed"
        assert failed["problem"]["detail"] == "robot.csv, line 1: column 'j1_deg' is missing."
        problem(
            service.client.post("/alignments", data={**form, "robot": "../../x.toml"}, files=streams), 422
        )
        problem(service.client.post("/alignments", data={**form, "tool_x_mm": "nan"}, files=streams), 422)
        problem(service.client.get("/alignments/nobody/picture.svg"), 404)


def test_the_service_takes_for_still_what_the_alignment_does() -> None:
    assert alignment_request.SLOW_MM_S == SLOW_MM_S

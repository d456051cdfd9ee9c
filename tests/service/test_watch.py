"""`truepose watch`: its plan is a campaign, its verdict an exit code, its history a line each."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from acquisition import Run, read_campaign, read_cell, read_status
from acquisition.campaign import make_plan
from acquisition.campaign.plan import check_plan
from calib import identify, load_model, read_dataset, save_model
from calib.saved.model_checks import content_hash
from service.cli import main
from tests.service.campaigns import Rows, edit_rows, edit_text, read_rows, write_data

CELL = Path(__file__).parents[2] / "examples" / "irb120_faro" / "cell.toml"
SHIFT_MM = 0.4


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A baseline of the robot whose watches `data` measures."""
    folder = tmp_path_factory.mktemp("base")
    save_model(folder / "m.json", identify(read_dataset(write_data(folder, effects=(), n=150))))
    return folder / "m.json"


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Thirty readings of the same robot, unchanged."""
    csv = write_data(tmp_path, effects=(), n=30)
    edit_rows(csv, lambda rows: rows.__delitem__(slice(30, None)))
    return csv


def moved(rows: Rows) -> None:
    for row in rows:
        row["y_mm"] = str(float(row["y_mm"]) + SHIFT_MM)


def signed(model: Path, folder: Path, serial: str) -> Path:
    """The model as one of the robot with a serial number."""
    document = json.loads(model.read_text("utf-8"))
    document["device"] = [{"role": "robot", "serial": serial}]
    known = folder / "known.json"
    known.write_text(json.dumps(document | {"content_sha256": content_hash(document)}), "utf-8")
    return known


def judge(model: Path, data: Path, *arguments: str) -> int:
    return main(["watch", "judge", str(model), str(data), *arguments])


def test_the_exit_code_says_whether_to_act(
    model: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    verdict, history, updated = (tmp_path / name for name in ("v.json", "h.jsonl", "new.json"))
    files = ("--json", str(verdict), "--history", str(history), "--update", str(updated))
    assert judge(model, data, *files) == 0
    document = json.loads(verdict.read_text("utf-8"))
    assert (document["format"], document["verdict"], document["exit_code"]) == (
        "truepose-watch/1",
        "unchanged",
        0,
    )
    assert not updated.exists()
    assert any("serial" in note for note in document["notes"])
    edit_rows(data, moved)
    assert judge(model, data, *files) == 3
    document = json.loads(verdict.read_text("utf-8"))
    assert [cause["label"] for cause in document["causes"]] == ["base_shift"]
    size = document["causes"][0]["size"]
    assert size["value"] == pytest.approx(SHIFT_MM, abs=size["u"])
    assert document["advice"] in capsys.readouterr().out.replace("\n", " ")
    assert len(history.read_text("utf-8").splitlines()) == 2
    # with the updated model nothing has changed, and the file says where it comes from
    assert judge(updated, data) == 0
    (update,) = load_model(updated).updates
    assert (update["cause"], update["class"]) == ("base_shift", ["base_shift"])
    assert update["data_sha256"] == document["data_sha256"]


def test_what_is_not_explained_is_for_a_person(model: Path, data: Path, tmp_path: Path) -> None:
    def bent(rows: Rows) -> None:
        for row in rows:
            row["x_mm"] = str(float(row["x_mm"]) + 0.003 * float(row["j3_deg"]))

    edit_rows(data, bent)
    updated = tmp_path / "new.json"
    assert judge(model, data, "--update", str(updated)) == 6
    assert not updated.exists()


def test_a_missing_pose_is_refused_or_said(
    model: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def given_up(rows: Rows) -> None:
        rows[3] |= {"status": "rejected:no target", "x_mm": "", "y_mm": "", "z_mm": ""}

    edit_rows(data, given_up)
    assert judge(model, data) == 2
    assert "no target" in capsys.readouterr().err
    verdict = data.with_suffix(".json")
    assert judge(model, data, "--allow-missing", "--json", str(verdict)) == 0
    notes = json.loads(verdict.read_text("utf-8"))["notes"]
    assert any(note.startswith("What is left shows") and "joint 6 from 0.0" in note for note in notes)


def test_a_row_that_was_deleted_is_missed_and_one_that_was_copied_refused(
    model: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [row["reading_id"] for row in read_rows(data)]
    header = data.with_suffix(".toml")
    text = header.read_text("utf-8")
    header.write_text(f'readings = "{names[0]}-{names[-1]}"\n{text}', "utf-8")
    assert judge(model, data) == 0
    edit_rows(data, lambda rows: rows.__delitem__(3))
    assert judge(model, data) == 2
    assert f"lacks reading {names[3]} (no row)" in capsys.readouterr().err
    header.write_text(f"not_taken = 4\n{text}", "utf-8")
    assert judge(model, data) == 2
    assert "4 readings that were not taken yet" in capsys.readouterr().err
    header.write_text(text, "utf-8")
    read = next(row for row in read_rows(data) if row["set"] != "validation")
    edit_rows(data, lambda rows: rows.append(read | {"reading_id": "copy"}))
    edit_rows(data, lambda rows: rows[-2].update(t_s=""))  # a row without a time excuses no other
    assert judge(model, data) == 2
    assert f"'{read['reading_id']}' again under another id" in capsys.readouterr().err


def test_another_robot_and_another_station_are_refused(
    model: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    header = data.with_suffix(".toml")
    text = header.read_text("utf-8")
    edit_text(header, "2400.0", "2300.0")
    assert judge(model, data) == 2
    assert "--new-frame" in capsys.readouterr().err
    assert judge(model, data, "--new-frame") == 0
    header.write_text(text.replace("abb-irb120", "fanuc-lrmate200ic"), "utf-8")
    assert judge(model, data) == 2


def _warm(header: Path, rows: Rows) -> None:
    for row in rows:
        row["t_air_c"] = str(float(row["t_air_c"]) + 8.0)


def _other_robot(header: Path, rows: Rows) -> None:
    header.write_text(header.read_text("utf-8") + '\n[[device]]\nrole = "robot"\nserial = "77"\n', "utf-8")


def _other_tool(header: Path, rows: Rows) -> None:
    edit_text(header, "215.0", "216.0")


def _heavier(header: Path, rows: Rows) -> None:
    text = header.read_text("utf-8")
    header.write_text(
        f"loads = [{{ link = 6, mass_kg = 3.3, cog_mm = [50.0, 25.0, 100.0] }}]\n{text}", "utf-8"
    )


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (_other_robot, "is of the robot 77; the baseline is of the robot 12"),
        (_other_tool, "tool of the baseline"),
        (_heavier, "kg on the last link"),
        (_warm, "no law of temperature"),
    ],
)
def test_what_is_no_watch_of_this_robot_is_refused_with_what_to_do(
    model: Path,
    data: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    spoil: Callable[[Path, Rows], None],
    says: str,
) -> None:
    """Nothing is written: no verdict for a PLC, no line of a history, no model."""
    known = signed(model, tmp_path, "12")
    files = [tmp_path / name for name in ("v.json", "h.jsonl", "new.json")]
    asked = [str(x) for pair in zip(("--json", "--history", "--update"), files, strict=True) for x in pair]
    edit_rows(data, lambda rows: spoil(data.with_suffix(".toml"), rows))
    assert judge(known, data, *asked) == 2
    assert says in capsys.readouterr().err
    assert not any(file.exists() for file in files)


def test_a_baseline_of_an_older_version_is_judged_and_said_to_be_one(
    model: Path, data: Path, tmp_path: Path
) -> None:
    document = json.loads(model.read_text("utf-8"))
    for key in ("content_sha256", "device", "updates", "held_std", "left_open"):
        document.pop(key, None)
    old, verdict = tmp_path / "old.json", tmp_path / "v.json"
    old.write_text(json.dumps(document), "utf-8")
    assert judge(old, data, "--json", str(verdict)) == 0
    notes = " ".join(json.loads(verdict.read_text("utf-8"))["notes"])
    assert "older version" in notes
    assert "names no serial number" in notes
    assert "left open" in notes


def test_the_plan_is_a_campaign_of_the_cell(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, document = tmp_path / "watch.toml", tmp_path / "plan.json"
    asked = ["watch", "plan", str(model), str(CELL), "--out", str(out), "--json", str(document)]
    assert main([*asked, "--poses", "6", "--from", "60", "--targets", "T2"]) == 0
    found = json.loads(document.read_text("utf-8"))
    cell = read_cell(CELL)
    visits = [visit for visit in make_plan(cell, read_campaign(out)) if visit.kind == "pose"]
    check_plan(cell, visits)
    assert [list(visit.joints_deg) for visit in visits] == found["poses_deg"]
    assert [list(visit.sides) for visit in visits] == found["sides"]
    assert all(len({side[k] for side in found["sides"]}) == 2 for k in range(6))  # play of every joint
    causes = {cause["label"]: cause for cause in found["causes"]}
    assert causes["joint_step:j6"]["never_apart_from"] == ["tool_shift"]
    assert causes["joint_step:j1"]["alone_from"] is None
    assert "joint_step:j2" in capsys.readouterr().out
    assert main([*asked, "--poses", "3"]) == 2
    assert main([*asked, "--targets", "T9"]) == 2


def motions(record: Path) -> int:
    """The number of times that the robot of a record has arrived somewhere, or tried."""
    with Run.open(record) as run:
        return sum(each.kind in ("arrived", "attempt_failed") for each in run.events())


def test_a_watch_is_driven_exported_and_judged(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The robot of the simulated cell is not that of the model, so it must not pass."""
    campaign, record, verdict = tmp_path / "watch.toml", tmp_path / "record", tmp_path / "v.json"
    asked = ["--poses", "4", "--from", "30", "--visits", "1", "--readings", "2"]
    plan = ["watch", "plan", str(model), str(CELL), "--out", str(campaign), *asked]
    assert main([*plan, "--targets", "T2"]) == 0
    heavier = tmp_path / "heavier.toml"
    heavier.write_text(CELL.read_text("utf-8").replace("mass_kg = 2.7", "mass_kg = 3.1"), "utf-8")
    assert main(["watch", "run", str(model), str(heavier), str(campaign), "--record", str(record)]) == 2
    assert not record.exists()  # nothing has moved
    run = ["watch", "run", str(model), str(CELL), str(campaign), "--record", str(record), "--simulate"]
    other = tmp_path / "other"
    assert (
        main(["watch", "run", str(signed(model, tmp_path, "12")), *run[3:6], str(other), "--simulate"]) == 5
    )
    told = capsys.readouterr().err
    assert "another robot answers" in told
    assert "serial number 12." in told
    assert "--accept-device" not in told
    assert read_status(other).done == 0
    assert motions(other) == 0
    assert main([*run, "--json", str(verdict)]) in (3, 6)
    assert motions(record) == 4
    document = json.loads(verdict.read_text("utf-8"))
    assert document["verdict"] != "unchanged"
    assert document["questions"][0]["values"] == 24
    dataset = read_dataset(record / "watch.csv")
    assert set(dataset.header.nests) == {"N1", "N2", "N3"}
    assert main(run) == 2  # a watch has a record of its own

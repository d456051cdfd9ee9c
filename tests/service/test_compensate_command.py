"""`truepose compensate`: exit codes, written files, refusals, conditions, and its JSON."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from service.cli import main
from tests.service.campaigns import edit_text, write_data
from tests.service.robot_programs import LS, RAPID, TABLE, write

JOINTS = """target_id,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg
a,10,20,-30,40,50,60
b,-20,30,-10,-40,-50,0
"""


def run(model: Path, program: Path, *options: str) -> tuple[int, Path]:
    out = program.with_name(f"out{program.suffix}")
    return main(["compensate", str(model), str(program), str(out), *options]), out


def document_of(model: Path, program: Path, *options: str) -> tuple[int, dict[str, Any]]:
    result = program.with_name("r.json")
    code, _ = run(model, program, *options, "--json", str(result))
    return code, json.loads(result.read_text("utf-8"))


def joints_of(path: Path) -> np.ndarray:
    rows = path.read_text("utf-8").splitlines()[1:]
    return np.array([[float(cell) for cell in row.split(",")[1:7]] for row in rows])


def test_a_module_is_corrected_and_told(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out = run(model, write(tmp_path, "a.mod", RAPID))
    shown = capsys.readouterr()
    assert code == 0
    assert out.read_text("utf-8") != RAPID
    assert "6 targets corrected, moved by" in shown.out
    for piece in ("p1", "path{2}", "approach from below", "rounded"):
        assert piece in shown.out
    assert "correcting 6 targets" in shown.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mod", "out.mod"]


def test_a_program_that_is_corrected_already_is_noticed(model: Path, tmp_path: Path) -> None:
    code, document = document_of(model, write(tmp_path, "a.mod", RAPID))
    assert (code, any("was written by" in each for each in document["warnings"])) == (0, False)
    again = tmp_path / "again"
    again.mkdir()
    corrected, result = tmp_path / "out.mod", again / "r.json"
    assert main(["compensate", f"{model}", f"{corrected}", f"{again / 'b.mod'}", "--json", f"{result}"]) == 0
    warnings = json.loads(result.read_text("utf-8"))["warnings"]
    assert any("out.mod was written by truepose compensate" in each for each in warnings)


def test_the_document(model: Path, tmp_path: Path) -> None:
    code, document = document_of(model, write(tmp_path, "a.mod", RAPID))
    assert code == 0
    assert document["format"] == "truepose-compensation/1"
    assert document["robot"] == "abb-irb120"
    assert (document["corrected"], document["refused"], document["empty"]) == (6, 0, 0)
    assert document["conditions"]["side_of_model_joints"] == [1] * 6
    first = document["targets"][0]
    assert (first["target"], first["line"], first["kind"], first["status"]) == (
        "j1",
        11,
        "joints",
        "corrected",
    )
    assert 0.05 < first["moved_mm"] < 10.0
    assert 0.0 <= first["quantised_mm"] < 1e-4
    assert document["largest_move_mm"] == max(t["moved_mm"] for t in document["targets"])


def test_json_on_standard_output_stands_alone(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _ = run(model, write(tmp_path, "t.csv", JOINTS), "--json", "-")
    assert code == 0
    assert json.loads(capsys.readouterr().out)["corrected"] == 2


def test_with_a_refused_target_nothing_is_written_unless_asked_for(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = write(tmp_path, "t.csv", JOINTS.replace("-40,-50", "-40,0.1"))
    code, document = document_of(model, program)
    shown = capsys.readouterr()
    assert code == 2
    assert "t.csv, line 3: target 'b' cannot be corrected: close to a singular pose" in shown.err
    assert document["out"] is None
    assert document["targets"][1]["status"] == "refused"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["r.json", "t.csv"]
    code, out = run(model, program, "--keep-refused")
    assert code == 3
    np.testing.assert_array_equal(joints_of(out)[1], [-20.0, 30.0, -10.0, -40.0, 0.1, 0.0])
    assert np.max(np.abs(joints_of(out)[0] - [10, 20, -30, 40, 50, 60])) > 0.005


def test_the_side_of_approach_moves_the_joint_with_backlash(model: Path, tmp_path: Path) -> None:
    program = write(tmp_path, "t.csv", JOINTS)
    stood = []
    for side in ("below", "above", "1:1:1:-1:1:1"):
        code, out = run(model, program, "--conditions", f"side={side}")
        assert code == 0
        stood.append(joints_of(out))
    below, above, fourth = stood
    assert np.min(np.abs(above - below)[:, 3]) > 0.01
    np.testing.assert_allclose(
        fourth, above, atol=2e-4
    )  # nothing but the play of joint 4 depends on the side


def test_the_payload_is_carried_by_the_compliances(model: Path, tmp_path: Path) -> None:
    program = write(tmp_path, "t.csv", JOINTS)
    moves = []
    for condition in ("mass=0.1,cog=0:0:50", "mass=5,cog=0:0:150"):
        code, document = document_of(model, program, "--conditions", condition)
        assert code == 0
        assert document["conditions"]["mass_kg"] == float(condition.split("=")[1].split(",")[0])
        moves.append(joints_of(program.with_name("out.csv")))
    assert np.max(np.abs(moves[1] - moves[0])) > 0.005


def test_there_and_back(model: Path, tmp_path: Path) -> None:
    _, out = run(model, write(tmp_path, "t.csv", JOINTS))
    back = tmp_path / "back.csv"
    assert main(["compensate", str(model), str(out), str(back), "--inverse"]) == 0
    np.testing.assert_allclose(joints_of(back), joints_of(tmp_path / "t.csv"), atol=1e-6)


@pytest.mark.parametrize(
    ("conditions", "what"),
    [
        ("side=left", "'--conditions side'"),
        ("side=1:1", "'--conditions side'"),
        ("sides=1", "'sides=1' is not a condition"),
        ("time=1,time=2", "given twice"),
        ("temperature=warm", "'--conditions temperature': 'warm' is not a number"),
        ("temperature=nan", "'--conditions temperature'"),
        ("mass=2", "'--conditions cog'"),
        ("cog=1:2:3", "'--conditions mass'"),
        ("mass=-1,cog=1:2:3", "above zero"),
        ("series=night", "is not a series of the model"),
    ],
)
def test_conditions_that_cannot_be(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], conditions: str, what: str
) -> None:
    code, out = run(model, write(tmp_path, "t.csv", JOINTS), "--conditions", conditions)
    assert code == 2
    assert what in capsys.readouterr().err
    assert not out.exists()


def test_a_table_comes_back_without_formulas_and_means_what_it_did(model: Path, tmp_path: Path) -> None:
    head = "\ufefftarget_id,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg,note, =SUM(A1)\r\n"
    rows = (
        '=1+1,10,20,-30,40,50,60,"=HYPERLINK(""http://a"",""b"")",1\r\n'
        "b,-20,+30,-10,-40,-50,0, @SUM(A1),-2.5\r\n"
    )
    program = tmp_path / "a.csv"
    program.write_bytes((head + rows).encode("utf-8"))
    code, out = run(model, program)
    assert code == 0
    written = out.read_bytes().decode("utf-8")
    cells = list(csv.reader(io.StringIO(written.removeprefix("\ufeff"), newline="")))
    assert (cells[0][-1], cells[1][0], cells[1][7]) == (" '=SUM(A1)", "'=1+1", '\'=HYPERLINK("http://a","b")')
    assert cells[2][7:] == [" '@SUM(A1)", "-2.5"]  # a number is none
    assert written.startswith("\ufefftarget_id,j1_deg")
    assert written.count("\r\n") == 3
    again = tmp_path / "again.csv"
    again.write_text(written, encoding="utf-8", newline="")
    _, document = document_of(model, again)
    assert [each["target"] for each in document["targets"]] == ["=1+1", "b"]
    assert out.read_text("utf-8").count("'") == written.count("'") == 4  # and not once more


def test_programs_of_another_robot_and_names_that_mislead(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = write(tmp_path, "a.ls", LS)
    assert run(model, program)[0] == 2
    assert "a.ls: is a Fanuc program, and the model is of abb-irb120 by ABB" in capsys.readouterr().err
    table = write(tmp_path, "t.csv", TABLE)
    assert main(["compensate", str(model), str(table), str(tmp_path / "o.mod")]) == 2
    assert "another kind of program" in capsys.readouterr().err
    assert main(["compensate", str(model), str(table), str(table)]) == 2
    assert "would be written over" in capsys.readouterr().err
    assert main(["compensate", str(model), str(tmp_path / "no.csv"), str(tmp_path / "o.csv")]) == 2
    assert "no such file" in capsys.readouterr().err


def test_a_damaged_model_is_refused(model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    damaged = tmp_path / "m.json"
    damaged.write_bytes(model.read_bytes())
    edit_text(damaged, '"truepose-model/1"', '"something/1"')
    code, out = run(damaged, write(tmp_path, "t.csv", JOINTS))
    assert code == 2
    assert "is not a model file" in capsys.readouterr().err
    assert not out.exists()


def test_a_robot_whose_controller_corrects_as_well_is_not_corrected_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, model = write_data(tmp_path, n=60), tmp_path / "m.json"
    edit_text(data.with_suffix(".toml"), 'world = "', 'absolute_accuracy = "off"\nworld = "')
    assert main(["identify", str(data), "--model", str(model)]) == 0
    table = write(tmp_path, "t.csv", JOINTS)
    assert json.loads(model.read_text("utf-8"))["holds_for"]["absolute_accuracy"] == "off"
    capsys.readouterr()
    code, out = run(model, table, "--conditions", "absolute-accuracy=on")
    assert code == 2
    assert "identified with the controller's absolute accuracy off" in capsys.readouterr().err
    assert not out.exists()
    assert run(model, table)[0] == 0
    assert "corrected twice" in capsys.readouterr().err
    assert run(model, table, "--conditions", "absolute-accuracy=off")[0] == 0
    assert "corrected twice" not in capsys.readouterr().err
    assert run(model, table, "--conditions", "absolute-accuracy=perhaps")[0] == 2
    later = write_data(tmp_path / "later", n=60)
    edit_text(later.with_suffix(".toml"), 'world = "', 'absolute_accuracy = "on"\nworld = "')
    assert main(["validate", str(later), "--model", str(model)]) == 2
    assert "absolute accuracy off" in capsys.readouterr().err

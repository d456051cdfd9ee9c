"""Refusals of bad input: a sentence that names file and line or key, exit code 2.

There is no traceback.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from service.cli import main
from tests.service.campaigns import Rows, edit_rows, edit_text, write_data

JOINTS = [f"j{k}_deg" for k in range(1, 7)]


def rename(rows: Rows, old: str, new: str) -> None:
    for row in rows:
        items = [(new if name == old else name, cell) for name, cell in row.items()]
        row.clear()
        row.update(items)


def drop(rows: Rows, name: str) -> None:
    for row in rows:
        del row[name]


def add(rows: Rows, name: str, cell: str) -> None:
    for row in rows:
        row[name] = cell


def to_radians(rows: Rows) -> None:
    for row in rows:
        for name in JOINTS:
            row[name] = str(math.radians(float(row[name])))


def keep_few(rows: Rows) -> None:
    rows[:] = [row for row in rows if row["set"] == "calibration"][:8]


def keep_targets_on_axis(rows: Rows) -> None:
    rows[:] = [row for row in rows if row["tool_target"] == "T1"]


def repeat_the_first(rows: Rows) -> None:
    for i, row in enumerate(rows):
        row.update({**rows[0], "reading_id": str(i), "set": "calibration"})


BAD_ROWS: dict[str, tuple[Callable[[Rows], object], str]] = {
    "without units": (
        lambda rows: rename(rows, "j1_deg", "j1"),
        r"data\.csv, line 1: column 'j1' has no unit",
    ),
    "in metres": (lambda rows: rename(rows, "x_mm", "x_m"), r"data\.csv, line 1: .*'x_m'"),
    "missing column": (lambda rows: drop(rows, "y_mm"), r"data\.csv, line 1: column 'y_mm' is missing"),
    "NaN": (lambda rows: rows[3].update(z_mm="nan"), r"data\.csv, line 5: column 'z_mm' is 'nan'"),
    "joint missing": (lambda rows: drop(rows, "j6_deg"), r"data\.csv, line 1: column 'j6_deg' is missing"),
    "joint too many": (lambda rows: add(rows, "j7_deg", "0"), r"data\.csv, line 1: column 'j7_deg'"),
    "radians": (to_radians, r"data\.csv, key 'j1_deg': .*radians"),
    "no calibration rows": (
        lambda rows: add(rows, "set", "validation"),
        r"data\.csv, key 'set': .*calibration",
    ),
    "fewer readings than parameters": (keep_few, r"data\.csv, key 'set': has 8 calibration readings"),
    "all readings the same": (repeat_the_first, r"data\.csv.*: all calibration readings are the same"),
    "one target on the axis": (keep_targets_on_axis, r"data\.csv, key 'tool_targets': "),
}


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The message of a command that must end with code 2."""
    code = main(arguments)
    shown = capsys.readouterr()
    assert code == 2, shown.err
    assert shown.out == ""
    assert "Traceback" not in shown.err
    return shown.err


@pytest.mark.parametrize("command", ["identify", "diagnose"])
@pytest.mark.parametrize("case", BAD_ROWS)
def test_bad_rows_are_refused(
    case: str, command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = write_data(tmp_path)
    change, message = BAD_ROWS[case]
    edit_rows(data, change)
    assert re.search(message, refused([command, str(data)], capsys))


def test_an_unknown_robot_is_refused_with_the_nearest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = write_data(tmp_path)
    edit_text(data.with_suffix(".toml"), '"abb-irb120"', '"kuka-kr6"')
    message = refused(["diagnose", str(data)], capsys)
    assert "data.toml, key 'robot': unknown robot 'kuka-kr6'" in message
    assert "Did you mean 'kuka-kr6-r900'?" in message


def test_a_file_without_header_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = write_data(tmp_path)
    data.with_suffix(".toml").unlink()
    assert "data.toml: is missing" in refused(["identify", str(data)], capsys)


def test_accuracy_cannot_be_asked_for_without_validation_rows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = write_data(tmp_path)
    edit_rows(data, lambda rows: add(rows, "set", "calibration"))
    message = refused(["diagnose", str(data), "--accept-rms", "0.1"], capsys)
    assert "data.csv, key 'set': has no measured validation rows" in message


def test_an_output_folder_that_is_not_there_is_told_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = write_data(tmp_path)
    message = refused(["diagnose", str(data), "--report", str(tmp_path / "no" / "report.html")], capsys)
    assert "report.html: cannot be written" in message
    assert "searching" not in message


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("diagnose {a} --json {a}", r"--json .*data\.csv: would be written over .*which is read"),
        ("diagnose {a} --model {header}", r"--model .*data\.toml: would be written over"),
        ("diagnose {a} --carry-to {b} --report {b}", r"--report .*other\.csv: would be written over"),
        ("diagnose {a} --predictions {link}", r"--predictions .*link\.csv: would be written over"),
        ("diagnose {a} --json {new} --report {new}", r"--report .*new: is the same file as --json"),
        (
            "diagnose {a} --model {folder}/../new --report {new}",
            r"--report .*new: is the same file as --model",
        ),
        ("diagnose {a} --report {folder}", r"--report .*folder: is a folder"),
        ("diagnose {a} --json {empty}", r"--json: is empty"),
        ("diagnose {a} --json /dev/null", r"--json /dev/null: is not an ordinary file"),
        ("diagnose {a} --report {loop}", r"--report .*loop: leads nowhere"),
        ("identify {a} --model {a}", r"--model .*data\.csv: would be written over"),
        ("identify {a} --json {new} --model {new}", r"--model .*new: is the same file as --json"),
        ("convert {a} {a} --from ipa-ur10", r"OUT\.csv .*data\.csv: would be written over"),
        ("convert {header} {a} --from ipa-ur10", r"OUT\.csv .*data\.toml: would be written over"),
        ("convert {a} {new}.csv --from ipa-ur10 --json {new}.toml", r"--json .*is the same file as header"),
        ("demo --out {folder} --json {folder}/data.csv", r"--json .*data\.csv: would be written over"),
        ("demo --out {a}", r"--out .*data\.csv: is not a folder"),
        ("diagnose {a} --accept-rms nan", r"--accept-rms: is nan. Give an error above 0 mm"),
        ("diagnose {a} --accept-rms inf", r"--accept-rms: is inf"),
        ("diagnose {a} --accept-rms 0", r"--accept-rms: is 0"),
        ("diagnose {a} --accept-rms -1", r"--accept-rms: is -1"),
    ],
)
def test_outputs_never_replace_what_is_read(
    words: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a = write_data(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "other.csv").write_bytes(a.read_bytes())
    (tmp_path / "other.toml").write_bytes(a.with_suffix(".toml").read_bytes())
    (tmp_path / "link.csv").symlink_to(a)
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    names = {"a": a, "b": tmp_path / "other.csv", "header": a.with_suffix(".toml"), "empty": ""}
    names |= {name: tmp_path / name for name in ("folder", "new", "loop")} | {"link": tmp_path / "link.csv"}
    shown = refused([word.format(**names) for word in words.split()], capsys)
    assert re.search(message, shown)
    assert "truepose: reading" not in shown
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["convert", "{file}", "{out}.csv", "--from", "nobody"], r"--from.*'nobody' is not a known kind"),
        (["convert", "{file}", "{out}", "--from", "ipa-ur10"], r"Let it end in \.csv"),
        (["convert", "{file}", "{out}.csv", "--from", "ipa-ur10"], r"line 1: is not one of the published"),
        (["convert", "{file}x", "{out}.csv", "--from", "ipa-ur10"], r"there is no such file"),
        (["diagnose"], r"Missing argument"),
        (["diagnose", "{file}", "--most", "many"], r"--most"),
        (["dance"], r"No such command 'dance'"),
    ],
)
def test_wrong_command_lines_are_refused(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = write_data(tmp_path)
    words = [word.format(file=data, out=tmp_path / "out") for word in arguments]
    assert re.search(message, refused(words, capsys))

"""Files that commands may replace.

These would catch: a command that writes over a file of a person, over the companion file of its output, or over its own
output after it was edited. They would also catch a command that cannot be run twice.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from calib.errors import DataError
from calib.text import replace_file
from service import written
from service.cli import main
from service.commands import options
from tests.service.campaigns import write_data

# The output is the last argument
COMMANDS: dict[str, Callable[[Path, Path], list[str]]] = {
    "identify --report": lambda data, out: ["identify", f"{data}", "--report", f"{out}.html"],
    "identify --json": lambda data, out: ["identify", f"{data}", "--json", f"{out}.json"],
    "identify --model": lambda data, out: ["identify", f"{data}", "--model", f"{out}.json"],
    "diagnose --predictions": lambda data, out: ["diagnose", f"{data}", "--predictions", f"{out}.csv"],
    "regress --json": lambda data, out: ["regress", f"{data}", "--json", f"{out}.json"],
    "validate --json": lambda data, out: [
        "validate", f"{data}", "--model", f"{data.with_name('m.json')}", "--json", f"{out}.json"
    ],
    "export": lambda data, out: ["export", f"{data.with_name('m.json')}", "--as", "dh-csv", f"{out}.csv"],
    "compensate": lambda data, out: [
        "compensate", f"{data.with_name('m.json')}", f"{data.with_name('p.mod')}", f"{out}.mod"
    ],
}  # fmt: skip
PROGRAM = """MODULE Here
  CONST jointtarget a := [[10,-20,30,0,45,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
ENDMODULE
"""


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = write_data(tmp_path_factory.mktemp("written"), n=50)
    data.with_name("p.mod").write_text(PROGRAM, "utf-8")
    assert main(["identify", str(data), "--model", str(data.with_name("m.json"))]) == 0
    return data


@pytest.mark.parametrize("name", COMMANDS)
def test_only_what_a_command_has_written_is_replaced(name: str, data: Path, tmp_path: Path) -> None:
    command = COMMANDS[name](data, tmp_path / "kinds")
    out = Path(command[-1])
    out.write_text("mine\n", "utf-8")
    assert main(command) == 2
    assert out.read_text("utf-8") == "mine\n"
    assert sorted(tmp_path.iterdir()) == [out]
    assert main([*command, "--overwrite"]) == 0
    assert out.read_bytes() != b"mine\n"
    assert main(command) == 0, "its own file may be made anew"
    out.write_bytes(out.read_bytes() + b"\n")
    assert main(command) == 2, "it was edited"


def test_what_another_command_wrote_is_kept(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A model is no place for a results table, nor a data set for a report.

    It does not matter that a command wrote both.
    """
    model, table = tmp_path / "m.json", tmp_path / "dh.csv"
    assert main(["identify", f"{data}", "--model", f"{model}"]) == 0
    assert main(["export", f"{model}", "--as", "dh-csv", f"{table}"]) == 0
    for command, out in (
        (["identify", f"{data}", "--json"], model),
        (["regress", f"{data}", "--model"], model),
        (["validate", f"{data}", "--model", f"{model}", "--report"], table),
    ):
        before = out.read_bytes()
        capsys.readouterr()
        assert main([*command, f"{out}"]) == 2
        assert "was written by truepose " in capsys.readouterr().err
        assert out.read_bytes() == before
    assert main(["identify", f"{data}", "--model", f"{model}"]) == 0


def test_a_protected_file_or_folder_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that was marked as read-only could be replaced, as its folder may be written into."""
    out = tmp_path / "m.json"
    options.check_outputs({"--model": out})
    replace_file(out, "kept\n")
    options.check_outputs({"--model": out})
    out.chmod(0o444)
    with pytest.raises(DataError, match="write-protected"):
        options.check_outputs({"--model": out})
    monkeypatch.setattr(options.os, "access", lambda path, mode: path != tmp_path)
    with pytest.raises(DataError, match="may not write into its folder"):
        options.check_outputs({"--model": tmp_path / "new.json"})


@pytest.mark.parametrize(
    "command", [["convert", "in.csv", "--out"], ["align", "in.csv", "t.csv", "--tool", "0", "0", "0"]]
)
def test_the_file_of_the_robot_is_no_header(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The header of `kr10.csv` would be the robot file of `--robot kr10.toml`.

    This must be refused even with --overwrite.
    """
    monkeypatch.chdir(tmp_path)
    for name in ("in.csv", "t.csv", "kr10.toml"):
        (tmp_path / name).write_text("mine\n", "utf-8")
    assert main([*command, "kr10.csv", "--robot", "kr10.toml", "--overwrite"]) == 2
    assert "would be written over kr10.toml, which is read" in capsys.readouterr().err
    assert (tmp_path / "kr10.toml").read_text("utf-8") == "mine\n"


def test_what_is_only_added_to_and_what_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A history may come from anywhere, because its lines are kept.

    No option lets a command write over its input.
    """
    monkeypatch.setattr(written, "overwriting", False)  # an earlier command here may have been allowed to
    history, read = tmp_path / "history.jsonl", tmp_path / "data.csv"
    history.touch()
    read.touch()
    options.check_outputs({"--history": history}, added_to=["--history"])
    with pytest.raises(DataError, match="is there already"):
        options.check_outputs({"--history": history})
    with pytest.raises(DataError, match="which is read"):
        options.check_outputs({"--out": read}, inputs=[read])


def test_a_file_that_was_put_there_during_the_work_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(written, "overwriting", False)
    out = tmp_path / "report.html"
    options.check_outputs({"--report": out})
    replace_file(out, "its own\n")
    replace_file(out, "its own again\n")
    out.write_text("mine\n", "utf-8")
    with pytest.raises(DataError, match=r"report\.html: was put there"):
        replace_file(out, "its own\n")
    assert [file.read_text("utf-8") for file in tmp_path.iterdir()] == ["mine\n"]
    options.check_outputs({"--report": out}, added_to=["--report"])
    replace_file(out, "mine\nand its own\n")


@pytest.mark.parametrize("replaced", [False, True])
def test_a_command_that_was_killed_while_it_wrote_knows_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, replaced: bool
) -> None:
    monkeypatch.setattr(written, "overwriting", False)
    out = tmp_path / "m.json"
    options.check_outputs({"--model": out})
    replace_file(out, "first\n")
    replace = os.replace

    def killed(source: Path, target: Path) -> None:
        if target != out:
            return replace(source, target)  # of a note
        if replaced:
            replace(source, target)
        raise SystemExit

    for text in ("second\n", "third\n"):
        monkeypatch.setattr(os, "replace", killed)
        with pytest.raises(SystemExit):
            replace_file(out, text)
        monkeypatch.setattr(os, "replace", replace)
        monkeypatch.setattr(written, "_done", {})  # as in the next program
        options.check_outputs({"--model": out})
    replace_file(out, "fourth\n")
    assert out.read_text("utf-8") == "fourth\n"


def test_a_disk_that_is_full_is_reported_with_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as refused:
        replace_file(tmp_path / "report.html", "text\n")
    assert refused.value.filename == str(tmp_path / "report.html")
    assert not list(tmp_path.iterdir())


def test_a_folder_in_which_no_demo_has_run_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "cell.toml").write_text("mine\n", "utf-8")
    assert main(["demo", "--in-memory", "--out", str(tmp_path)]) == 2
    assert [(file.name, file.read_text("utf-8")) for file in tmp_path.iterdir()] == [("cell.toml", "mine\n")]


def test_what_was_changed_in_the_folder_of_a_demo_is_kept(tmp_path: Path) -> None:
    options.check_outputs({})
    replace_file(tmp_path / "cell.toml", "of the demo\n")
    (tmp_path / "truth.json").write_text("{}", "utf-8")
    (tmp_path / "cell.toml").write_text("mine\n", "utf-8")
    assert main(["demo", "--in-memory", "--out", str(tmp_path)]) == 2
    assert (tmp_path / "cell.toml").read_text("utf-8") == "mine\n"


def test_the_file_beside_the_one_that_is_written_is_kept(tmp_path: Path) -> None:
    """A data set has two files: next to kinds.csv is kinds.toml.

    It may be a cell file of the user.
    """
    cell = tmp_path / "kinds.toml"
    cell.write_text("mine\n", "utf-8")
    with pytest.raises(DataError, match=r"header of OUT.csv .*kinds\.toml: is there already"):
        options.check_data_set(tmp_path / "kinds.csv", None, ())
    cell.unlink()
    options.check_data_set(tmp_path / "kinds.csv", None, ())

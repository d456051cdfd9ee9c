"""`truepose convert` with custom files.

These would catch: an open question that is skipped without a terminal, and a map or a data set that is written although
it was refused. They would also catch an answer that is ignored.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
import typer

from calib.data import read_dataset
from service.cli import main
from service.results.files.conversion import ConversionResult
from tests.calib.exports import CASES, ROBOT, N
from tests.service.test_openapi import unnamed


def files_of(name: str, folder: Path) -> list[str]:
    return [str(path) for path in next(case for case in CASES if case.name == name).write(folder)]


def test_a_file_of_ones_own_becomes_a_data_set_and_its_map_is_kept_and_reused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files, out, again = files_of("excel_german", tmp_path), tmp_path / "out.csv", tmp_path / "again.csv"
    assert main(["convert", *files, "--robot", ROBOT, "--out", str(out), "--sigma", "0.1"]) == 0
    shown = capsys.readouterr().out
    assert "left aside" in shown
    assert "these fit abb-irb120 to 0.4" in shown
    assert shown.count("names the columns") == 1, "once, although a proposal and the conversion say it"
    assert (
        main(["convert", *files, "--map", str(tmp_path / "out.map.toml"), "-o", str(again), "--json", "-"])
        == 0
    )
    assert again.read_text("utf-8") == out.read_text("utf-8")
    result = ConversionResult.model_validate_json(capsys.readouterr().out)
    assert unnamed(result) == set()
    assert result.fit is not None
    assert result.fit.miss_mm == pytest.approx(0.42, abs=0.06)
    data = read_dataset(again)
    assert len(data) == N
    assert data.header.noise.sigma_mm == 0.1
    assert data.header.holdout == "random"
    assert data.validation_rows.sum() == 5, "20 % of 24 poses"
    assert "5 of 24 poses" in " ".join(shown.split())


def test_the_hold_out_that_was_chosen_is_kept_in_the_map(tmp_path: Path) -> None:
    files, out, again = files_of("excel_german", tmp_path), tmp_path / "out.csv", tmp_path / "again.csv"
    assert main(["convert", *files, "--robot", ROBOT, "--out", str(out), "--holdout", "none"]) == 0
    assert not read_dataset(out).validation_rows.any()
    kept = ["convert", *files, "--map", str(tmp_path / "out.map.toml"), "--out", str(again)]
    assert main(kept) == 0
    assert not read_dataset(again).validation_rows.any()
    assert main([*kept, "--holdout", "block", "--share", "0.4"]) == 0
    assert read_dataset(again).header.holdout == "block"
    assert read_dataset(again).validation_rows.sum() == pytest.approx(0.4 * N, abs=2)


def test_a_map_that_was_changed_is_not_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files, out = files_of("excel_german", tmp_path), tmp_path / "out.csv"
    asked = ["convert", *files, "--robot", ROBOT, "--out", str(out)]
    assert main(asked) == 0
    assert main(asked) == 0  # as this command has written it
    kept = out.with_suffix(".map.toml")
    changed = kept.read_text("utf-8") + "# mine\n"
    kept.write_text(changed, "utf-8")
    assert main(asked) == 2
    assert "out.map.toml" in capsys.readouterr().err
    assert kept.read_text("utf-8") == changed


def test_without_a_terminal_questions_end_with_2_and_stand_in_the_map(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files, out, kept = files_of("by_order", tmp_path), tmp_path / "out.csv", tmp_path / "map.toml"
    assert main(["convert", *files, "--robot", ROBOT, "--out", str(out)]) == 2
    assert "To decide: match [name | order | time]" in capsys.readouterr().out
    assert not out.exists()
    assert not out.with_suffix(".map.toml").exists()
    assert main(["convert", *files, "--robot", ROBOT, "--propose", str(kept)]) == 2
    assert main(["convert", *files, "--map", str(kept), "--out", str(out)]) == 2
    assert "'?' stands at match.by" in capsys.readouterr().err
    kept.write_text(kept.read_text("utf-8").replace('by = "?"', 'by = "order"'), encoding="utf-8")
    assert main(["convert", *files, "--map", str(kept), "--out", str(out)]) == 0
    assert len(read_dataset(out)) == N


def test_at_a_terminal_the_questions_are_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files, out = files_of("by_order", tmp_path), tmp_path / "out.csv"
    answers = iter(["nobody", ROBOT, "someday", "2"])  # no robot, no answer, the second choice
    for stream in (sys.stdin, sys.stdout):
        monkeypatch.setattr(stream, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(typer, "prompt", lambda *_, **__: next(answers))
    assert main(["convert", *files, "--out", str(out)]) == 0
    assert 'by = "order"' in out.with_suffix(".map.toml").read_text("utf-8")
    assert next(answers, None) is None


@pytest.mark.parametrize(
    ("arguments", "refused"),
    [
        (["--robot", "ur10", "--out", "{new}.csv"], r"not of the robot ur10: they fit abb-irb120.* --robot"),
        (["--robot", ROBOT, "--answer", "rotations=x"], r"answers 'rotations', which nothing asks"),
        (["--robot", ROBOT, "--answer", "rotation"], r"'rotation' is not an answer. Write KEY=CHOICE"),
        (["--robot", "nobody"], r"nobody"),
        (["--robot", ROBOT, "--out", "{new}"], r"Let it end in \.csv"),
        (["--robot", ROBOT, "--out", "{file}"], r"would be written over"),
        (["--robot", ROBOT, "--propose", "{file}"], r"would be written over"),
        (["--map", "{file}"], r"--out: is missing"),
        (["--map", "{file}", "--robot", ROBOT, "--out", "{new}.csv"], r"contains all answers"),
        (["--from", "ipa-ur10", "--robot", ROBOT], r"takes neither a map nor answers"),
    ],
)
def test_what_cannot_be_meant_is_refused_and_leaves_nothing(
    arguments: list[str], refused: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = files_of("kuka", tmp_path)[0]
    before = sorted(tmp_path.iterdir())
    given = [text.format(new=tmp_path / "new", file=file) for text in arguments]
    assert main(["convert", file, *given]) == 2
    assert re.search(refused, " ".join(capfd.readouterr().err.split()))
    assert sorted(tmp_path.iterdir()) == before

"""The blocks of the documentation that a reader copies, run page by page in their order.

`sh` and `python` blocks run; a block with `file=NAME` is written first. Blocks without a language are shown, not run:
they need hardware, minutes, or files of the reader. `python.md` and `extending.md` have separate tests.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from service.cli import main
from tests.service.campaigns import read_rows, write_data

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"^```(\w*)(?: file=(\S+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
ELSEWHERE = {"python.md", "extending.md", "cell-pc/curl.md", "cell-pc/python.md"}
RUN = {"first-hour.md"}


def blocks(page: Path) -> list[tuple[str, str, str]]:
    """Language, file and text of every block of a page."""
    return BLOCK.findall(page.read_text("utf-8"))


def test_every_block_that_claims_to_run_is_run() -> None:
    claims = {
        page.relative_to(DOCS).as_posix()
        for page in DOCS.rglob("*.md")
        if any(language in ("sh", "python") for language, _, _ in blocks(page))
    }
    assert claims == RUN | ELSEWHERE


def test_the_first_hour(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its `export.csv` is the simulated robot's, as a measurement program would write it."""
    _export(write_data(tmp_path, n=120), tmp_path / "export.csv")
    monkeypatch.chdir(tmp_path)
    for language, file, text in blocks(DOCS / "first-hour.md"):
        if file:
            Path(file).write_text(text, "utf-8")
        elif language == "python":
            exec(compile(text, "docs/first-hour.md", "exec"), {})
        elif language == "sh":
            for line in text.splitlines():
                program, *arguments = shlex.split(line)
                assert program == "truepose"
                if arguments[0] != "demo":  # which tests/service/test_demo.py runs
                    assert main(arguments) == 0, line
    assert "backlash:j4" in Path("report.html").read_text("utf-8")
    corrected = read_rows(Path("corrected.csv"))
    assert [row["target_id"] for row in corrected] == ["pick", "place"]
    assert 0.0 < abs(float(corrected[0]["j2_deg"]) - 20.0) < 1.0


def _export(data: Path, out: Path) -> None:
    """A data set under other names, in another order, and without what only TruePose writes."""
    rows = sorted(read_rows(data), key=lambda row: int(row["reading_id"]))
    lines = ["Nr;A1;A2;A3;A4;A5;A6;SMR;X;Y;Z"]
    for row in rows:
        joints = [row[f"j{k}_deg"] for k in range(1, 7)]
        lines.append(
            ";".join([row["reading_id"], *joints, row["tool_target"], *(row[f"{a}_mm"] for a in "xyz")])
        )
    out.write_text("\n".join(lines) + "\n", "utf-8")

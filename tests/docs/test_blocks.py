"""The blocks of the documentation that a reader copies, run page by page in their order.

`sh` and `python` blocks run; a block with `file=NAME` is written first. A `console` block holds lines that the last
`sh` block printed, and a block with `shows=NAME` holds the first lines of a file. Blocks without a language are not
run: they need hardware, minutes, or files of the reader. `python.md` and the pages of `extend` have separate tests.
"""

from __future__ import annotations

import csv
import io
import re
import shlex
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from mocks.campaign import make_campaign, write_campaign
from service import exit_codes
from service.cli import main
from service.commands.example import FILES
from tests.messages import messages
from tests.service.campaigns import read_rows

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"^```(\w*)(?: (file|shows)=(\S+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
EXTEND = {f"extend/{page.name}" for page in (DOCS / "extend").glob("*.md")}
ELSEWHERE = {"python.md", "cell-pc/core.md", "cell-pc/curl.md", "cell-pc/python.md", *EXTEND}
RUN = {"first-hour.md", "howto/rehearse.md"}
NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?")


def blocks(page: Path) -> list[tuple[str, str, str, str]]:
    """Language, use (`file`, `shows` or empty), name of the file and text of every block of a page."""
    return BLOCK.findall(page.read_text("utf-8"))


def test_every_block_that_claims_to_run_is_run() -> None:
    claims = {
        page.relative_to(DOCS).as_posix()
        for page in DOCS.rglob("*.md")
        if any(language in ("sh", "python") for language, _, _, _ in blocks(page))
    }
    assert claims == RUN | ELSEWHERE


def test_get_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every command of the tutorial runs and prints what the page shows."""
    monkeypatch.chdir(tmp_path)
    assert run_blocks("first-hour.md", capsys) == 4
    assert [row["target_id"] for row in read_rows(Path("corrected.csv"))] == ["pick", "place"]
    report = re.sub(r"<[^>]+>", " ", Path("report.html").read_text("utf-8"))
    annotated = (DOCS / "howto" / "read-report.md").read_text("utf-8")
    for result in ("1.12 → 0.04 mm", "0.0471 ± 0.0027 deg", "83 % is explained by a named cause, 0 %"):
        assert result in annotated
        assert_shown(result, report)
    Path("data.csv").rename("known.csv")
    assert main(["identify", "known.csv"]) == 0, "the header of the page fits the same readings"


def test_the_rehearsed_campaign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its figures differ from run to run, as the simulated time does; the cause and the correction are the same."""
    monkeypatch.chdir(tmp_path)
    run_blocks("howto/rehearse.md", capsys)
    assert "backlash:j4" in Path("report.html").read_text("utf-8")
    shown = (DOCS / "howto" / "rehearse.md").read_text("utf-8")
    assert f"succeeded, {len(read_rows(Path('night1.csv')))} of " in shown
    corrected = read_rows(Path("corrected.csv"))
    assert 0.0 < abs(float(corrected[0]["j2_deg"]) - 20.0) < 1.0


def run_blocks(page: str, capsys: pytest.CaptureFixture[str]) -> int:
    """Write the files of a page, run its commands, compare what they print; return the number of `console` blocks."""
    printed, shown = "", 0
    for language, use, name, text in blocks(DOCS / page):
        if use == "file":
            Path(name).write_text(text, "utf-8")
        elif use == "shows":
            lines = text.splitlines()
            assert_shown(text, "\n".join(Path(name).read_text("utf-8").splitlines()[: len(lines)]))
        elif language == "sh":
            for line in text.splitlines():
                program, *arguments = shlex.split(line)
                assert program == "truepose"
                assert main(arguments) == 0, line
            printed = capsys.readouterr().out
        elif language == "console":
            shown += 1
            for part in text.split("\n...\n"):
                assert_shown(part, printed)
    return shown


def assert_shown(part: str, printed: str) -> None:
    """Assert that the words of a part follow each other in the output; numbers may differ by 2 % of themselves."""
    wanted, found = part.split(), [word for word in printed.split() if not set(word) <= {"─"}]
    starts = range(len(found) - len(wanted) + 1)
    assert any(all(map(_alike, wanted, found[start:])) for start in starts), f"not printed: {part}"


def _alike(wanted: str, found: str) -> bool:
    numbers, others = NUMBER.findall(wanted), NUMBER.findall(found)
    return NUMBER.sub("#", wanted) == NUMBER.sub("#", found) and [
        float(each) for each in numbers
    ] == pytest.approx([float(each) for each in others], rel=0.02, abs=0.0015)


def test_the_example_is_a_simulated_robot_with_backlash() -> None:
    """The shipped file, from its recipe: the page names the hidden backlash."""
    campaign = make_campaign(
        seed=4, n=160, n_validation=0, effects=["backlash:j4"], size=2.0, approach="direct"
    )
    with TemporaryDirectory() as folder:
        write_campaign(campaign, Path(folder))
        truth = (Path(folder) / "truth.json").read_text("utf-8")
        rows = read_rows(Path(folder) / "data.csv")
    shipped = list(csv.DictReader(io.StringIO((FILES / "export.csv").read_text("utf-8")), delimiter=";"))
    assert [row["Target"] for row in shipped] == [row["tool_target"] for row in rows]
    for theirs, ours in (
        ("Time [s]", "t_s"),
        ("J4", "j4_deg"),
        ("X", "x_mm"),
        ("Z", "z_mm"),
        ("Temp [C]", "t_air_c"),
    ):
        assert [float(row[theirs]) for row in shipped] == pytest.approx(
            [float(row[ours]) for row in rows], abs=1e-3
        )
    hidden = re.search(r'"gap": \{\s*"value": ([\d.]+)', truth)
    assert hidden is not None
    assert f"backlash of {float(hidden[1]):.4f} deg" in (DOCS / "first-hour.md").read_text("utf-8")


def test_the_messages_of_troubleshooting_exist() -> None:
    """Parts of a message between … follow each other in one text of the program."""
    page = (DOCS / "troubleshooting.md").read_text("utf-8")
    quoted = re.findall(r"^\| `([^`]+)` \|", page, re.MULTILINE)
    texts = [each.text for each in messages()]
    assert len(quoted) > 20
    for each in quoted:
        parts = ".*".join(re.escape(part.strip(" .")) for part in each.split("…"))
        assert any(re.search(parts, text) for text in texts), each


def test_troubleshooting_lists_every_exit_code() -> None:
    page = (DOCS / "troubleshooting.md").read_text("utf-8")
    codes = {value for value in vars(exit_codes).values() if isinstance(value, int)}
    assert {int(code) for code in re.findall(r"^\| (\d+) \|", page, re.MULTILINE)} == codes

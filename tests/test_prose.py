"""The counts of `python -m tests.prose`: each rule finds its fault, and no count may grow."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.prose import __main__ as prose


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("W", "The reading is told to somebody."),
        ("S01", "word " * 31 + "."),
        ("S02", "The edge of the side of the top of the box."),
        ("S03", "The report of what is missing."),
        ("S04", "One point a pose."),
        ("S05", "One; two; three."),
        ("S06", "None where there is none."),
    ],
)
def test_a_sentence_that_breaks_a_rule_is_found(code: str, text: str) -> None:
    assert code in {each.code for each in prose.check_text("a.md", 1, text)}


def test_plain_english_and_code_pass() -> None:
    assert not list(prose.check_text("a.md", 1, "Measure three points per pose. Use `told` as the key."))


def test_a_count_above_its_limit_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = [prose.Finding("docs/a.md", 3, "W", "'told'"), prose.Finding("docs/b.md", 3, "W", "'anew'")]
    monkeypatch.setattr(prose, "collect", lambda: found)
    monkeypatch.setattr(prose, "LIMITS", tmp_path / "limits.json")
    monkeypatch.setattr("sys.argv", ["prose", "--limits"])
    for limit, code in ((2, 0), (1, 1)):
        prose.LIMITS.write_text(json.dumps({"docs": {"W": limit}}), "utf-8")
        assert prose.main() == code
    assert "docs: W 2 times, limit 1" in capsys.readouterr().out

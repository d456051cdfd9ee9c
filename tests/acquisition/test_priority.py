"""Low priority is reported.

This would catch a session at nice 19 that looks like any other.
"""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from acquisition.examination import computer


@pytest.mark.parametrize(
    ("text", "nice", "said"),
    [
        ("/autogroup-7 nice 19\n", 0, "its session has nice 19"),
        ("/autogroup-7 nice 0\n", 5, "the program has nice 5"),
        ("/autogroup-7 nice -3\n", 0, ""),
        (None, 0, ""),  # no Linux, or autogroup switched off
    ],
)
def test_what_stands_behind_other_programs_is_said(
    text: str | None,
    nice: int,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    session = tmp_path / "autogroup"
    if text is not None:
        session.write_text(text, "ascii")
    monkeypatch.setattr(computer.os, "getpriority", lambda which, who: nice, raising=False)
    monkeypatch.setattr(computer, "_SESSION", session)
    assert computer.low_priority() == said
    with caplog.at_level(logging.WARNING):
        computer.note_low_priority()
    assert [record.message.startswith(said) for record in caplog.records] == [True] * bool(said)

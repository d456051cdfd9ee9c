"""`truepose docs`: the place of the pages, one page in the terminal, the site in a browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path

import pytest

from service.cli import main
from service.commands import docs


def test_pages_are_listed_and_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["docs", "--where"]) == 0
    said = capsys.readouterr().out
    assert str(docs.SOURCES) in said
    assert "howto/tracker" in said
    for name in ("tracker", "howto/tracker"):
        assert main(["docs", name]) == 0
        assert "Calibrate with a tracker or a C-Track" in capsys.readouterr().out


def test_a_page_that_is_not_there_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["docs", "trackers"]) == 2
    assert (
        "there is no page 'trackers'. Did you mean 'howto/tracker'? There are api, ballbar"
        in capsys.readouterr().err
    )


def test_the_site_is_opened_where_it_was_built(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr(docs, "SOURCES", tmp_path)
    (tmp_path / "index.md").write_text("# A\n", "utf-8")
    assert main(["docs"]) == 0
    assert opened == []
    (tmp_path / "build").mkdir()
    (tmp_path / "build" / "index.html").write_text("", "utf-8")
    assert main(["docs"]) == 0
    assert opened == [(tmp_path / "build" / "index.html").as_uri()]
    assert str(tmp_path / "build" / "index.html") in capsys.readouterr().out
    assert main(["docs", "--where"]) == 0
    assert len(opened) == 1

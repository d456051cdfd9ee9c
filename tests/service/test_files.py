"""Files that are whole or not there, under one name only."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from calib.text.text_file import replace_file


def test_a_symlink_stays_one_and_its_target_is_written(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    link = tmp_path / "link.json"
    link.symlink_to(tmp_path / "there" / "real.json")
    replace_file(link, "new\n")
    assert link.is_symlink()
    assert (tmp_path / "there" / "real.json").read_bytes() == b"new\n"


def test_a_failure_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "r.json"
    path.write_text("old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        replace_file(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_was_left_by_another_writer_is_not_touched(tmp_path: Path) -> None:
    other = tmp_path / "r.json.partial"
    other.write_text("of another")
    replace_file(tmp_path / "r.json", "new")
    assert other.read_text() == "of another"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such modes")
def test_the_umask_decides_who_may_read(tmp_path: Path) -> None:
    for umask, mode in ((0o022, 0o644), (0o077, 0o600), (0o000, 0o644)):
        old = os.umask(umask)
        try:
            replace_file(tmp_path / "r.json", "new")
        finally:
            os.umask(old)
        assert (tmp_path / "r.json").stat().st_mode & 0o777 == mode

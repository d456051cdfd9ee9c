"""What is looked at while others change it: files that go meanwhile, processes that end meanwhile."""

from __future__ import annotations

from pathlib import Path

from tests.changing_files import looked_at


def test_a_file_that_goes_while_it_is_looked_at_is_none(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        (tmp_path / name).write_text(name, "utf-8")

    def look(path: Path) -> int:
        (tmp_path / "b").unlink(missing_ok=True)
        return path.stat().st_size

    assert {path.name for path in looked_at(tmp_path, look)} == {tmp_path.name, "a", "c"}

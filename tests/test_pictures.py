"""The pictures of the documentation are those that `python -m tests.pictures` takes."""

from __future__ import annotations

import re
import struct

from tests.end_to_end.simulated import ROOT
from tests.pictures import FOLDER, NAMES, OPERATOR, WIDTH

USED = re.compile(r"!\[[^\]]+\]\((?:docs/)?(?:\.\./)*pictures/([\w-]+)\.png\)")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def test_the_docs_use_the_pictures_that_the_command_takes() -> None:
    used = {name for page in PAGES for name in USED.findall(page.read_text("utf-8"))}
    assert sorted(used) == NAMES
    assert sorted(file.stem for file in FOLDER.iterdir()) == NAMES


def test_pictures_are_as_wide_as_the_page_and_small() -> None:
    for name in NAMES:
        content = (FOLDER / f"{name}.png").read_bytes()
        width, height = struct.unpack("!II", content[16:24])
        assert width <= WIDTH
        assert 300 < height < 1500
        assert name not in OPERATOR or width == WIDTH
        assert len(content) < 260_000

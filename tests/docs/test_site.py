"""The documentation is built as a site, without a warning, and needs nothing from elsewhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
# Scripts, styles, fonts and pictures that a browser would fetch; links that a person may follow are none
FETCHED = re.compile(r'<(?:script|img|link)[^>]+(?:src|href)="(?:https?:)?//[^"]+"|url\(\s*["\']?https?:')


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    done = subprocess.run(
        [*command, "-d", str(tmp_path / "trees"), str(DOCS), str(tmp_path / "site")],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    pages = {page.relative_to(tmp_path / "site").as_posix(): page for page in tmp_path.glob("site/**/*.html")}
    written = {page.relative_to(DOCS).with_suffix(".html").as_posix() for page in DOCS.rglob("*.md")}
    assert written <= set(pages)
    for name, page in pages.items():
        assert not FETCHED.search(page.read_text("utf-8")), name
    commands = pages["made/commands.html"].read_text("utf-8")
    assert "truepose campaign resume" in commands
    assert "/api/v1/runs/{run_id}/stop" in pages["made/http.html"].read_text("utf-8")
    assert "table_z_mm" in pages["made/keys.html"].read_text("utf-8")
    assert "truepose.Diagnosis.power" in pages["api.html"].read_text("utf-8")
    assert "backlash_load" in pages["made/effects.html"].read_text("utf-8")
    assert "<math" in pages["theory.html"].read_text("utf-8")


def test_links_of_pages_outside_the_site_lead_somewhere() -> None:
    root = DOCS.parent
    for page in (root / "README.md", root / "CONTRIBUTING.md", *(root / "examples").rglob("*.md")):
        for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text("utf-8")):
            assert (page.parent / link).exists(), f"{page.name}: {link}"


def test_every_decision_is_listed_under_its_title_and_short() -> None:
    index = (DOCS / "decisions.md").read_text("utf-8")
    records = sorted((DOCS / "decisions").glob("*.md"))
    listed = [f"| {int(number)} | [{title}](decisions/{name})" for number, title, name in map(_head, records)]
    assert [each for each in listed if each not in index] == []
    assert index.count("](decisions/") == len(records)
    for record in records:
        assert len(_head(record)[1]) <= 60, record.name
        words = re.sub(r"\]\([^)]*\)", "]", record.read_text("utf-8")).split()
        assert len(words) <= 250, f"{record.name}: {len(words)} words"


def _head(record: Path) -> tuple[str, str, str]:
    """Number, title and name of the file of a decision record."""
    first = record.read_text("utf-8").partition("\n")[0]
    found = re.fullmatch(r"# (\d+)\. (.+)", first)
    assert found is not None
    assert int(record.name[:4]) == int(found[1]), f"{record.name}: {first}"
    return found[1], found[2], record.name

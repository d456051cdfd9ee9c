"""The rules of every file: no circular import, no file that is too long, and no two classes of one name."""

from __future__ import annotations

import ast
import graphlib
import subprocess
from collections import defaultdict
from pathlib import Path

import grimp
import pytest

from tests.end_to_end.test_extending import steps

REPO = Path(__file__).parents[1]
ROOMS = ("calib", "drivers", "acquisition", "fleet", "service", "truepose", "mocks", "tests")
LONGEST = 700
# Files of the program that are written or changed for one more of each; what is tried out beside them does not count.
TOUCHED = {  # files of the program that each page changes or adds; of the effect one is its test
    "add-an-effect": 3,
    "add-a-robot": 0,
    "add-a-driver": 0,
    "add-an-exporter": 1,
    "add-an-endpoint": 2,
}


def circle(imports: dict[str, set[str]]) -> list[str]:
    """Files of which each imports the one before, the first and the last the same; none where there is no circle."""
    try:
        graphlib.TopologicalSorter(imports).prepare()
    except graphlib.CycleError as error:
        return error.args[1]
    return []


def test_no_file_imports_one_that_imports_it() -> None:
    """Not for its types either."""
    graph = grimp.build_graph(*ROOMS, cache_dir=None)
    assert circle({name: graph.find_modules_directly_imported_by(name) for name in graph.modules}) == []


@pytest.mark.parametrize(
    ("imports", "found"),
    [({"a": {"b"}, "b": {"c"}, "c": set()}, 0), ({"a": {"b"}, "b": {"c"}, "c": {"a"}}, 3), ({"a": {"a"}}, 1)],
)
def test_a_circle_is_found(imports: dict[str, set[str]], found: int) -> None:
    assert len(set(circle(imports))) == found


def test_no_file_is_longer_than_a_reader_has_patience() -> None:
    named = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.py", "*.js", "*.css", "*.html"],
        cwd=REPO,
        check=True,
        capture_output=True,
        text=True,
    )
    lines = {
        name: (REPO / name).read_bytes().count(b"\n")
        for name in named.stdout.split()
        if (REPO / name).exists() and "static/vendor/" not in name  # libraries of others, as published
    }
    assert len(lines) > 1000
    assert {name: count for name, count in lines.items() if count > LONGEST} == {}


def test_no_two_classes_of_the_program_share_a_name() -> None:
    """Whoever meets a name in an error, in the API or in a search would not know which is meant."""
    found = defaultdict[str, list[str]](list)
    for room in ROOMS:
        for path in () if room in ("mocks", "tests") else sorted((REPO / room).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_bytes())):
                if isinstance(node, ast.ClassDef):
                    found[node.name].append(str(path.relative_to(REPO)))
    assert len(found) > 500
    assert {name: files for name, files in found.items() if len(files) > 1} == {}


@pytest.mark.parametrize("way", TOUCHED)
def test_one_more_touches_few_files(way: str) -> None:
    """Each page of `docs/extend`, which `test_extending.py` follows, changes few files."""
    pages = {page.stem: page for page in (REPO / "docs" / "extend").glob("*.md")}
    assert set(pages) == set(TOUCHED)
    files = {block.file for block in steps(pages[way]) if block.file}
    assert files, "the example shows no file"
    assert len({name for name in files if name.split("/")[0] in ROOMS}) == TOUCHED[way]

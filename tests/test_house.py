"""What holds of every file: it imports no file that imports it in turn, and nobody has to scroll for long."""

from __future__ import annotations

import graphlib
import subprocess
from pathlib import Path

import grimp
import pytest

REPO = Path(__file__).parents[1]
ROOMS = ("calib", "drivers", "acquisition", "fleet", "service", "truepose", "mocks", "tests")
LONGEST = 400


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
        if (REPO / name).exists()
    }
    assert len(lines) > 1000
    assert {name: count for name, count in lines.items() if count > LONGEST} == {}

"""The page of the documentation that shows the history: each command's newest figures, and how they went."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from tests.figures.history import ROOT, Run

PAGE = ROOT / "docs" / "evidence" / "history.md"
_SHOWN = 6  # runs beside each other
_FIGURE = re.compile(r"(?P<name>.{64,}?) +(?P<value>\S.*?) {2,}.*(?P<end>ok|MISSED)$")
_VARIES = re.compile(r"[\d,]*\.\d+|[\d,]+(?= ?(?:%|ms\b|s\b))")  # within a name: what was measured beside

_HEAD = """\
# Benchmark history

Made by `make figures FIGURES="selection floor:20"`, which runs the named benchmarks and enters every line that they
print in `tests/figures/history.csv`. Each run has its date (UTC), commit (`+`: with uncommitted changes), processor
cores, and load: the number of runnable programs in the minute before it began and in its last minute. Nothing is
entered by hand. Other measurements are in [benchmark results](benchmarks.md), [mutation testing](trust.md) and
[conformance](conformance.md). Results in seconds say little if the load exceeds the number of cores.
"""


def page(runs: Sequence[Run]) -> str:
    """The page in Markdown; runs oldest first."""
    return "\n".join((_HEAD, *_sections(runs))).rstrip("\n") + "\n"


def _sections(runs: Sequence[Run]) -> Iterator[str]:
    for what in sorted({run.what for run in runs}):
        own = [run for run in runs if run.what == what]
        yield from (f"## `{what}`", "", "```text", *own[-1].lines, "```", "")
        yield "| run | commit | cores | load | s | missed |"
        yield "|---|---|---|---|---|---|"
        for run in own:
            load = f"{run.load_before:.1f}, {run.load_after:.1f}"
            missed = sum(line.endswith("MISSED") for line in run.lines)
            told = str(missed) if missed or not run.exit else "yes"
            yield f"| {run.date[:16]} | {run.commit} | {run.cores} | {load} | {run.seconds:.0f} | {told} |"
        yield ""
        if len(own) > 1:
            yield from (*_beside(own[-_SHOWN:]), "")


def _beside(runs: Sequence[Run]) -> Iterator[str]:
    """The same figures of several runs; a run that does not have one has a dash."""
    columns = [dict(map(_figure, filter(_FIGURE.match, run.lines))) for run in runs]
    names = dict.fromkeys(name for column in columns for name in column)
    if names:
        yield "| | " + " | ".join(run.date[:16] for run in runs) + " |"
        yield "|---" * (len(runs) + 1) + "|"
    for name in names:
        yield f"| {name} | " + " | ".join(column.get(name, "-") for column in columns) + " |"


def _figure(line: str) -> tuple[str, str]:
    found = _FIGURE.match(line)
    assert found is not None
    missed = " (missed)" if found["end"] == "MISSED" else ""
    return _VARIES.sub("~", found["name"].strip()), found["value"] + missed

"""Files of other programs as they were sent, and the maps that are proposed for them.

A proposal is not kept: its files come again with the next answer, and with the map that has become of it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from calib.arm import built_in_robots
from calib.errors import DataError
from service.http.wire.bodies import MapProposalShown
from service.http.wire.bodies.cell import TablePreview
from service.ids import plain_name
from service.results.files.conversion import ProposalResult
from service.results.shape import document_of

if TYPE_CHECKING:
    from calib.foreign import MapProposal

Sent = Sequence[tuple[str, bytes]]
"""Names and contents of files."""

_ROWS, _CELL = 6, 40  # rows of a preview, and characters of a cell of it
_MOST_BYTES = 4 * 1024 * 1024  # of an answer; a thousand columns have 0.7 MB


@contextmanager
def written(files: Sent) -> Iterator[list[Path]]:
    """Write the files sent, by their names without folders, into a folder.

    The folder is deleted at the end of the block.
    """
    with TemporaryDirectory() as folder:
        paths = [Path(folder) / str(i) / plain_name(name) for i, (name, _) in enumerate(files)]
        for path, (_, content) in zip(paths, files, strict=True):
            path.parent.mkdir()
            path.write_bytes(content)
        yield paths


def proposed(files: Sent, robot: str, texts: Sequence[str]) -> bytes:
    """Propose a map, and return it as JSON of a `MapProposalShown`.

    Parameters
    ----------
    files : sequence of (str, bytes)
        One file, or one with joints and one with points.
    robot : str
        Name of a built-in robot; empty: not known yet.
    texts : sequence of str
        Answers `KEY=CHOICE`.

    Raises
    ------
    DataError
        As for `truepose convert`; also if the robot is not a built-in one, or the names of columns are very long.
    """
    from calib.foreign import answers_of, propose  # in the worker that does it

    answers = answers_of(texts, "answer") | ({"robot": robot} if robot else {})
    named = answers.get("robot")
    if named is not None and named not in built_in_robots():  # a path would be looked for among our files
        raise DataError(f"is '{named}'.", do=f"Use {', '.join(built_in_robots())}.", key="robot")
    with written(files) as paths:
        proposal = propose(paths, answers)
    proposal.refuse_unknown(answers, "answer")
    out = json.dumps(document_of(_shown(proposal)), ensure_ascii=False, allow_nan=False).encode()
    if len(out) > _MOST_BYTES:
        raise DataError(
            f"has names of columns so long that the proposal has {len(out) / 2**20:.0f} MB.",
            do="Shorten them, or leave out the columns that are not needed.",
            file=plain_name(files[0][0]),
        )
    return out


def _shown(proposal: MapProposal) -> MapProposalShown:
    from calib.foreign import text_of
    from service.printed.conversion_tables import remarks

    layouts = proposal.layouts
    tables = [
        TablePreview(
            file=layout.sheet.path.name,
            sheet=layout.sheet.name,
            prefix="" if len(layouts) == 1 else f"{number}.",
            names=list(layout.names),
            lines=list(layout.lines[:_ROWS]),
            rows=[[cell[:_CELL] for cell in row.cells] for row in layout.rows[:_ROWS]],
            readings=len(layout.rows),
        )
        for number, layout in enumerate(layouts, start=1)
    ]
    return MapProposalShown(
        **dict(ProposalResult.of(proposal, None)),
        map_text=text_of(proposal.made, remarks(proposal)),
        tables=tables,
        choices=list(proposal.choices),
        robots=list(built_in_robots()),
    )

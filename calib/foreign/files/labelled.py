"""Lines whose cells carry their names or stand in brackets, taken apart to a table.

j:{2.63, -90.1, 12.0} p:{1203.1, 88.4, 512.0}      ->   j1  j2  j3  p1  p2  p3
{A1 2.63, A2 -90.1}, X=1203.1                      ->   A1  A2  X
7; [2.63, -90.1]    below    n; joints             ->   n  joints1  joints2
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from calib.foreign.files.number import is_number

_NAME = r"[A-Za-z_$][\w.$]{0,40}"
_TOKEN = re.compile(
    rf"(?P<open>(?:\"?(?P<of>{_NAME})\"?\s{{0,3}}[:=]?\s{{0,3}})?[\[{{(])"
    r"|(?P<close>[\]})])"
    rf"|\"?(?P<label>{_NAME})\"?\s{{0,3}}[:=]\s{{0,3}}(?=[-+\d.\"])"
    r"|(?P<gap>[\s,;|]+)"
    r"|\"(?P<quoted>[^\"]*)\"|(?P<cell>[^\s,;|\[\](){}\"]+)"
)
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
_MARKS = frozenset("[]{}()=:")
_LOOKED_AT = 400  # lines that show whether they are labelled
_FEWEST = 3  # lines, or cells of one, that show a form


@dataclass(frozen=True)
class LabelledCell:
    """A cell of a line with labels or brackets.

    Attributes
    ----------
    label : str
        Label of the cell or of its brackets.
    number : int
        Place in the brackets; 0 for a cell with a separate label.
    part : int
        Index of the cell or brackets in the line.
    """

    text: str
    label: str
    number: int
    part: int
    deep: bool

    @property
    def form(self) -> tuple[str, int, int]:
        """The form of the cell, the same in every line of a table."""
        return self.label, self.number, self.part


@dataclass(frozen=True)
class Labelled:
    """A table of labelled lines.

    `names` are those of the columns, '' without one. `rows` holds the index of each line (from 0) and
    its cells.
    """

    names: tuple[str, ...]
    rows: tuple[tuple[int, tuple[str, ...]], ...]


def labelled(lines: Sequence[str]) -> Labelled | None:
    """Read lines as a table if most of those with numbers have one form of labels or brackets.

    Returns None for other lines.
    """
    if len(lines) > _LOOKED_AT and _table(lines[:_LOOKED_AT]) is None:
        return None
    return _table(lines)


def _table(lines: Sequence[str]) -> Labelled | None:
    with_numbers = [i for i, line in enumerate(lines) if sum(map(str.isdigit, line)) >= _FEWEST]
    marked = [i for i in with_numbers if not _MARKS.isdisjoint(lines[i])]
    if len(marked) < _FEWEST or 2 * len(marked) < len(with_numbers):
        return None
    cells = {i: _taken_apart(lines[i]) for i in marked}
    forms = Counter(tuple(cell.form for cell in of) for of in cells.values() if of)
    if not forms:
        return None
    form, count = forms.most_common(1)[0]
    of_form = [i for i, of in cells.items() if tuple(cell.form for cell in of) == form]
    first = cells[of_form[0]]
    if 2 * count < len(with_numbers) or sum(cell.deep or bool(cell.label) for cell in first) < _FEWEST:
        return None
    names = _names(first, _above(lines[max(0, of_form[0] - 3) : of_form[0]], first[-1].part + 1))
    return Labelled(names, tuple((i, tuple(cell.text for cell in cells[i])) for i in of_form))


def _taken_apart(line: str) -> list[LabelledCell]:
    """Split a line into its cells; return [] if it cannot be split."""
    if ";" in line and "." not in line:
        line = _DECIMAL_COMMA.sub("\0", line)  # which does not set cells apart
    out: list[LabelledCell] = []
    frames: list[list[str | int]] = []  # label of the brackets, and how many cells they have so far
    label, part, at = "", -1, 0
    while at < len(line):
        match = _TOKEN.match(line, at)
        if match is None:
            return []
        at = match.end()
        if match["open"]:
            part += not frames
            own = match["of"] or label
            frames.append([own, 0] if own or not frames else frames[-1])
            label = ""
        elif match["close"]:
            if not frames:
                return []
            frames.pop()
        elif match["label"]:
            label = match["label"]
        elif not match["gap"]:
            text = (match["cell"] if match["quoted"] is None else match["quoted"]).replace("\0", ",")
            if frames and not label and re.fullmatch(_NAME, text) and not is_number(text):
                label = text  # `A1 2.63` of KUKA
                continue
            part += not frames
            if frames and not label:
                frames[-1][1] = int(frames[-1][1]) + 1
                out.append(LabelledCell(text, str(frames[-1][0]), int(frames[-1][1]), part, deep=True))
            else:
                out.append(LabelledCell(text, label, 0, part, deep=bool(frames)))
            label = ""
    return [] if frames else out


def _above(lines: Sequence[str], parts: int) -> list[str]:
    """Find the names that one of the lines above gives the parts of a line; [] without."""
    for line in reversed(lines):
        for separator in ";\t,|":
            cells = [cell.strip().strip('"#/ ') for cell in line.split(separator)]
            if len(cells) == parts > 1 and all(cells) and not any(map(is_number, cells)):
                return cells
    return []


def _names(cells: Sequence[LabelledCell], above: Sequence[str]) -> tuple[str, ...]:
    """Build the names of columns; () if none is known."""
    out = []
    for k, cell in enumerate(cells, start=1):
        stem = cell.label or (above[cell.part] if above else "")
        out.append(f"{stem}{cell.number or ''}" if stem else f"column {k}")
    return tuple(out) if any(cell.label for cell in cells) or above else ()

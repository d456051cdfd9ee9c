"""Cells that a spreadsheet would evaluate as formulas, escaped so that it does not.

Source: OWASP, CSV injection: a cell that begins with = + - @, a tab or an end of line.
"""

from __future__ import annotations

_BEGINS = ("=", "+", "-", "@", "\t", "\r", "\n")


def no_formula(text: str) -> str:
    """The text of a cell that a spreadsheet takes as text: `'` before what it would work out. Numbers stay numbers."""
    if not text.startswith(_BEGINS):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text


def meant_by(cell: str) -> str:
    """The text that a cell of `no_formula` was written for."""
    return cell[1:] if cell.startswith("'") and no_formula(cell[1:]) == cell else cell

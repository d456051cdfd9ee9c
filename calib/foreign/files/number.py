"""Numbers and times as other programs write them.

Numbers have decimal points or commas, separated thousands, and perhaps a unit behind. All numbers of a
table together show which mark is which. If they do not (`1,234` may be 1.234 or 1234), the caller must
give it.

Instruments and robots write times of day as ISO 8601, as MM/DD/YYYY HH:MM:SS with a fraction, AM or PM,
or as DD.MM.YYYY HH:MM:SS.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime

_SPACES = " \u00a0\u202f\u2009'’"  # as put between thousands, the usual blank among them
_DIGITS = rf"\d+(?:[{_SPACES}]\d{{3}})*"
_NUMBER = re.compile(rf"[-+−]?(?:{_DIGITS}[.,\d]*|[.,]\d+)(?:[eE][-+−]?\d{{1,3}})?")
_SUFFIX = re.compile(r"\s?(°|deg|rad|mm|m|um|µm|μm|in|\")$")
_GROUPED = re.compile(r"[1-9]\d{0,2}")

NOT_MEASURED = (
    "",
    "-",
    "--",
    "---",
    "nan",
    "n/a",
    "na",
    "n.a.",
    "#n/a",
    "null",
    "none",
    "lost",
    "no point",
    "x",
)
"""What cells hold, in lower case, where nothing was measured."""

_LONGEST = 60
_SPACE = str.maketrans("−", "-", _SPACES)
_ISO = re.compile(r"(\d{4})-(\d\d?)-(\d\d?)[T ](\d\d?):(\d\d):(\d\d)(\.\d{1,9})?\s?(?:Z|[+-]\d\d:?\d\d)?")
_SLASHED = re.compile(r"(\d\d?)/(\d\d?)/(\d{4})[T ](\d\d?):(\d\d):(\d\d)(\.\d{1,9})?(?:\s?([AaPp])[Mm])?")
_DOTTED = re.compile(r"(\d\d?)\.(\d\d?)\.(\d{4})[T ,]\s?(\d\d?):(\d\d):(\d\d)([.,]\d{1,9})?")
STAMP = re.compile(f"(?:{_ISO.pattern})|(?:{_SLASHED.pattern})")

_DATE_LIKE = re.compile(
    r"\d{1,4}[\s./-]*(?:jan|feb|mar|mär|apr|may|mai|jun|jul|aug|sep|oct|okt|nov|dec|dez)[a-zä]*[\s./-]*\d*"
    r"|(?:jan|feb|mar|mär|apr|may|mai|jun|jul|aug|sep|oct|okt|nov|dec|dez)[a-zä]*[\s./-]+\d{1,4}"
    r"|\d{1,4}[./-]\d{1,2}[./-]\d{1,4}.*",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Notation:
    """The mark before decimals, and the one between thousands or ''."""

    decimal: str = "."
    thousands: str = ""

    def number(self, cell: str) -> float | None:
        """Parse the finite number in a cell; return None if there is none."""
        text = cell.strip()
        if len(text) > _LONGEST or not _NUMBER.fullmatch(text := _SUFFIX.sub("", text)):
            return None
        text = text.translate(_SPACE)
        if self.thousands and self.thousands in text:
            whole, mark, rest = text.partition(self.decimal)
            first, *groups = whole.lstrip("+-").split(self.thousands)
            if self.thousands in rest or not _GROUPED.fullmatch(first) or any(len(g) != 3 for g in groups):
                return None
            text = whole.replace(self.thousands, "") + mark + rest
        elif self.decimal == "," and "." in text:
            return None
        try:
            value = float(text.replace(self.decimal, ".") if self.decimal == "," else text)
        except ValueError:
            return None
        return value if math.isfinite(value) else None


_OTHER = {".": ",", ",": "."}


def is_number(cell: str) -> bool:
    """Test whether a cell is a number in some notation."""
    text = cell.strip()
    return bool(text) and len(text) <= _LONGEST and bool(_NUMBER.fullmatch(_SUFFIX.sub("", text)))


def suffix_of(cell: str) -> str:
    """Return the unit that a cell has behind its number, or ''."""
    found = _SUFFIX.search(cell.strip())
    return found[1] if found and is_number(cell) else ""


def notation_of(columns: Iterable[Iterable[str]]) -> Notation | None:
    """Find the notation of the numbers of a table from its columns.

    Returns None if the numbers do not show it, or disagree.
    """
    decimals: set[str] = set()
    thousands: set[str] = set()
    open_marks: set[str] = set()
    for column in columns:
        # behind the sign, without what no mark can be
        cells = [
            _SUFFIX.sub("", cell.strip()).translate(_SPACE).lstrip("+-") for cell in column if is_number(cell)
        ]
        cells = [re.split("[eE]", cell)[0] for cell in cells]
        marked = {
            mark: [cell for cell in cells if mark in cell and _OTHER[mark] not in cell] for mark in ".,"
        }
        for cell in cells:
            if "." in cell and "," in cell:
                last = max(".,", key=cell.rindex)
                decimals.add(last)
                thousands.add(_OTHER[last])
            else:
                thousands.update(mark for mark in ".," if cell.count(mark) > 1)
        for mark, with_it in marked.items():
            if not with_it:
                continue
            if not all(_may_be_thousands(cell, mark) for cell in with_it if cell.count(mark) == 1):
                decimals.add(mark)
            elif len(with_it) == len(
                cells
            ):  # every number has it: thousands would leave some below a thousand
                open_marks.add(mark)
            else:
                open_marks.add(mark + "?")
    if decimals & thousands or len(decimals) > 1 or len(thousands) > 1:
        return None
    for mark in ".,":
        known = mark in decimals | thousands
        if not known and (mark in open_marks or mark + "?" in open_marks):
            if _OTHER[mark] in decimals:
                thousands.add(mark)
            elif mark + "?" in open_marks and _OTHER[mark] not in thousands:
                return None
            else:
                decimals.add(mark)
    if len(decimals) > 1 or decimals & thousands:
        return None
    decimal = next(iter(decimals), "," if "." in thousands else ".")
    return Notation(decimal, next(iter(thousands), ""))


def _may_be_thousands(cell: str, mark: str) -> bool:
    """Test whether a cell with only one mark may be a number above a thousand: `12,345`."""
    whole, _, rest = cell.partition(mark)
    return bool(_GROUPED.fullmatch(whole)) and len(rest) == 3 and rest.isdigit()


def looks_like_date(text: str) -> bool:
    """Test whether a cell is a date in some form, as spreadsheets make of 1.5 or 3-4."""
    return bool(_DATE_LIKE.fullmatch(text.strip()[:40]))


def seconds_of(text: str) -> float | None:
    """Parse a date with a time of day to seconds from 1970; return None for other text.

    The time is that of the clock that was read, in any zone.
    """
    half = ""
    if match := _ISO.fullmatch(text):
        year, month, day, hour, minute, second, fraction = match.groups()
    elif match := _SLASHED.fullmatch(text):
        month, day, year, hour, minute, second, fraction, half = match.groups()
    elif match := _DOTTED.fullmatch(text):
        day, month, year, hour, minute, second, fraction = match.groups()
        fraction = (fraction or "").replace(",", ".")
    else:
        return None
    hours = int(hour)
    if half:
        hours = hours % 12 + (12 if half in "Pp" else 0)
    try:
        whole = datetime(int(year), int(month), int(day), hours, int(minute), int(second), tzinfo=UTC)
    except ValueError:  # digits that are no date
        return None
    return whole.timestamp() + float(fraction or 0.0)

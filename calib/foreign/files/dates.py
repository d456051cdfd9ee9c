"""Times of day as instruments and robots write them: ISO 8601, MM/DD/YYYY HH:MM:SS with a fraction, AM or PM, or
DD.MM.YYYY HH:MM:SS."""

from __future__ import annotations

import re
from datetime import UTC, datetime

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


def looks_like_date(text: str) -> bool:
    """Whether a cell is a date in some form, as spreadsheets make of 1.5 or 3-4."""
    return bool(_DATE_LIKE.fullmatch(text.strip()[:40]))


def seconds_of(text: str) -> float | None:
    """Seconds from 1970 by the clock that was read, whatever its zone; None for what is no date with a time of day."""
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

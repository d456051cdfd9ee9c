"""The size to which a workbook unpacks, counted part by part before anything is built of it.

A few kilobytes may hold gigabytes: text that packs a thousandfold, one cell at the far end of a sheet, a
merged range over all of it, a formula that every cell shares. A reader that builds cells notices too
late. So the sizes that the archive states are checked first. Then Expat reads every XML part, keeps
nothing of it, and refuses document types, so that no entity is ever declared.

Expat parses an unfinished tag or comment again with every further piece, which takes time with the
square of its length. None may therefore be longer than `LONGEST_TEXT`.
"""

from __future__ import annotations

import io
import lzma
import struct
import zipfile
import zlib
from contextlib import suppress
from pathlib import Path
from xml.parsers import expat

from calib.errors import DataError
from calib.text.plain_values import LONGEST_TEXT, too_long
from calib.text.xml_text import longest_of

MOST_UNPACKED = 256 * 1024 * 1024
MOST_CELLS = 1_000_000
"""The largest sheet, as a rectangle of cells: 20,000 readings of 50 columns."""
_MOST_OTHERS = 500_000  # elements that are no cells: styles, texts, names
_MOST_MERGED = 1_000_000  # cells within merged ranges and links
_MOST_SHARED = 20_000_000  # characters of formulas written out
_DEEPEST = 100
_ROWS, _COLUMNS = 1 << 20, 1 << 14  # of a sheet, as Excel has them
_CELL = frozenset({"c", "v", "f", "row"})
UNREADABLE = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, EOFError, OSError, RuntimeError)
UNREADABLE += (ValueError, IndexError, OverflowError)
"""Errors in which the reading of a damaged, encrypted or oddly packed archive ends."""
_PIECE = 1 << 16
_MOST_PARTS = 10_000
_MOST_RATIO, _SMALL = 300, 4 * 1024 * 1024
"""Sheets pack 10 to 30 times; a part that is small unpacked may pack as well as it likes."""


def refuse_bomb(data: bytes, path: Path) -> None:
    """Raise DataError (file) for bytes that are no archive, or one that would become too large."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            parts = packed.infolist()
            size = sum(part.file_size for part in parts)
            if size > MOST_UNPACKED:
                raise _too_large(path, f"is {size / 2**20:.0f} MB unpacked")
            if len(parts) > _MOST_PARTS:
                raise _too_large(path, f"holds {len(parts)} files")
            for part in parts:
                if part.file_size > max(_SMALL, _MOST_RATIO * part.compress_size):
                    raise _too_large(
                        path,
                        f"is packed more than {_MOST_RATIO} times: {part.file_size / 2**20:.0f} MB in one part",
                    )
            for part in parts:
                with packed.open(part) as stream:
                    count = _Count(path)
                    while piece := stream.read(_PIECE):
                        if not count.goes_on(piece):
                            break
    except DataError:
        raise
    except UNREADABLE as error:
        raise DataError(
            "is not a workbook.", do="Save it as .xlsx, or export it as CSV.", file=path
        ) from error


def _too_large(path: Path, what: str) -> DataError:
    return DataError(f"{what}.", do="Export the sheet as CSV, or remove everything but the table.", file=path)


class _Count:
    """Counter of a part while it is read.

    Raises
    ------
    DataError
        The part holds too much; raised as soon as this is known.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text
        self._parser.DefaultHandler = self._other
        self._parser.StartDoctypeDeclHandler = self._refuse_document_type
        self._depth = self._cells = self._others = self._area = 0
        self._formula = self._longest = self._sharing = 0
        self._unread = self._length = 0  # bytes since anything was read to its end; characters of a text

    def goes_on(self, piece: bytes) -> bool:
        """Take more of the part; return False once it is no XML, because no reader continues there."""
        self._unread += len(piece)
        try:
            self._parser.Parse(piece)
        except expat.ExpatError:
            return False
        if self._unread > LONGEST_TEXT:
            raise too_long(self._path)
        return True

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        name = tag.rpartition(":")[2]
        self._unread = self._length = 0
        if longest_of(tag, attributes) > LONGEST_TEXT:
            raise too_long(self._path)
        self._depth += 1
        self._cells += name in _CELL
        self._others += name not in _CELL
        if self._depth > _DEEPEST or self._others > _MOST_OTHERS or self._cells > len(_CELL) * MOST_CELLS:
            raise _too_large(self._path, f"holds more than {MOST_CELLS} cells or {_MOST_OTHERS} other parts")
        if name == "f":
            self._formula = 0
            self._sharing += attributes.get("t") == "shared"
        if name in ("mergeCell", "hyperlink"):
            self._area += _area(attributes.get("ref", ""))
            if self._area > _MOST_MERGED:
                raise _too_large(self._path, f"merges or links more than {_MOST_MERGED} cells")

    def _end(self, tag: str) -> None:
        self._unread = self._length = 0
        self._depth -= 1
        if tag.rpartition(":")[2] == "f":
            self._longest = max(self._longest, self._formula)
            if self._longest * self._sharing > _MOST_SHARED:
                raise _too_large(self._path, "shares a long formula among many cells")

    def _text(self, text: str) -> None:
        self._unread = 0
        self._formula += len(text)
        self._length += len(text)
        if self._length > LONGEST_TEXT:
            raise too_long(self._path)

    def _other(self, text: str) -> None:
        self._unread = 0
        if len(text) > LONGEST_TEXT:
            raise too_long(self._path)

    def _refuse_document_type(self, *_: object) -> None:
        raise DataError(
            "declares a document type in one of its parts.",
            do="Open it in Excel or LibreOffice and save it as .xlsx.",
            file=self._path,
        )


def _area(ref: str) -> int:
    """Count the cells of a range such as A1:C9.

    The count is 0 if the text is no range; the reader of the workbook refuses it.
    """
    from openpyxl.utils.cell import range_boundaries  # slow to import

    with suppress(ValueError, TypeError):
        left, top, right, bottom = range_boundaries(ref)
        width = (right or _COLUMNS) - (left or 1) + 1
        return max(0, width) * max(0, (bottom or _ROWS) - (top or 1) + 1)
    return 0

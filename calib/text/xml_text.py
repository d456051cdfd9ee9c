"""Reader of XML: elements and attributes of a few levels, without a document type.

So there are no entities, which could expand ten lines to gigabytes, or include a file of this computer.
No format that is read here needs them.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from calib.errors import DataError
from calib.text.plain_values import DEEPEST, LONGEST_TEXT, too_deep, too_long
from calib.text.text_file import read_text

MOST_BYTES = 32 * 1024 * 1024
"""The largest descriptions of robots have two megabytes."""
MOST_ELEMENTS = 200_000


def longest_of(tag: str, attributes: dict[str, str]) -> int:
    """Return the length of the longest name or value of an element."""
    return max(map(len, (tag, *attributes, *attributes.values())))


def read_xml(path: Path) -> Element:
    """Read the root element of an XML file.

    Raises
    ------
    DataError
        The file cannot be read; the error names file and line.
    """
    return parse_xml(read_text(path, MOST_BYTES), path)


def parse_xml(text: str, file: Path | str) -> Element:
    """Parse XML text to its root element.

    Raises
    ------
    DataError
        The text is no XML, has a document type, or is too deep.
    """
    builder = TreeBuilder()
    parser = expat.ParserCreate(encoding="utf-8")  # what the file's first line claims does not count
    depth = count = length = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count, length
        depth, count, length = depth + 1, count + 1, 0
        if longest_of(tag, attributes) > LONGEST_TEXT:
            raise too_long(file, parser.CurrentLineNumber)
        if depth > DEEPEST:
            raise too_deep(file)
        if count > MOST_ELEMENTS:
            raise DataError(f"has more than {MOST_ELEMENTS} elements.", do="Check the file.", file=file)
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth, length
        depth, length = depth - 1, 0
        builder.end(tag)

    def data(text: str) -> None:
        nonlocal length
        length += len(text)
        if length > LONGEST_TEXT:
            raise too_long(file, parser.CurrentLineNumber)
        builder.data(text)

    def refuse_document_type(*_: object) -> None:
        raise DataError(
            "declares a document type.",
            do="Leave <!DOCTYPE ...> and its entities out.",
            file=file,
            line=parser.CurrentLineNumber,
        )

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = data
    parser.StartDoctypeDeclHandler = refuse_document_type
    try:
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        raise DataError(
            f"is not valid XML ({expat.ErrorString(error.code)}).",
            do="Correct that place.",
            file=file,
            line=error.lineno,
        ) from error
    return builder.close()

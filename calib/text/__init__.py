"""Text and tables from files and requests, with bounds, clear errors and atomic writing."""

from calib.text.columns import (
    LONGEST_LINE,
    MOST_COLUMNS,
    TextTable,
    meant_by,
    no_formula,
    other_mark,
    rows_of,
)
from calib.text.json_text import parse_json, read_json
from calib.text.parquet import DATA_SETS, PARQUET
from calib.text.program import written_by
from calib.text.text_file import decoded, note_files, read_bytes, read_text, replace_file
from calib.text.toml_table import (
    FARTHEST_MM,
    TomlTable,
    Vector,
    did_you_mean,
    parse_toml,
    read_toml,
    refuse_unknown,
    turns_writing,
)
from calib.text.xml_text import parse_xml, read_xml

__all__ = [
    "DATA_SETS",
    "FARTHEST_MM",
    "LONGEST_LINE",
    "MOST_COLUMNS",
    "PARQUET",
    "TextTable",
    "TomlTable",
    "Vector",
    "decoded",
    "did_you_mean",
    "meant_by",
    "no_formula",
    "note_files",
    "other_mark",
    "parse_json",
    "parse_toml",
    "parse_xml",
    "read_bytes",
    "read_json",
    "read_text",
    "read_toml",
    "read_xml",
    "refuse_unknown",
    "replace_file",
    "rows_of",
    "turns_writing",
    "written_by",
]

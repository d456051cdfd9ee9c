"""Test the readers of text, JSON, TOML and CSV.

These would catch an internal error instead of a refusal: for numbers of hundreds of digits, deep nesting, long
cells, devices and foreign encodings. They would also catch a key that is given twice.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from calib.errors import DataError
from calib.text.columns import LONGEST_LINE, MOST_COLUMNS, TextTable, rows_of
from calib.text.json_text import parse_json
from calib.text.plain_values import DEEPEST
from calib.text.text_file import read_bytes, read_text
from calib.text.toml_table import parse_toml

REFUSED: dict[str, tuple[Callable[[str, str], object], str, str]] = {
    "json: digits": (parse_json, '{"a": ' + "9" * 400 + "}", "400 digits"),
    "json: 64 bits": (parse_json, '{"a": {"b": [9223372036854775808]}}', "key 'a.b'.*64 bits"),
    "json: beyond int": (parse_json, "9" * 5000, "5000 digits"),
    "json: deep": (parse_json, "[" * 100_000 + "]" * 100_000, "nested"),
    "json: deep tables": (parse_json, '{"a":' * 100_000, "nested"),
    "json: a little deep": (parse_json, "[" * (DEEPEST + 2) + "]" * (DEEPEST + 2), "nested"),
    "json: infinite": (parse_json, '{"a": 1e999}', "key 'a'"),
    "json: NaN": (parse_json, '{"a": [NaN]}', "key 'a'.*nan"),
    "json: twice": (parse_json, '{"dry_run": true, "dry_run": false}', "key 'dry_run'.*twice"),
    "json: broken": (parse_json, '{"a": 1,\n "b" 2}', "line 2"),
    "toml: digits": (parse_toml, "a = " + "9" * 400, "key 'a'.*64 bits"),
    "toml: thousands of digits": (parse_toml, "a = " + "9" * 5000, "digits"),
    "toml: deep": (parse_toml, "a = " + "[" * 100_000, "nested"),
    "toml: deep tables": (parse_toml, "a = " + "{b = " * 100_000, "nested"),
    "toml: long key": (parse_toml, "a." * 100_000 + "a = 1", "parts"),
    "toml: long table": (parse_toml, "x = 1\n[" + "'a' . " * 100_000 + "a]", "line 2.*parts"),
    "toml: nan": (parse_toml, "[t]\na = nan", "key 't.a'"),
    "csv: long cell": (rows_of, "a,b\n1," + "x" * 200_000, "line 2"),
    "csv: open quote": (rows_of, 'a,b\n1,"' + "x\n" * 200_000, "cannot be read"),
    "csv: columns": (rows_of, "a,b\n" + "," * MOST_COLUMNS, "line 2.*columns"),
    "csv: long line": (rows_of, "," * (LONGEST_LINE + 1), "line 1"),
}


@pytest.mark.parametrize("case", sorted(REFUSED))
def test_what_arithmetic_cannot_hold_is_refused_with_its_place(case: str) -> None:
    parse, text, words = REFUSED[case]
    with pytest.raises(DataError, match=words) as caught:
        parse(text, "file.x")
    assert str(caught.value).startswith("file.x")
    assert len(str(caught.value)) < 300
    assert len(caught.value.do) > 5


def test_what_is_long_but_sound_is_read() -> None:
    assert parse_json("[" * DEEPEST + "1" + "]" * DEEPEST, "f")
    assert parse_json('{"a": [9223372036854775807, -9223372036854775807, 1e300]}', "f")
    assert parse_toml('text = "' + "a." * 30 + '"\na.b.c = [[1, 2.5], [inf_]]'.replace("inf_", "3"), "f")
    assert len(rows_of("a,b\n" + "1,2\n" * 1000, "f")) == 1001


FILES = {
    "utf-16": ("a,b\n1,2\n".encode("utf-16"), "UTF-16"),
    "latin-1": ("a\ntemp,\n°C".encode("latin-1"), "line 3.*UTF-8"),
    "nul": (b"a,b\n1,\0\n", "line 2.*NUL"),
    "empty": (b"", "empty"),
    "blank": (b"\n\n", "no readings"),
}


@pytest.mark.parametrize("case", sorted(FILES))
def test_what_is_no_text_is_refused(case: str, tmp_path: Path) -> None:
    data, words = FILES[case]
    (tmp_path / "a.csv").write_bytes(data)
    with pytest.raises(DataError, match=words):
        TextTable.read(tmp_path / "a.csv")


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_may_end_as_on_any_system(end: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"\xef\xbb\xbf" + end.join(["a,b", "1,2", "3,4", ""]).encode())
    table = TextTable.read(tmp_path / "a.csv")
    assert table.numbers("a").tolist() == [1.0, 3.0]
    assert table.lines == [2, 3]


def test_a_cell_that_runs_over_a_line_leaves_the_line_numbers_right(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text('a,b\n"one\ntwo",2\n3,x\n', encoding="utf-8")
    with pytest.raises(DataError, match="line 4"):
        TextTable.read(tmp_path / "a.csv").numbers("b")


def test_what_is_no_ordinary_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")  # nobody writes to it: opened plainly, it would hold the program for ever
    for path, words in (
        (tmp_path, "folder"),
        (tmp_path / "pipe", "ordinary"),
        (Path("/dev/zero"), "ordinary"),
        (tmp_path / "none", "no such file"),
        (tmp_path / ("x" * 300), "cannot be read"),
        (tmp_path / "a\0b", "cannot be read"),
    ):
        with pytest.raises(DataError, match=words):
            read_text(path)


def test_a_file_that_is_too_large_is_refused(tmp_path: Path) -> None:
    (tmp_path / "large").write_bytes(b"x" * 2**20 + b"x")
    assert len(read_text(tmp_path / "large", 2**20 + 1)) == 2**20 + 1
    with pytest.raises(DataError, match="larger than 1 MB"):
        read_text(tmp_path / "large", 2**20)


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="not a Linux")
def test_a_file_whose_disk_fails_is_named() -> None:
    with pytest.raises(DataError, match=r"/proc/self/mem: cannot be read \(Input/output error\)"):
        read_bytes(Path("/proc/self/mem"))

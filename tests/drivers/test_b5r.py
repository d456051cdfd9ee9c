"""Ballbar results: values of a file, missing values, and refusals of other files by name."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import ConfigError, read_b5r
from drivers.renishaw.b5r import UNITS, parse_b5r

# Written for this test from the names of the elements; no file of the maker's is copied.
TEXT = """<?xml version="1.0" encoding="UTF-8"?>
<BALLBAR_TEST>
  <TEST_SPEC NAME="XY 360deg 150mm"><PLANE TEST_PLANE="xy"><A_AXIS_NAME>X</A_AXIS_NAME>
    <B_AXIS_NAME>Y</B_AXIS_NAME></PLANE></TEST_SPEC>
  <OPERATOR> anna </OPERATOR><DATE_STARTED>2026-03-04 10:11:12</DATE_STARTED>
  <MACHINE_TESTED NAME="LR Mate 200iC"/>
  <BALLBAR><SERIAL_NUMBER>2Q0001</SERIAL_NUMBER><LAST_CALIBRATED>2026-01-15</LAST_CALIBRATED></BALLBAR>
  <ANALYSIS NAME="RENISHAW_DIAGNOSTICS">
    <FEATURE NAME="AF_CIRCULARITY" DT="UT_LENGTH_UM"> 12.5 </FEATURE>
    <FEATURE NAME="AF_SQUARENESS" DT="UT_SQUARENESS">-33.1</FEATURE>
    <FEATURE NAME="AF_SCALE_MISMATCH" DT="UT_NEW">4</FEATURE>
  </ANALYSIS>
  <ANALYSIS NAME="ISO_230"><FEATURE NAME="AF_CIRCULARITY" DT="UT_LENGTH_MM">0.013</FEATURE></ANALYSIS>
</BALLBAR_TEST>"""


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_header_and_features(tmp_path: Path, encoding: str) -> None:
    file = tmp_path / "one.b5r"
    file.write_bytes(TEXT.replace("UTF-8", encoding).encode(encoding))
    test = read_b5r(file)
    assert (test.plane, test.axes, test.test) == ("XY", ("X", "Y"), "XY 360deg 150mm")
    assert (test.operator, test.started, test.machine) == ("anna", "2026-03-04 10:11:12", "LR Mate 200iC")
    assert (test.serial, test.last_calibrated, test.part) == ("2Q0001", "2026-01-15", "")
    assert [(f.analysis, f.name, f.value, f.unit) for f in test.features] == [
        ("RENISHAW_DIAGNOSTICS", "AF_CIRCULARITY", 12.5, "um"),
        ("RENISHAW_DIAGNOSTICS", "AF_SQUARENESS", -33.1, "um/m"),
        ("RENISHAW_DIAGNOSTICS", "AF_SCALE_MISMATCH", 4.0, ""),
        ("ISO_230", "AF_CIRCULARITY", 0.013, "mm"),
    ]
    assert test.feature("AF_SQUARENESS").value == -33.1
    with pytest.raises(ConfigError, match="AF_CIRCULARITY"):
        test.feature("AF_NOTHING")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "is no XML"),
        ("<A>", "is no XML"),
        ("<A/>", "FEATURE|PLANE"),
        ('<A><PLANE TEST_PLANE="XY"/></A>', "FEATURE"),
        (TEXT.replace(" 12.5 ", "12,5"), "AF_CIRCULARITY"),
        (TEXT.replace(" 12.5 ", "nan"), "AF_CIRCULARITY"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><A>&b;</A>', "entities"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str, why: str) -> None:
    file = tmp_path / "two.b5r"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=why):
        read_b5r(file)


@given(st.binary(max_size=300))
def test_any_bytes(data: bytes) -> None:
    with pytest.raises(ConfigError):
        parse_b5r(data)


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(sorted(UNITS)))
def test_every_number_and_unit(value: float, kind: str) -> None:
    text = f'<A><PLANE TEST_PLANE="YZ"/><FEATURE NAME="F" DT="{kind}">{value!r}</FEATURE></A>'
    (feature,) = parse_b5r(text.encode()).features
    assert (feature.value, feature.unit) == (value, UNITS[kind])

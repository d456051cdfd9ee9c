"""Test that hostile workbooks, exports, URDFs and histories are refused quickly.

They are refused by name before they cost time or memory. These would catch: a workbook of kilobytes that becomes
gigabytes of cells, a damaged one that causes an internal error, and links that carry one another. They would also
catch a parser whose time grows with the square of a line (each text here would take it minutes).
"""

from __future__ import annotations

import json
import random
import zipfile
from pathlib import Path

import openpyxl
import pytest

from calib.errors import DataError
from calib.foreign import propose, read_map
from calib.foreign.files.layout import layout_of, split
from calib.foreign.files.sheet import text_sheet
from calib.foreign.files.workbook import workbook_sheets
from calib.foreign.meanings.words import meaning_of
from calib.foreign.readings.matching import with_target
from calib.robot_file import import_urdf
from calib.text import parse_toml
from calib.watch import read_history
from tests.calib.test_urdf_import import six, urdf

SHEET = "xl/worksheets/sheet1.xml"
N = 100_000
pytestmark = pytest.mark.timeout(120)  # of seconds at most; what is sought takes minutes


def workbook(
    folder: Path, part: str = SHEET, old: str = "", new: str = "", method: int = zipfile.ZIP_DEFLATED
) -> Path:
    """A small table, with a piece of one part replaced."""
    good, path = folder / "good.xlsx", folder / "data.xlsx"
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    sheet.append([*(f"J{k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]"])
    for i in range(10):
        sheet.append([1.5 * i + k for k in range(9)])
    book.save(good)
    with zipfile.ZipFile(good) as given, zipfile.ZipFile(path, "w", method) as packed:
        for name in given.namelist():
            text = given.read(name)
            if name == part:
                assert old.encode() in text
                text = text.replace(old.encode(), new.encode(), 1)
            packed.writestr(name, text)
    return path


LAUGHS = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 10))
LONG = 1_100_000
LONG_FORMULA = "A1+" * 20_000 + "1"
BOMBS = {
    "a cell at the far end": (
        "</sheetData>",
        '<row r="300000"><c r="ALK300000"><v>1</v></c></row></sheetData>',
        "300000 rows and 999 columns",
    ),
    "a range merged over all of it": (
        "</sheetData>",
        '</sheetData><mergeCells><mergeCell ref="A1:XFD1048576"/></mergeCells>',
        "merges or links more",
    ),
    "a link over whole columns": (
        "</sheetData>",
        '</sheetData><hyperlinks><hyperlink ref="A:XFD"/></hyperlinks>',
        "merges or links more",
    ),
    "a long formula that all cells share": (
        "</sheetData>",
        f'<row r="20"><c r="A20"><f t="shared" ref="A20:A999" si="0">{LONG_FORMULA}</f></c></row>'
        + "".join(f'<row r="{r}"><c r="A{r}"><f t="shared" si="0"/></c></row>' for r in range(21, 999))
        + "</sheetData>",
        "shares a long formula",
    ),
    "entities within entities": (
        "<worksheet",
        f'<!DOCTYPE a [<!ENTITY a0 "ha">{LAUGHS}]><worksheet',
        "document type",
    ),
    "a file of this computer": (
        "<worksheet",
        '<!DOCTYPE a [<!ENTITY a SYSTEM "file:///etc/passwd">]><worksheet',
        "document type",
    ),
    "a long attribute": ("<worksheet", f'<worksheet a="{"x" * LONG}"', "single text or attribute"),
    "a long name": ("</sheetData>", f"</sheetData><{'x' * LONG}/>", "single text or attribute"),
    "a long text": ("<v>1.5</v>", f"<v>{'1' * LONG}</v>", "single text or attribute"),
    "a long text of many lines": ("<v>1.5</v>", "<v>" + "1\n" * LONG + "</v>", "single text or attribute"),
    "a long comment": ("</sheetData>", f"</sheetData><!--{'x' * LONG}-->", "single text or attribute"),
    "a tag that never ends": (
        "</sheetData>",
        f'</sheetData><x a="{"x" * 2 * LONG}',
        "single text or attribute",
    ),
    "a part that packs too well": (
        "</sheetData>",
        "</sheetData>" + "<x/>" * 5_000_000,
        "packed more than 300",
    ),
    "many styles": ("</sheetData>", "</sheetData>" + "<x/>" * 500_001, "500000 other parts"),
    "elements within elements": ("</sheetData>", "</sheetData>" + "<x>" * 101, "other parts"),
    "a text as long as a book": (
        "<v>1.5</v>",
        f'<v>1.5</v></c><c r="K3" t="inlineStr"><is><t>{"x" * 40_000}</t></is>',
        "more than 32767 characters",
    ),
    "an attribute without end": (
        "<sheetData",
        f'<sheetData a="{"x" * 60 * N}"',
        "single text or attribute|is packed more than",
    ),
    "attributes without end": (
        "<sheetData",
        "<sheetData " + " ".join(f"a{i}='1'" for i in range(5 * N)),
        "single text or attribute|is packed more than",
    ),
    "a comment without end": (
        "</sheetData>",
        f"<!--{'x' * 60 * N}--></sheetData>",
        "single text or attribute|is packed more than",
    ),
    "characters without end": (
        "</sheetData>",
        f"{'x' * 60 * N}</sheetData>",
        "single text or attribute|is packed more than",
    ),
    "a style that is not there": ('<c r="A3"', '<c r="A3" s="99999"', "cannot be read as a workbook"),
    "a cell beyond all columns": ('r="A3"', 'r="ZZZZZZ3"', "cannot be read as a workbook"),
    "a number of 5,000 digits": ("<v>1.5</v>", f"<v>{'9' * 5000}</v>", "cannot be read as a workbook"),
}


@pytest.mark.parametrize("case", sorted(BOMBS))
def test_a_workbook_that_is_none_is_refused(case: str, tmp_path: Path) -> None:
    old, new, words = BOMBS[case]
    path = workbook(tmp_path, old=old, new=new)
    with pytest.raises(DataError, match=words) as refused:
        workbook_sheets(path)
    assert refused.value.file == path
    assert refused.value.do


def test_an_attribute_of_100_mb_costs_no_time(tmp_path: Path) -> None:
    """A large attribute is refused quickly; once it occupied a worker for minutes.

    It is packed less well than it could be, so its compression ratio does not reveal it.
    """
    value = random.Random(1).randbytes(50_000_000).hex()
    path = workbook(tmp_path, old="<worksheet", new=f'<worksheet a="{value}"')
    with pytest.raises(DataError, match="single text or attribute"):
        workbook_sheets(path)


def test_an_archive_of_many_parts_is_refused(tmp_path: Path) -> None:
    path = workbook(tmp_path)
    with zipfile.ZipFile(path, "a") as packed:
        for i in range(10_000):
            packed.writestr(f"{i}.xml", "")
    with pytest.raises(DataError, match="files"):
        workbook_sheets(path)


@pytest.mark.parametrize(
    "text", ['a = "{}"', "{} = 1", 'a = ["""{}"""]', "[{}]"], ids=["text", "key", "in a list", "table"]
)
def test_a_long_text_of_toml_is_refused(text: str) -> None:
    with pytest.raises(DataError, match="single text or attribute"):
        parse_toml(text.format("x" * LONG), "data.toml")


def test_more_unpacked_than_is_taken_is_refused_before_it_is_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = workbook(tmp_path, old="</sheetData>", new="</sheetData>" + " " * 3_000_000)
    monkeypatch.setattr("calib.foreign.files.packed.MOST_UNPACKED", 2_000_000)
    with pytest.raises(DataError, match="MB unpacked"):
        workbook_sheets(path)


def test_a_damaged_workbook_is_refused_wherever_it_is_damaged(tmp_path: Path) -> None:
    sound = workbook(tmp_path).read_bytes()
    path, read = tmp_path / "damaged.xlsx", 0
    for at in range(0, len(sound), 101):
        path.write_bytes(sound[:at] + bytes([sound[at] ^ 0x55]) + sound[at + 1 :])
        try:
            read += bool(workbook_sheets(path))
        except DataError:
            continue
    assert read < 30  # the damage was where nobody reads
    for method in (zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2):
        assert workbook_sheets(workbook(tmp_path, method=method))


# -- exports as text ---------------------------------------------------------------------------------------------

NAMES = ["Name", *(f"J{k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]"]
ROWS = [";".join([f"P{i}", *(f"{i + k}.5" for k in range(9))]) for i in range(12)]


@pytest.mark.parametrize(
    "line",
    [
        "unit" + "-" * (N - 9),
        "a[" + " " * (N - 9) + "x",
        "a" + " \t" * (N // 2 - 9) + "b",
        "#" * (N - 9),
        '"' * (N - 10),
    ],
    ids=["behind a unit", "in a bracket", "between words", "of comments", "quotes"],
)
def test_a_long_line_above_the_table_costs_no_time(line: str, tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("\n".join([line, ";".join(NAMES), *ROWS]) + "\n", "utf-8")
    found = layout_of(text_sheet(file))
    assert found is not None
    assert (found.names, len(found.rows), found.stated_unit) == (tuple(NAMES), len(ROWS), None)


@pytest.mark.parametrize("name", ["a[" + " " * N + "x", " " * N + "in" + " " * N, "J1" + "_" * N, "([{" * N])
def test_a_name_of_many_characters_names_nothing(name: str) -> None:
    assert split(name) == (name, "")
    assert meaning_of(name).kind == "other"


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("P1_T2", ("p1", "T2")),
        ("P1 - t_2", ("p1", "T2")),
        ("P1Target 12", ("p1target 12", "")),
        ("P1_Target 12", ("p1", "TARGET12")),
        ("P1" + "-" * N, ("p1" + "-" * N, "")),
        ("P1" + "-" * N + "T2", ("p1", "T2")),
        ("P1" + "_T1" * N, ("p1" + "_t1" * N, "")),
    ],
)
def test_the_target_behind_the_name_of_a_pose(name: str, found: tuple[str, str]) -> None:
    assert with_target(name, {"p1"}) == found


def test_cells_apart_by_blanks_are_bounded_as_all_columns_are(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    file.write_text("1 " * 1_001 + "\n" + "1 " * 1_001, "utf-8")
    with pytest.raises(DataError, match="1001 columns; at most 1000") as refused:
        propose([file], {})
    assert refused.value.line == 1


def test_many_tables_are_told_by_the_first_of_them(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text(
        "\n".join(f"{name};X;Y\n1;2;3\n4;5;6\n7;8;9" for name in map("N{}".format, range(200))), "utf-8"
    )
    with pytest.raises(DataError, match="tables, in lines") as refused:
        propose([file], {})
    assert len(str(refused.value)) < 600


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[[file]]\nnames = ["a"]\nseparator = "dots"\n', "key 'file.*separator'"),
        ('[[file]]\nnames = ["a"]\n[file.columns]\nx = "X[mm]"\nz = "Z[mm]"\n', "columns.y'?: is missing"),
        ('[[file]]\nnames = ["a"]\n[file.columns]\nrot_1 = "A[deg]"\n', "rot_2'?: is missing"),
        ('[[file]]\nnames = ["a"]\n[header]\ntool_targets = [1, 2]\n', "tool_targets"),
        ('[[file]]\nnames = ["a"]\n[header.model]\nfit = 3\n', "fit"),
    ],
)
def test_a_map_that_says_half_is_refused_by_its_key(text: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "map.toml"
    file.write_text('format = "truepose-map/1"\n' + text, "utf-8")
    with pytest.raises(DataError, match=words):
        read_map(file)


# -- descriptions of robots ----------------------------------------------------------------------------------------


def fixed(count: int, parent: str = "") -> str:
    """Write links that are joined by fixed joints.

    `parent` replaces the first link as parent of the first joint.
    """
    links = "".join(f'<link name="a{i}"/>' for i in range(count + 1))
    joints = "".join(
        f'<joint name="j{i}" type="fixed"><parent link="{(parent if i == 0 else "") or f"a{i}"}"/>'
        f'<child link="a{i + 1}"/></joint>'
        for i in range(count)
    )
    return links + joints


SIX = urdf(*six())
URDFS = {
    "very many links": (f"<robot>{fixed(12_000)}</robot>", "no joint that moves"),
    "an axis beyond all numbers": (
        SIX.replace('<axis xyz="', '<axis xyz="1e308 1e308 1e308" old="', 1),
        "without a direction",
    ),
    "a turn beyond all numbers": (SIX.replace('rpy="', 'rpy="1e300 0 0" old="', 1), "turned by 1e[+]300 rad"),
    "a name of many characters": (SIX.replace("link_1", "l" * N), f"name of {N} characters"),
    "a type of many characters": (SIX.replace('"revolute"', f'"{"x" * N}"', 1), "has the type"),
    "a long attribute": (SIX.replace("<robot", f'<robot a="{"x" * LONG}"', 1), "single text or attribute"),
    "a long text": (SIX.replace("</robot>", "x\n" * LONG + "</robot>"), "single text or attribute"),
    "nested elements": ("<robot>" * N, "nested more than"),
    "entities within entities": (
        f'<!DOCTYPE a [<!ENTITY a0 "ha">{LAUGHS}]>' + SIX.partition("?>")[2],
        "document type",
    ),
    "another file": (
        '<!DOCTYPE robot SYSTEM "http://127.0.0.1:9/a.dtd">' + SIX.partition("?>")[2],
        "document type",
    ),
}


@pytest.mark.parametrize("case", sorted(URDFS))
def test_a_urdf_that_is_no_arm_is_refused(case: str, tmp_path: Path) -> None:
    text, words = URDFS[case]
    file = tmp_path / "arm.urdf"
    file.write_text(text, "utf-8")
    with pytest.raises(DataError, match=words) as refused:
        import_urdf(file)
    assert len(str(refused.value)) < 700
    assert refused.value.file == file


def test_a_chain_through_links_that_carry_one_another_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    ring = fixed(3, parent="a2") + "</robot>"
    file.write_text(SIX.replace("</robot>", ring).replace('<link name="a0"/>', ""), "utf-8")
    with pytest.raises(DataError, match="which carries it in turn"):
        import_urdf(file, tip="a3")


def test_a_mass_of_nothing_is_none(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    link = '<link name="link_1"><inertial><mass value="1e-320"/></inertial></link>'
    file.write_text(SIX.replace('<link name="link_1"/>', link), "utf-8")
    assert import_urdf(file).draft.loads == ()


# -- histories of watches -------------------------------------------------------------------------------------------

LINE = {
    "format": "truepose-watch-history/1",
    "data_sha256": "a",
    "baseline_sha256": "b",
    "poses_sha256": "c",
    "verdict": "unchanged",
    "residual": [0.5, 1],
}


@pytest.mark.parametrize(
    "text",
    [
        json.dumps(LINE | {"residual": [10**18]}),
        json.dumps(LINE).replace("0.5", "9" * 400),
        json.dumps(LINE).replace("0.5", "[" * N),
        *(
            json.dumps(LINE | {"residual": odd})
            for odd in ("0.5", [True], [None], ["0.5"], [[0.5]], {"a": 1})
        ),
        json.dumps(LINE | {"data_sha256": []}),
        json.dumps([LINE]),
        "[" * N,
        json.dumps(LINE)[:-5],
    ],
)
def test_a_line_of_a_history_that_is_none_is_refused_by_its_number(text: str, tmp_path: Path) -> None:
    file = tmp_path / "history.jsonl"
    file.write_text(f"{json.dumps(LINE)}\n\n{text}\n", "utf-8")
    with pytest.raises(DataError, match="is not a line of a history of watches") as refused:
        read_history(file)
    assert refused.value.line == 3


@pytest.mark.parametrize("content", [b"\xff\xfe", b"\xff\n", b"a\0b"])
def test_a_history_that_is_no_text_is_refused(content: bytes, tmp_path: Path) -> None:
    file = tmp_path / "history.jsonl"
    file.write_bytes(content)
    with pytest.raises(DataError):
        read_history(file)
    with pytest.raises(DataError, match="is a folder"):
        read_history(tmp_path)

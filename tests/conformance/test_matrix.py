"""The matrix and the wire logs as the commands print them, on few questions."""

from __future__ import annotations

from drivers import INSTRUMENTS, ROBOTS
from tests.conformance.matrix import Cell, cell, tables
from tests.conformance.readings import READINGS
from tests.conformance.wire import log_of, shortened, shown


def test_a_cell_counts_every_question() -> None:
    got = cell("abb-calsrv", "reset", questions=20, rate=0.3)
    assert got.right + got.loud == 20
    assert got.wrong == 0
    assert 0 < got.loud <= got.spoiled
    assert got.good
    assert 0.0 < got.longest_s <= got.allowed_s


def test_what_makes_a_cell_bad() -> None:
    assert not Cell("abb-calsrv", "reset", 10, 0, 1, 3, 0.1, 1.0).good
    assert not Cell("abb-calsrv", "reset", 10, 1, 0, 3, 1.1, 1.0).good
    assert not Cell("abb-calsrv", "flip", 10, 0, 1, 3, 0.1, 1.0).good  # no checksum, but read twice
    assert Cell("leica-emscon", "flip", 10, 0, 1, 3, 0.1, 1.0).good  # no checksum: bracketed
    assert not Cell("abb-calsrv", "request_digit", 10, 0, 0, 3, 0.1, 1.0, elsewhere=1).good
    assert Cell(
        "abb-stock", "request_digit", 10, 0, 0, 3, 0.1, 1.0, elsewhere=1
    ).good  # it moves on one request
    assert str(Cell("abb-stock", "request_digit", 9, 1, 0, 3, 0.1, 1.0, elsewhere=1)) == (
        "9 / 1 / 0 · 0.10 s · 1 elsewhere"
    )
    assert str(Cell("leica-emscon", "flip", 10, 0, 1, 3, 0.1, 1.0)) == "(10 / 0 / 1 · 0.10 s)"


def test_tables_have_a_row_a_fault_and_a_column_a_rig() -> None:
    found = [
        Cell(rig, fault, 3, 1, 0, 1, 0.5, 1.0)
        for rig in ("faro-mbp1", "abb-stock")
        for fault in ("split", "delay")
    ]
    assert list(tables(found)) == [
        "| fault | abb-stock | faro-mbp1 |",
        "|---|---|---|",
        "| delay | 3 / 1 / 0 · 0.50 s | 3 / 1 / 0 · 0.50 s |",
        "| split | 3 / 1 / 0 · 0.50 s | 3 / 1 / 0 · 0.50 s |",
        "",
    ]


def test_every_driver_has_a_wire_log() -> None:
    makers = {name.split(",")[0] for name in READINGS}
    wired = [each.name for each in (*ROBOTS.values(), *INSTRUMENTS.values()) if not each.by_hand]
    assert makers | {"emscon"} == {name.split("-")[0] for name in wired}


def test_a_wire_log_shows_beginning_move_and_end() -> None:
    lines, move = log_of("abb, CALSRV")
    short = list(shortened(lines, move))
    assert " ! open 127.0.0.1:" in short[0]
    assert any("> 201 " in line for line in short)
    assert short[-1].endswith(" ! close")
    assert sum("more" in line for line in short) == 2  # left out before the move and behind it
    assert len(short) < len(lines)


def test_bytes_are_shown_as_bytes() -> None:
    row = '{"t_s": 1.5, "device": "ur", "dir": ">", "data": "%s"}'
    assert shown(row % "\\u0000\\u0005V\\u0000\\u0002").endswith("> 0005 5600 02")
    assert shown(row % "0 #\\n").endswith("> 0 #\\n")

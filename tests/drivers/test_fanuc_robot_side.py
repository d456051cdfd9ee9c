"""The programs for a Fanuc as text: checks without a controller or a KAREL translator."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from drivers.fanuc.controller import OTHER_TARGET, OUT_OF_RANGE, SILENCE, STOPPED_BY_CLIENT, UNFIT, VERSION

FOLDER = Path(__file__).parents[2] / "drivers" / "fanuc" / "robot_side"
KAREL = sorted(FOLDER.glob("*.kl"))
TP = sorted(FOLDER.glob("*.LS"))
RESERVED = {
    "at",
    "by",
    "cr",
    "go",
    "hold",
    "near",
    "node",
    "path",
    "pulse",
    "signal",
    "stop",
    "time",
    "timer",
    "via",
}


def code(path: Path) -> list[str]:
    """Lines of a KAREL file without comments and strings."""
    lines = path.read_text(encoding="ascii").splitlines()
    return [re.sub(r"'[^']*'", "''", line).split("--")[0].rstrip() for line in lines]


def test_everything_is_there() -> None:
    assert [path.name for path in KAREL] == ["calio.kl", "callog.kl", "calsrv.kl", "caltext.kl"]
    assert [path.name for path in TP] == ["CALHMI.LS", "CALMOVE.LS", "CALWATCH.LS"]
    readme = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert "Untested on a controller" in readme
    for path in (*KAREL, *TP):
        assert "UNTESTED ON A CONTROLLER" in path.read_text(encoding="ascii")
        assert path.name in readme


@pytest.mark.parametrize("path", KAREL, ids=lambda path: path.name)
def test_karel_names_fit_and_blocks_close(path: Path) -> None:
    text = "\n".join(code(path))
    declared = re.findall(r"(?m)^\s*(\w+) (?:: [A-Z]|= )", text) + re.findall(r"ROUTINE (\w+)", text)
    assert declared
    for name in declared:
        assert len(name) <= 12, name  # KAREL keeps twelve characters
        assert name.lower() not in RESERVED
    for opener, closer in (
        ("IF", "ENDIF"),
        ("WHILE", "ENDWHILE"),
        ("FOR", "ENDFOR"),
        ("SELECT", "ENDSELECT"),
    ):
        opened = len(re.findall(rf"(?m)^\s*{opener}\b", text))
        assert opened == len(re.findall(rf"(?m)^\s*{closer}\b", text)), opener
    names = re.findall(r"(?m)^(?:ROUTINE|PROGRAM) (\w+)", text)
    assert sorted(names) == sorted(re.findall(r"(?m)^END (\w+)", text))
    assert all(len(line) <= 120 for line in path.read_text(encoding="ascii").splitlines())


def expanded(path: Path) -> list[str]:
    """Return the words that begin a declaration or a routine.

    They are in the order in which ktrans reads them, with includes resolved.
    """
    found = []
    for line in code(path):
        if match := re.match(r"%INCLUDE (\w+)", line):
            ours = path.with_name(f"{match[1]}.kl")
            found += expanded(ours) if ours.exists() else ["CONST"]  # of the maker: constants and types
        elif match := re.match(r"(CONST|TYPE|VAR|ROUTINE|BEGIN|END)\b", line):
            found.append(match[1])
    return found


@pytest.mark.parametrize(
    "path", [each for each in KAREL if each.stem != "caltext"], ids=lambda path: path.name
)
def test_karel_declares_before_its_routines(path: Path) -> None:
    """Only routines, with separate variables, may follow the first ROUTINE."""
    words = expanded(path)
    first = words.index("ROUTINE")
    assert "VAR" in words[:first]
    assert set(words[:first]) <= {"CONST", "TYPE", "VAR"}
    body = words[first:]
    assert re.fullmatch(r"(ROUTINE (VAR )?BEGIN END )+BEGIN END ", "".join(f"{word} " for word in body))


def test_the_first_trial_is_one_that_the_programs_allow() -> None:
    """`fit` requires the pendant off, so the first trial in T1 must not call it."""
    readme = (FOLDER / "README.md").read_text(encoding="utf-8")
    trial = readme.split("First trial")[1].split("| protocol |")[0]
    in_t1 = trial.split("1. T1")[1].split("2. AUTO")[0]
    assert re.findall(r"`(\w+)`", in_t1) == ["CALMOVE"]
    assert "fit" not in (FOLDER / "CALMOVE.LS").read_text(encoding="ascii").lower()
    assert "pendant_on" in (FOLDER / "caltext.kl").read_text(encoding="ascii").split("ROUTINE fit")[1]
    rows = [line for line in readme.splitlines() if ".LS`" in line and line.startswith("|")]
    assert len(rows) == 3
    assert all("ASCII Upload" in row for row in rows)


@pytest.mark.parametrize("path", TP, ids=lambda path: path.name)
def test_tp_lines_are_counted(path: Path) -> None:
    text = path.read_text(encoding="ascii")
    main = text.split("/MN\n")[1].split("/POS")[0].splitlines()
    assert [int(line[:4]) for line in main] == list(range(1, len(main) + 1))
    assert all(line.endswith(";") for line in main)
    assert f"LINE_COUNT\t= {len(main)};" in text
    assert f"/PROG  {path.stem}\n" in text
    labels = set(re.findall(r"(?m)^ +\d+: +LBL\[(\d+)\]", text))
    assert set(re.findall(r"(?:JMP |Skip,)LBL\[(\d+)\]", text)) <= labels


def test_registers_and_ends_are_those_of_the_driver() -> None:
    """R[81..88] are at 60..67 and PR[81] at 20, as in `drivers.fanuc.registers`."""
    move = (FOLDER / "CALMOVE.LS").read_text(encoding="ascii")
    assert "J PR[81] R[81]% FINE" in move
    assert f"R[87]={SILENCE}" in (FOLDER / "CALWATCH.LS").read_text(encoding="ascii")
    io = (FOLDER / "calio.kl").read_text(encoding="ascii")
    for name, value in (
        ("STOPPED", STOPPED_BY_CLIENT),
        ("RANGE", OUT_OF_RANGE),
        ("SILENCE", SILENCE),
        ("UNFIT", UNFIT),
        ("OTHER_TARGET", OTHER_TARGET),
        ("VERSION", VERSION),
    ):
        assert f"  {name} = {value}\n" in io
    server = (FOLDER / "calsrv.kl").read_text(encoding="ascii")
    for name, value in (("UNFIT", UNFIT), ("OTHER_TARGET", OTHER_TARGET)):
        assert f"  {name} = {value}\n" in server
    assert f"',v={VERSION},'" in (FOLDER / "callog.kl").read_text(encoding="ascii")
    screen = (FOLDER / "CALHMI.LS").read_text(encoding="ascii")
    assert f"R[91]={VERSION} " in screen
    assert f"R[86]={OTHER_TARGET} " in screen


def test_every_answer_of_our_server_is_known_to_the_driver() -> None:
    source = (FOLDER.parent / "mappdk_link.py").read_text(encoding="utf-8")
    for path in (FOLDER / "calsrv.kl", FOLDER / "callog.kl", FOLDER / "caltext.kl"):
        for answer in re.findall(r"'1:([^']+)'", path.read_text(encoding="ascii")):
            assert answer in source, answer

"""Programs of KUKA, Yaskawa and Staubli.

They are read as the joints they were written from, written back byte for byte, and corrected to the joints that the
model requires. These would catch an angle convention or a tool on the wrong side, and a posture that is guessed. They
would also catch a number outside of targets that changes, and a comment that is taken for a target.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import CalibratedModel, DataError, StatedConditions, correct
from service.programs import (
    Compensation,
    KnownFrames,
    compensate,
    named_frames,
    pulses_of,
    read_program,
    rewritten,
    write_text,
)
from service.programs.compensation import CORRECTED, REFUSED
from service.programs.postures import postures
from service.programs.program import RobotProgram
from tests.service.maker_programs import (
    DAT,
    DTX,
    EXPECTED,
    JBI,
    OPTIONS,
    PROGRAMS,
    PULSES,
    SRC,
    a_model,
    kuka_pos,
)

STATED = StatedConditions(temperature_c=22.0)
KNOWN = KnownFrames(
    named_frames("--tool", [OPTIONS["tool"]]), named_frames("--frame", [OPTIONS["frame"]]), PULSES
)
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)")
RESOLUTION = {"a.jbi": 0.002}  # deg: of a pulse


def done(
    folder: Path, name: str, text: str, known: KnownFrames = KNOWN
) -> tuple[RobotProgram, CalibratedModel, Compensation]:
    path = folder / name
    path.write_bytes(text.encode("latin-1"))
    saved = a_model(PROGRAMS[name][0])
    program = read_program(path, saved.model.robot, known)
    return program, saved, compensate(program, path, saved, STATED, known)


@pytest.mark.parametrize("name", sorted(PROGRAMS))
def test_read_as_written_and_back_byte_for_byte(tmp_path: Path, name: str) -> None:
    text = PROGRAMS[name][1]
    program, saved, _ = done(tmp_path, name, text)
    angles, why = postures(program.targets, saved.model.robot, "none")
    assert why == [""] * len(EXPECTED[name])
    np.testing.assert_allclose(np.degrees(angles), EXPECTED[name], atol=RESOLUTION.get(name, 1e-4))
    write_text(tmp_path / "out", rewritten(program, {}))
    assert (tmp_path / "out").read_bytes() == text.encode("latin-1")


@pytest.mark.parametrize("name", sorted(PROGRAMS))
def test_corrected_in_nothing_but_numbers_of_targets(tmp_path: Path, name: str) -> None:
    text = PROGRAMS[name][1]
    program, saved, made = done(tmp_path, name, text)
    assert {outcome.status for outcome in made.outcomes} == {CORRECTED}, [o.why for o in made.outcomes]
    write_text(tmp_path / name, made.text)
    again = read_program(tmp_path / name, saved.model.robot, KNOWN)
    angles, _ = postures(program.targets, saved.model.robot, "none")
    wanted = correct(saved.model, saved.estimate, angles, STATED, coupling="none").joints
    read, why = postures(again.targets, saved.model.robot, "none")
    assert set(why) == {""}
    np.testing.assert_allclose(np.degrees(read), np.degrees(wanted), atol=RESOLUTION.get(name, 1e-4))
    assert np.abs(np.degrees(read - angles)).max() > 0.01
    before, after = (
        text.splitlines(),
        made.text.encode("utf-8", "surrogateescape").decode("latin-1").splitlines(),
    )
    assert len(before) == len(after)
    lines = {target.line for target in program.targets}
    for number, (old, new) in enumerate(zip(before, after, strict=True), start=1):
        assert (old == new) == (number not in lines)
        assert NUMBER.sub("#", old) == NUMBER.sub("#", new)


def test_a_robot_without_errors_keeps_every_byte(tmp_path: Path) -> None:
    for name, (maker, text) in PROGRAMS.items():
        path = tmp_path / name
        path.write_bytes(text.encode("latin-1"))
        saved = a_model(maker)
        nominal = CalibratedModel(**{**vars(saved), "estimate": np.zeros_like(saved.estimate)})
        program = read_program(path, saved.model.robot, KNOWN)
        made = compensate(program, path, nominal, STATED, KNOWN)
        assert {outcome.status for outcome in made.outcomes} == {CORRECTED}
        write_text(tmp_path / "out", made.text)
        assert (tmp_path / "out").read_bytes() == text.encode("latin-1"), name


REFUSALS = {
    "an external axis": ("a.dat", DAT.replace("E1 0.0,E2", "E1 10.0,E2"), "external axis"),
    "a tool in the room": (
        "a.dat",
        DAT.replace("IPO_FRAME #BASE", "IPO_FRAME #TCP", 1),
        "is fixed in the cell",
    ),
    "another tool": ("a.dat", DAT.replace("TOOL_NO 1", "TOOL_NO 3", 1), "give --tool 3="),
    "a base that is computed": ("a.src", SRC.replace("BASE_DATA[2]", "myBase"), "give --frame"),
    "a posture that does not fit": ("a.dat", DAT.replace(",S 2,T", ",S 3,T", 1), "no posture fits"),
    "a component left out": ("a.src", SRC.replace("A3 8,", ""), "no number for A3"),
    "a component computed": ("a.src", SRC.replace("A3 8,", "A3 a+1,"), "no number for A3"),
    "a component twice": ("a.src", SRC.replace("A3 8,", "A3 8,A3 9,"), "given twice"),
    "a distance": ("a.src", SRC.replace("LIN {", "LIN_REL {"), "is a distance"),
    "a place in a frame": ("a.jbi", JBI.replace("POSTYPE PULSE", "POSTYPE USER"), "in the frame USER"),
    "more axes than pulses": ("a.jbi", JBI.replace("C00001=", "C00001=1,"), "7 axes, --pulses 6"),
    "a pulse that is none": ("a.jbi", JBI.replace("C00001=", "C00001=x"), "no number of pulses"),
    "a point": ("a.dtx", DTX.replace('type="jointRx"', 'type="pointRx"'), "it is a point"),
    "an angle left out": ("a.dtx", DTX.replace(' j6="5"', ""), "has no j6"),
    "an angle that is none": ("a.dtx", DTX.replace('j6="5"', 'j6="a"'), "no number"),
}


@pytest.mark.parametrize("case", sorted(REFUSALS))
def test_what_is_not_understood_is_refused_by_name(tmp_path: Path, case: str) -> None:
    name, text, words = REFUSALS[case]
    assert text != PROGRAMS[name][1], "the case changes nothing"
    refused = [outcome for outcome in done(tmp_path, name, text)[2].outcomes if outcome.status == REFUSED]
    assert refused
    assert words in refused[0].why


def test_external_axes_are_kept_where_they_carry_nothing(tmp_path: Path) -> None:
    text = DAT.replace("E1 0.0,E2", "E1 10.0,E2")
    _, _, made = done(tmp_path, "a.dat", text, replace(KNOWN, external_apart=True))
    assert {outcome.status for outcome in made.outcomes} == {CORRECTED}
    assert made.outcomes[0].target.notes == ("its external axes stay as they are",)
    assert "E1 10.0,E2 0.0" in made.text


def test_pulses_are_not_guessed(tmp_path: Path) -> None:
    _, _, made = done(tmp_path, "a.jbi", JBI, KnownFrames())
    assert {outcome.why for outcome in made.outcomes} == {
        "it is in pulses: give --pulses, how many make a degree of each axis"
    }
    assert pulses_of("--pulses", "1,-2.5") == (1.0, -2.5)
    for wrong in ("0", "1,a", "1e9", "nan", "1,,2"):
        with pytest.raises(DataError, match="pulses per degree"):
            pulses_of("--pulses", wrong)


@pytest.mark.parametrize(
    ("name", "text"), [("a.jbi", "NOP\nEND\n"), ("a.dtx", "<a/>"), ("a.dtx", "<!ENTITY a>")]
)
def test_another_file_is_refused(tmp_path: Path, name: str, text: str) -> None:
    with pytest.raises(DataError):
        done(tmp_path, name, text)


@pytest.mark.parametrize(("axis_4", "changes"), [(0.0, False), (-0.01, True)])
def test_a_sign_that_changes_is_written_into_turn(tmp_path: Path, axis_4: float, changes: bool) -> None:
    """Axis 4 is at zero or just below.

    T then gives the signs of all axes that are sent, without bits of the old value. Axes 3 and 5 must keep their sign,
    because S, which stays as it is, would change with it.
    """
    joints = (12.0, -15.0, 20.0, axis_4, 45.0, -60.0)
    text = f"DEFDAT A\nDECL E6POS P1={{{kuka_pos(joints)}}}\nENDDAT\n"
    known = KnownFrames(named_frames("--tool", ["0,0,0,0,0,0"]), named_frames("--frame", ["0,0,0,0,0,0"]))
    program, saved, made = done(tmp_path, "a.dat", text, known)
    assert made.outcomes[0].status == CORRECTED, made.outcomes[0].why
    (tmp_path / "a.dat").write_text(made.text)
    read, why = postures(
        read_program(tmp_path / "a.dat", saved.model.robot, known).targets, saved.model.robot, "none"
    )
    assert why == [""]
    (turn,) = re.findall(r"T (\d+)\}", made.text)
    assert int(turn) == sum(1 << k for k, q in enumerate(read[0]) if q < 0)
    assert (turn not in re.findall(r"T (\d+)\}", text)) == changes
    assert program.targets[0].kept == {2, 4}

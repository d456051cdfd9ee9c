"""Proposal of a map for unknown files: the findings, and what must be decided.

`propose` is called again with every answer. Some questions can be decided by the nominal robot: units,
conventions, which of two sets of columns. If exactly one answer lets the robot reach the readings, that
answer is taken and the reason is reported. The numbers never decide which robot it is, or whether rows
belong together by their order.

For this, the nominal robot is put in its best place with an unknown tool. An answer is accepted if the
robot then misses by less than 3 % of the extent of the readings and every other answer misses five times
as much. Conventions of orientation are decided in the same way with angles. A robot that meets the
readings to a hundredth of a millimetre was not measured: these are its controller's own numbers.

Proposal of a map, with the findings about its columns and the open questions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from calib.arm.kinematics import forward
from calib.arm.robot import Robot, load_robot
from calib.arm.start import base_and_tool, tool_turn
from calib.data.header import DEFAULT_GROUPS
from calib.data.hypotheses import BETTER, FEWEST, InterpretedReadings
from calib.errors import DataError
from calib.foreign.files.layout import Layout, joined, layouts_of
from calib.foreign.files.sheet import Sheet, parquet_sheet, taken_apart, text_sheet
from calib.foreign.files.workbook import workbook_sheets
from calib.foreign.map.map_file import BY, UNDECIDED, Map
from calib.foreign.meanings.assigned import LEAVE, Answers, Assigned, ColumnFinding, ColumnQuestion
from calib.foreign.meanings.assignment import assign, at_zero
from calib.foreign.readings.matching import pose_name, with_target
from calib.foreign.readings.one_file import readings_of
from calib.foreign.readings.readings import ForeignReadings
from calib.text.parquet import PARQUET
from calib.units import DEG

WORKBOOKS = (".xlsx", ".xlsm", ".xls")

MOST_FILES = 2

ASSUMED_SIGMA_MM = 0.05

_ALWAYS = ("robot", "instrument", "sigma_mm", "match", "within_s", "sheet", "1.sheet", "2.sheet")

_ENOUGH = 0.8  # share of the poses whose names must be among the points

_BELIEVED = 0.03  # share of the extent, or rad, by which a robot may miss what it was measured at

_LEAST_DEG = 0.1  # below it two conventions are alike

_TURNED_WRONG = 5.0 * DEG  # by which no arm that reaches the points errs

_MOST = 128  # combinations of answers that are tried

ENOUGH = 300

"""Readings that tell."""

_TOO_GOOD_MM = 0.005


def sheets_of(path: Path, separator: str = "") -> list[Sheet]:
    """Read the sheets of a file.

    Raises
    ------
    DataError
        The file cannot be read as text, as a workbook or as Parquet.
    """
    if path.suffix.lower() == PARQUET:
        return [parquet_sheet(path)]
    if path.suffix.lower() in WORKBOOKS:
        return [taken_apart(sheet) for sheet in workbook_sheets(path)]
    return [text_sheet(path, separator or None)]


def tables_of(
    path: Path, separator: str = "", sheet: str = "", lines: tuple[int, int] | None = None
) -> list[Layout]:
    """Find the tables of a file, of one of its sheets, or of some lines.

    Raises
    ------
    DataError
        There is no such sheet, or no table.
    """
    sheets = sheets_of(path, separator)
    if sheet and sheet not in (each.name for each in sheets):
        raise DataError(
            f"has no sheet '{sheet}'.",
            do=f"Correct it in the map: there are {', '.join(repr(each.name) for each in sheets)}.",
            file=path,
        )
    return [
        joined(layout) for layout in layouts_of([each for each in sheets if sheet in ("", each.name)], lines)
    ]


def propose(paths: Sequence[Path], answers: Answers, lines: tuple[int, int] | None = None) -> MapProposal:
    """Propose a map for one file or two.

    Parameters
    ----------
    paths : sequence of Path
        The files.
    answers : mapping of str to str
        Answers by the keys of questions; `robot` as a header names it, `sigma_mm`.
    lines : tuple of int, optional
        First and last line of the table.

    Raises
    ------
    DataError
        A file has no table, several tables, or a table that cannot be used; or there is no such robot.
    """
    if not 1 <= len(paths) <= MOST_FILES:
        raise DataError(
            f"{len(paths)} files are given.", do="Give one, or one with joints and one with points."
        )
    if answers.get("robot"):
        load_robot(answers["robot"], Path.cwd())
    tables = [tables_of(path, lines=lines) for path in paths]
    return _by_evidence(tables, dict(answers))


def _by_evidence(
    tables: Sequence[Sequence[Layout]], answers: dict[str, str], before: frozenset[str] = frozenset()
) -> MapProposal:
    found = _proposed(tables, answers, before)
    open_ones = [question for question in found.questions if question.evidence]
    if found.missing or not open_ones or len(open_ones) < len(found.questions) or "robot" not in answers:
        return found
    few = tables
    if [len(of_file) for of_file in tables] == [1]:  # of a long file some rows tell
        (layout,) = tables[0]
        few = [[replace(layout, rows=layout.rows[:: max(1, len(layout.rows) // ENOUGH)])]]
    told = decided(open_ones, lambda more: _proposed(few, {**answers, **more}))
    if not told:
        return found
    more = {key: choice for key, (choice, _) in told.items()}
    again = _by_evidence(tables, {**answers, **more}, before | frozenset(told))
    return replace(again, said=(*again.said, *(reason for _, reason in told.values())))


def _proposed(
    tables: Sequence[Sequence[Layout]], answers: Mapping[str, str], told: frozenset[str] = frozenset()
) -> MapProposal:
    said: list[str] = []
    questions: list[ColumnQuestion] = []
    chosen = _chosen(tables, answers, questions, said)
    prefixes = [""] if len(chosen) == 1 else ["1.", "2."]
    parts = [assign(layout, answers, prefix, told) for layout, prefix in zip(chosen, prefixes, strict=True)]
    for each in parts:
        said += _of_file(each)
        questions += each.questions
    by, within, notes = _match(parts, answers, questions)
    for each in parts:
        _ask_of_zeros(each, parts, by, questions)
    said += notes
    missing = []
    if not any(part.made.with_joints for part in parts):
        missing.append("joint angles (J1 .. or Achse 1 .., one column a joint)")
    if not any(part.made.with_points for part in parts):
        missing.append("measured coordinates (X, Y, Z of an instrument)")
    missing += [f"a column for {quantity}" for part in parts for quantity in part.lacking]
    if not answers.get("robot"):
        questions.append(
            ColumnQuestion("robot", "Which robot was measured (a built-in name, or a robot file)?", ())
        )
    made = Map(tuple(part.made for part in parts), _header(parts, answers, by), by, within)
    return MapProposal(
        made=made,
        parts=tuple(TableProposal(part.layout, part.findings) for part in parts),
        questions=tuple(questions),
        missing=tuple(missing),
        said=tuple(said),
        keys=frozenset(_ALWAYS).union(*(part.keys for part in parts)),
        choices=parts[0].choices,
    )


def _chosen(
    tables: Sequence[Sequence[Layout]],
    answers: Mapping[str, str],
    questions: list[ColumnQuestion],
    said: list[str],
) -> list[Layout]:
    """Choose the table of each file, or the tables of joints and points on two sheets.

    If a file has several tables, an answer names the sheet.
    """
    out: list[Layout] = []
    for number, of_file in enumerate(tables, start=1):
        if len(of_file) == 1:
            out += of_file
            if of_file[0].sheet.name:
                said.append(f"the table is on sheet '{of_file[0].sheet.name}'")
            continue
        key = "sheet" if len(tables) == 1 else f"{number}.sheet"
        named = {layout.sheet.name: layout for layout in of_file}
        if answers.get(key) in named:
            out.append(named[answers[key]])
            continue
        made = {name: assign(layout, {}).made for name, layout in named.items()}
        joints = [name for name, each in made.items() if each.with_joints and not each.with_points]
        points = [name for name, each in made.items() if each.with_points and not each.with_joints]
        if len(tables) == 1 and len(joints) == len(points) == 1 and len(made) == 2:
            said.append(f"joints are on sheet '{joints[0]}', points on sheet '{points[0]}'")
            out += [named[joints[0]], named[points[0]]]
            continue
        shown = ", ".join(f"'{name}'" for name in named)
        questions.append(ColumnQuestion(key, f"Tables are on the sheets {shown}. Which one?", tuple(named)))
        out.append(of_file[0])
    return out


def _of_file(part: Assigned) -> list[str]:
    sheet = part.layout.sheet
    name = sheet.path.name
    apart = (
        f"columns apart by {sheet.separator}{'s' if sheet.separator not in ('blanks', '') else ''}, "
        if sheet.separator
        else ""
    )
    decimal = {",": "decimal commas", ".": "decimal points"}.get(part.notation.decimal, "decimals open")
    thousands = f", thousands apart by '{part.notation.thousands}'" if part.notation.thousands else ""
    out = [f"{name}: {apart}{decimal}{thousands}; {len(part.layout.rows)} rows"]
    return out + [f"{name}: {each}" for each in (*sheet.said, *part.layout.said)]


def _match(
    parts: Sequence[Assigned], answers: Mapping[str, str], questions: list[ColumnQuestion]
) -> tuple[str, float, list[str]]:
    """Choose the rule by which two tables are matched.

    Also returns the seconds for a match by time, and remarks on the rule.
    """
    if len(parts) == 1:
        return "", 0.0, []
    joints = [part for part in parts if part.made.with_joints]
    points = [part for part in parts if part.made.with_points]
    if len(joints) == 2 and len(points) == 2:
        raise DataError(
            "both files hold joints and points.",
            do="Convert them one by one, or give one with joints and one with points.",
            file=parts[1].layout.sheet.shown,
        )
    if len(joints) != 1 or len(points) != 1:
        return UNDECIDED, 0.0, []
    within = _number(answers, "within_s", 0.0)
    if answers.get("match") in BY:
        return answers["match"], within, []
    counted = agreed = 0
    for part, other in ((joints[0], points[0]),):
        key, of = _key(part), _key(other)
        if key and of:
            poses = {pose_name(cell) for cell in part.layout.cells[key]}
            seen = {with_target(cell, poses)[0] for cell in other.layout.cells[of]}
            agreed = len(poses & seen)
            counted = len(poses)
            numbers = all(pose.isdigit() for pose in poses)
            if agreed >= _ENOUGH * counted and not numbers:
                return (
                    "name",
                    0.0,
                    [
                        f"points belong to joints by name: {agreed} of {counted} names of '{key}' are in '{of}'"
                    ],
                )
    text = f"How do points and joints belong together? {agreed} of {counted} names agree"
    if counted and agreed >= _ENOUGH * counted:
        text += ", but they are mere numbers, which may count the rows of either file"
    questions.append(
        ColumnQuestion("match", f"{text}. (time needs within_s too)", BY, "name" if agreed else "")
    )
    return UNDECIDED, within, []


def _ask_of_zeros(
    part: Assigned, parts: Sequence[Assigned], by: str, questions: list[ColumnQuestion]
) -> None:
    """Ask about points at exactly 0, 0, 0 that will be readings."""
    key = f"{part.prefix}origin"
    part.keys.add(key)
    rows = at_zero(part).tolist()
    joints = next((each for each in parts if each.made.with_joints), part)
    if (
        by == "name" and joints is not part and _key(joints) and _key(part)
    ):  # points of other names, as of nests, are left aside
        poses = {pose_name(cell) for cell in joints.layout.cells[_key(joints)]}
        rows = [i for i in rows if with_target(part.layout.cells[_key(part)][i], poses)[0] in poses]
    if not rows:
        return
    lines = ", ".join(str(part.layout.lines[i]) for i in rows[:5])
    text = (
        f"{len(rows)} of {len(part.layout.rows)} rows (line {lines}) have a point at exactly 0, 0, 0, which "
        "instruments show for a lost point, and which is where a frame begins. Was it lost or measured?"
    )
    answer = part.ask(
        ColumnQuestion(key, text, ("lost", "measured"), "measured" if len(rows) == 1 else "lost")
    )
    questions += [question for question in part.questions if question.key == key]
    part.at_origin = answer == "measured"


def _key(part: Assigned) -> str:
    return part.columns.get("pose") or part.columns.get("id") or ""


def _number(answers: Answers, key: str, usual: float) -> float:
    """Parse a number that is answered; `usual` without an answer."""
    text = answers.get(key)
    if not text:
        return usual
    with suppress(ValueError):
        if 0.0 < (value := float(text)) < np.inf:
            return value
    raise DataError(f"{key} = {text!r} is not a number above 0.", do="Write it as 0.05.", key=key)


def _header(parts: Sequence[Assigned], answers: Mapping[str, str], by: str) -> dict[str, Any]:
    """Build the header of the data set.

    The tool is fitted, since no file states the positions of the targets on the flange.
    """
    names: list[str] = []
    at_origin = [part.at_origin for part in parts if part.at_origin is not None]
    for part in parts:
        names += list(part.targets)
        if "target" in part.columns:
            names += list(dict.fromkeys(part.layout.cells[part.columns["target"]]))
    if not names and by == "name":
        points = [part for part in parts if not part.made.with_joints]
        joints = [part for part in parts if part.made.with_joints]
        if points and joints and _key(points[0]) and _key(joints[0]):
            poses = {pose_name(cell) for cell in joints[0].layout.cells[_key(joints[0])]}
            found = {with_target(cell, poses)[1] for cell in points[0].layout.cells[_key(points[0])]}
            names = sorted(found - {""})
    return {
        "format": "truepose-dataset/1",
        "robot": answers.get("robot", UNDECIDED),
        "instrument": answers.get("instrument", "unknown"),
        "world": "free",
        **({"measured_at_origin": any(at_origin)} if at_origin else {}),
        **({"joints": "read-back"} if any(part.read_back for part in parts) else {}),
        "model": {"fit": [*DEFAULT_GROUPS, "tool"]},
        "noise": {"kind": "isotropic", "sigma_mm": _number(answers, "sigma_mm", ASSUMED_SIGMA_MM)},
        "tool_targets": {name: [0.0, 0.0, 0.0] for name in dict.fromkeys(names)} or {"T1": [0.0, 0.0, 0.0]},
    }


@dataclass(frozen=True)
class Fit:
    """Fit of the nominal robot in its best place to readings.

    Attributes
    ----------
    miss : float
        Distance within which three quarters of the readings lie, mm.
    extent : float
        Extent of the points, or of the flange if that is larger because it turns about points, mm.
    turn : float
        Median angle of the orientations from the nominal tool's, rad; NaN if none were measured.
    """

    robot: str
    miss: float
    extent: float
    turn: float
    rows: int

    @property
    def share(self) -> float:
        """The miss as a share of the extent."""
        return self.miss / max(self.extent, 1e-9)

    @property
    def sentence(self) -> str:
        """The fit as text."""
        turned = f" and {self.turn / DEG:.2f} deg" if np.isfinite(self.turn) else ""
        how = "three quarters of them, the nominal robot in its best place, tool fitted"
        return f"these fit {self.robot} to {self.miss:.3g} mm{turned} ({how})"

    @property
    def suspicious(self) -> bool:
        """Whether the nominal robot misses by more than an arm does."""
        return self.share > _BELIEVED

    @property
    def turned_wrong(self) -> bool:
        """Whether the robot reaches the points and its orientations are others."""
        return not self.suspicious and self.turn > _TURNED_WRONG

    @property
    def own_numbers(self) -> bool:
        """Whether the robot is met as only its own controller meets it."""
        return self.miss < _TOO_GOOD_MM


def fit_of(readings: ForeignReadings, robot: Robot) -> Fit | None:
    """Fit the nominal robot to readings whose joints are in its order.

    Returns None for fewer than `FEWEST` readings.
    """
    rows = np.flatnonzero(
        np.isfinite(readings.points).all(axis=1) & np.array([not why for why in readings.rejected])
    )
    if len(rows) < FEWEST:
        return None
    rows = rows[:: max(1, -(-len(rows) // ENOUGH))]
    few = readings.take(rows)
    names = list(dict.fromkeys(few.texts.get("target", ("",) * len(few))))
    which = np.array(
        [names.index(name) for name in few.texts.get("target", ("",) * len(few))], dtype=np.int64
    )
    tools = np.zeros((len(names), 3))
    couplings = ("none", *robot.joint_matrices)
    meanings = [InterpretedReadings(robot, coupling, few.joints, which, few.points) for coupling in couplings]
    misses = [each.miss(tools, tool_unknown=True, zero_unknown=False) for each in meanings]
    best = int(np.argmin([miss for miss, _ in misses]))
    turn = np.nan
    turned = np.isfinite(few.turns).all(axis=1)
    if turned.sum() >= FEWEST:
        flange = forward(robot, robot.model_angles(few.joints, couplings[best]))
        pose, _ = base_and_tool(flange, tools, which, few.points, tool_unknown=True)
        fixed = tool_turn(flange[turned], pose, few.turns[turned])
        there = Rotation.from_matrix(pose[:3, :3] @ flange[turned][:, :3, :3] @ fixed)
        measured = Rotation.from_quat(few.turns[turned], scalar_first=True)
        turn = float(np.median((there.inv() * measured).magnitude()))
    return Fit(robot.name, *misses[best], turn, len(few))


def decided(
    questions: Sequence[ColumnQuestion], proposed: Callable[[dict[str, str]], MapProposal]
) -> dict[str, tuple[str, str]]:
    """Find the answers that the nominal robot decides, with the reasons, by question key.

    Questions that it does not decide are absent.
    """
    choices = [[choice for choice in question.choices if choice != LEAVE] for question in questions]
    if any(not each for each in choices) or np.prod([len(each) for each in choices]) > _MOST:
        return {}
    tried: list[tuple[tuple[str, ...], Fit]] = []
    for combination in product(*choices):
        fit = _best(dict(zip((q.key for q in questions), combination, strict=True)), proposed)
        if fit is not None:
            tried.append((combination, fit))
    told: dict[str, tuple[str, str]] = {}
    if not tried:
        return told
    # points first: which answers let the robot reach them at all
    best = min(fit.share for _, fit in tried)
    if best > _BELIEVED:
        return told
    reach = [(combination, fit) for combination, fit in tried if fit.share < BETTER * best]
    turns = [fit.turn for _, fit in reach if np.isfinite(fit.turn)]
    near = reach
    if turns and min(turns) < _BELIEVED:
        least = max(min(turns), _LEAST_DEG * DEG)
        near = [
            (combination, fit)
            for combination, fit in reach
            if np.isfinite(fit.turn) and fit.turn < BETTER * least
        ]
    # where no orientation fits, as by a wrong answer on their convention, the points decide what is about points
    for k, question in enumerate(questions):
        left = {combination[k] for combination, _ in near}
        if len(left) == 1 and len(choices[k]) > 1:
            choice = left.pop()
            others = [fit for combination, fit in tried if combination[k] != choice]
            fit = min((fit for _, fit in near), key=lambda fit: fit.share)
            told[question.key] = (choice, _reason(question, choice, fit, others))
    return told


def _reason(question: ColumnQuestion, choice: str, fit: Fit, others: Sequence[Fit]) -> str:
    far = ""
    if others:
        nearest = min(others, key=lambda other: (other.share, other.turn))
        far = (
            f"; otherwise {nearest.miss:.3g} of {nearest.extent:.3g} mm"
            if nearest.share > BETTER * fit.share
            else ""
        )
        far = far or "; otherwise the orientations do not fit"
    turned = f" and {fit.turn / DEG:.2f} deg" if np.isfinite(fit.turn) else ""
    return f"{question.key} = {choice}: only so do the readings fit {fit.robot}, to {fit.miss:.3g} mm{turned}{far}"


def _best(answers: dict[str, str], proposed: Callable[[dict[str, str]], MapProposal]) -> Fit | None:
    """Find the best fit under some answers.

    Further questions that these raise are tried too. Orientations are left out there (`LEAVE`).
    """
    try:
        proposal = proposed(answers)
    except DataError:  # answers that exclude each other
        return None
    if proposal.complete:
        return _tried(proposal)
    choices = [(LEAVE,) if LEAVE in question.choices else question.choices for question in proposal.questions]
    if proposal.missing or not all(question.evidence for question in proposal.questions):
        return None
    if np.prod([len(each) for each in choices]) > _MOST:
        return None
    keys = [question.key for question in proposal.questions]
    fits = [
        _best({**answers, **dict(zip(keys, combination, strict=True))}, proposed)
        for combination in product(*choices)
    ]
    return min((fit for fit in fits if fit is not None), key=lambda fit: fit.share, default=None)


def _tried(proposal: MapProposal) -> Fit | None:
    try:
        robot = load_robot(str(proposal.made.header["robot"]), Path.cwd())
        readings, _ = readings_of(proposal.made, proposal.layouts, "the proposal")
        return fit_of(readings.of_robot(robot, "the proposal"), robot)
    except DataError:  # an answer under which the files cannot be read is not the one
        return None


@dataclass(frozen=True)
class TableProposal:
    """A table of the proposal, with the findings about its columns."""

    layout: Layout
    findings: tuple[ColumnFinding, ...]


@dataclass(frozen=True)
class MapProposal:
    """A proposed map, complete or with open questions.

    Attributes
    ----------
    questions : tuple of ColumnQuestion
        Open questions.
    missing : tuple of str
        Information that no file holds.
    said : tuple of str
        Remarks on how the files were read.
    keys : frozenset of str
        Keys of everything that may be answered.
    choices : tuple of str
        What a column may be stated to be, by an answer `column.NAME`.
    """

    made: Map
    parts: tuple[TableProposal, ...]
    questions: tuple[ColumnQuestion, ...]
    missing: tuple[str, ...]
    said: tuple[str, ...]
    keys: frozenset[str]
    choices: tuple[str, ...]

    @property
    def layouts(self) -> tuple[Layout, ...]:
        """The tables in the order of the map."""
        return tuple(part.layout for part in self.parts)

    @property
    def complete(self) -> bool:
        """Whether the map can be used."""
        return not self.questions and not self.missing

    def refuse_unknown(self, answers: Answers, where: str) -> None:
        """Raise DataError for an answer that nothing asks; `where` is the option or field that held it."""
        unknown = [key for key in answers if key not in self.keys]
        if unknown:
            raise DataError(
                f"answers '{unknown[0]}', which nothing asks.",
                do=f"Open are {', '.join(q.key for q in self.questions) or 'no questions'}.",
                file=where,
            )

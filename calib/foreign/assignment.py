"""What the columns of one table are: by their names, the row of units and the numbers; what is open is a question.

A unit is what the name, the row of units, the cells or the preamble say. Where none does it is asked, unless the numbers
leave one possibility (angles above two turns are degrees); where numbers cannot be what the name says it is asked as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib.array import Array
from calib.foreign.dates import seconds_of
from calib.foreign.entry import ANGLES, LENGTHS
from calib.foreign.layout import Layout
from calib.foreign.map_file import UNDECIDED, FileMap
from calib.foreign.number import Notation, notation_of, suffix_of
from calib.foreign.rotations import ANGLES_OF, USUAL
from calib.foreign.sizes import FEW, HUGE_MM, LARGE_DEG, MOST_RAD, SMALL_MM
from calib.foreign.unit_words import unit_of
from calib.foreign.words import Meaning, meaning_of

Answers = Mapping[str, str]
_GOOD = {
    "ok",
    "valid",
    "good",
    "gültig",
    "gueltig",
    "gut",
    "1",
    "true",
    "yes",
    "ja",
    "io",
    "i.o.",
    "pass",
    "measured",
    "gemessen",
}
_BAD = {"nok", "invalid", "bad", "ungültig", "0", "false", "no", "nein", "nio", "n.i.o.", "lost", "fail", "failed", "error",
        "rejected", "not measured", "fehler"}  # fmt: skip
_SETS = {"calibration", "reference", "repeat", "validation"}
_YASKAWA = ("s", "l", "u", "r", "b", "t")
LEAVE = "leave"


@dataclass(frozen=True)
class Question:
    """A question that the files leave open. key: what `--answer KEY=CHOICE` names; choices: the answers; proposed: the
    likeliest; evidence: whether the robot can tell."""

    key: str
    text: str
    choices: tuple[str, ...]
    proposed: str = ""
    evidence: bool = False


@dataclass(frozen=True)
class Finding:
    """What a column was taken for, in which unit, and why; `read_as` is '' for one that is left aside."""

    column: str
    read_as: str
    unit: str
    why: str


@dataclass
class Assigned:
    """The map of one table as it grows, what was found and what is asked."""

    layout: Layout
    answers: Answers
    prefix: str = ""
    notation: Notation = field(default_factory=Notation)
    columns: dict[str, str] = field(default_factory=dict)
    targets: dict[str, dict[str, str]] = field(default_factory=dict)
    rotation: str = ""
    status_ok: tuple[str, ...] = ()
    found: dict[str, Finding] = field(default_factory=dict)
    questions: list[Question] = field(default_factory=list)

    def ask(self, question: Question) -> str:
        """The answer to a question, or `?`, and the question is open."""
        answer = self.answers.get(question.key)
        if answer is None:
            self.questions.append(question)
            return UNDECIDED
        return answer

    def take(self, column: str, read_as: str, unit: str = "", why: str = "its name") -> None:
        """Note what a column was taken for."""
        self.found[column] = Finding(column, read_as, unit, why)

    def aside(self, column: str, why: str) -> None:
        """Note why a column is left aside."""
        self.found.setdefault(column, Finding(column, "", "", why))

    @property
    def made(self) -> FileMap:
        """The map of the file."""
        return FileMap(
            names=self.layout.names, columns=self.columns, targets=self.targets, sheet=self.layout.sheet.name,
            separator=self.layout.sheet.separator, decimal=self.notation.decimal, thousands=self.notation.thousands,
            rotation=self.rotation, status_ok=self.status_ok,
        )  # fmt: skip

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Of every column, in their order."""
        return tuple(self.found[name] for name in self.layout.names if name in self.found)

    def values(self, columns: Sequence[str]) -> Array:
        """(rows, columns) of the numbers that are there."""
        cells = self.layout.cells
        rows = [[self.notation.number(cell) for cell in cells[name]] for name in columns]
        return np.array([[np.nan if v is None else v for v in row] for row in rows], dtype=np.float64).T


Set = tuple[str, ...]


def assign(layout: Layout, answers: Answers, prefix: str = "") -> Assigned:
    """What every column of a table is, as far as can be told. prefix: of the keys of questions, for a second file."""
    to = Assigned(layout, answers, prefix)
    meanings = {name: meaning_of(name) for name in layout.names}
    plain = {
        name.lower().split("#")[0].split("[")[0].split("(")[0].strip(): name
        for name in reversed(layout.names)
    }
    if all(letter in plain for letter in _YASKAWA):
        for k, letter in enumerate(_YASKAWA, start=1):
            meanings[plain[letter]] = Meaning("joint", k, "", "slurbt", unit=meanings[plain[letter]].unit)
    _notation(to)
    _copies(to, meanings)
    _joints(to, meanings)
    _points(to, meanings)
    _turns(to, meanings)
    _names(to, meanings)
    for name in layout.names:
        meaning = meanings.get(name)
        why = "not known; a map may name it"
        if meaning is not None:
            why = {
                "deviation": "a deviation, not a reading",
                "spread": "an uncertainty of unknown coverage",
            }.get(meaning.kind, why)
            why = {"nominal": "nominal, not measured", "own": "the controller's own, not measured"}.get(
                meaning.role, why
            )
        if not any(layout.cells[name]):
            why = "empty"
        to.aside(name, why)
    return to


def _notation(to: Assigned) -> None:
    found = notation_of([cell for cell in cells if cell] for cells in to.layout.cells.values())
    answer = to.answers.get(f"{to.prefix}decimal")
    if answer in (".", ","):
        other = "," if answer == "." else "."
        uses = any(
            other in cell
            for cells in to.layout.cells.values()
            for cell in cells
            if Notation(answer, other).number(cell)
        )
        to.notation = Notation(answer, other if uses else "")
    elif found is None:
        to.ask(Question(f"{to.prefix}decimal", "Points and commas in the numbers contradict each other, or may be decimals or "
                        "thousands. Which mark stands before decimals?", (".", ",")))  # fmt: skip
        to.notation = Notation(UNDECIDED)
    else:
        to.notation = found


def _copies(to: Assigned, meanings: dict[str, Meaning]) -> None:
    """Columns given twice with the same contents count once."""
    for name in to.layout.names:
        first, mark, number = name.rpartition("#")
        if (
            mark
            and number.isdigit()
            and first in meanings
            and to.layout.cells[name] == to.layout.cells[first]
        ):
            to.aside(name, f"the same as '{first}'")
            del meanings[name]


def _occurrence(name: str) -> str:
    _, mark, number = name.rpartition("#")
    return f"#{number}" if mark and number.isdigit() else ""


def _joints(to: Assigned, meanings: dict[str, Meaning]) -> None:
    sets: dict[tuple[str, ...], dict[int, str]] = {}
    for name, meaning in meanings.items():
        if meaning.kind == "joint":
            key = (meaning.role, meaning.family, _occurrence(name))
            sets.setdefault(key, {}).setdefault(meaning.index, name)
    whole = {}
    for key, by_index in sets.items():
        start = min(by_index)
        if start > 1 or sorted(by_index) != list(range(start, start + len(by_index))) or len(by_index) < 2:
            continue
        whole[key] = tuple(by_index[k] for k in sorted(by_index))
    for key in list(whole):  # q1..q4 beside joints are a quaternion, as is q0..q3 of norm 1
        if key[1] == "q" and len(whole[key]) == 4 and (len(whole) > 1 or _normed(to, whole[key])):
            for k, name in enumerate(whole.pop(key)):
                meanings[name] = Meaning("quaternion", k, key[0], "numbered")  # type: ignore[arg-type]
    commanded = {key: names for key, names in whole.items() if key[0] != "read"}
    read = {key: names for key, names in whole.items() if key[0] == "read"}
    chosen = _one_of(
        to, "joints", "Several sets of columns may be the joints as commanded", commanded or read
    )
    if not chosen:
        return
    unit, why = _unit(to, chosen, meanings, "angles", ("deg", "rad"))
    is_read = chosen in read.values()
    note = "; what the controller read back, commanded ones are not there" if is_read else ""
    for k, name in enumerate(chosen, start=1):
        to.columns[f"j{k}"] = f"{name}[{unit[k - 1]}]"
        to.take(name, f"joint {k}", unit[k - 1], why[k - 1] + note)
    beside = [names for names in read.values() if len(names) == len(chosen)]
    if not is_read and len(beside) == 1:
        unit, why = _unit(to, beside[0], meanings, "angles", ("deg", "rad"))
        for k, name in enumerate(beside[0], start=1):
            to.columns[f"read{k}"] = f"{name}[{unit[k - 1]}]"
            to.take(name, f"joint {k} as read back", unit[k - 1], why[k - 1])
    _further(to, meanings, len(chosen))


def _further(to: Assigned, meanings: dict[str, Meaning], joints: int) -> None:
    """External axes that move, and what says how joints arrived."""
    for name, meaning in meanings.items():
        bare = name.lower()
        if meaning.kind == "external" and f"e{meaning.index}" not in to.columns and meaning.role != "read":
            values = to.values([name])[:, 0]
            if np.nanmax(np.abs(values), initial=0.0) == 0.0:
                to.aside(name, "an external axis that is 0 throughout")
                continue
            unit, why = _unit(to, (name,), meanings, f"e{meaning.index}", ("mm", "m", "deg", "rad"))
            to.columns[f"e{meaning.index}"] = f"{name}[{unit[0]}]"
            to.take(name, f"external axis {meaning.index}", unit[0], why[0])
        for start, end in (("approach", ""), ("prev", "_deg")):
            number = bare.removeprefix(start).removesuffix(end)
            if bare == f"{start}{number}{end}" and number.isdigit() and int(number) <= joints:
                to.columns[f"{start}{number}"] = name + ("[deg]" if end else "")
                to.take(name, f"{start} of joint {number}", end[1:])


def _normed(to: Assigned, names: Sequence[str]) -> bool:
    norm = np.linalg.norm(to.values(names), axis=1)
    return bool(len(norm) and np.nanmax(np.abs(norm - 1.0)) < 1e-2)


def _one_of(to: Assigned, what: str, text: str, sets: Mapping[tuple[str, ...], Set]) -> Set | None:
    """The only set, or the one that was answered; None where there is none, or it is open."""
    if not sets:
        return None
    if len(sets) == 1:
        return next(iter(sets.values()))
    choices = {names[0]: names for names in sets.values()}
    shown = "; ".join(f"{names[0]} .. {names[-1]}" for names in sets.values())
    answer = to.ask(Question(f"{to.prefix}{what}", f"{text}: {shown}. Which?", tuple(choices), evidence=True))
    if answer in choices:
        return choices[answer]
    for names in sets.values():
        for name in names:
            to.aside(name, "open: see the question")
    first = next(iter(sets.values()))
    for quantity, name in zip(("j1",) if what == "joints" else "xyz", first, strict=False):
        to.columns[quantity] = UNDECIDED
        del name
    return None


def _points(to: Assigned, meanings: dict[str, Meaning]) -> None:
    sets: dict[tuple[str, ...], dict[int, str]] = {}
    for name, meaning in meanings.items():
        if meaning.kind == "point":
            sets.setdefault((meaning.role, meaning.group, _occurrence(name)), {}).setdefault(
                meaning.index, name
            )
    whole = {key: tuple(of[k] for k in range(3)) for key, of in sets.items() if len(of) == 3}
    for role in ("measured", ""):
        if candidates := {key: names for key, names in whole.items() if key[0] == role}:
            break
    else:
        candidates = {}
    if not candidates and whole:
        shown = "; ".join(f"{names[0]} ({key[0]})" for key, names in whole.items())
        choices = {names[0]: names for names in whole.values()}
        answer = to.ask(Question(f"{to.prefix}points", f"No coordinates are named as measured, only {shown}. Which were measured by an "
                                 "instrument?", (*choices, "none")))  # fmt: skip
        if answer in choices:
            candidates = {("",): choices[answer]}
        elif answer == UNDECIDED:
            to.columns.update(dict.fromkeys("xyz", UNDECIDED))
    groups = {key[1]: names for key, names in candidates.items() if len(key) == 3 and key[1]}
    if groups and len(groups) == len(candidates) and not any(group.isdigit() for group in groups):
        _unit_of_points(to, [name for names in groups.values() for name in names], meanings)
        for group, names in groups.items():
            to.targets[group] = {
                axis: to.columns.pop(f"{axis}@{name}") for axis, name in zip("xyz", names, strict=True)
            }
            for axis, name in zip("xyz", names, strict=True):
                of = to.found[name]
                to.found[name] = replace(of, read_as=f"{axis} of target {group}")
        return
    chosen = _one_of(to, "points", "Several sets of columns may be the measured point", candidates)
    if chosen:
        _unit_of_points(to, chosen, meanings)
        for axis, name in zip("xyz", chosen, strict=True):
            to.columns[axis] = to.columns.pop(f"{axis}@{name}")


def _unit_of_points(to: Assigned, names: Sequence[str], meanings: dict[str, Meaning]) -> None:
    """Entries `x@NAME` of columns of coordinates, for the caller to put where they belong."""
    units, why = _unit(to, names, meanings, "points", ("mm", "m", "in", "um"))
    for k, (name, unit, reason) in enumerate(zip(names, units, why, strict=True)):
        to.columns[f"{'xyz'[k % 3]}@{name}"] = f"{name}[{unit}]"
        to.take(name, f"{'xyz'[k % 3]} measured", unit, reason)


def _unit(
    to: Assigned, names: Sequence[str], meanings: Mapping[str, Meaning], what: str, choices: tuple[str, ...]
) -> tuple[list[str], list[str]]:
    """Units of columns of one kind, each with the reason; `?` where it is asked."""
    layout = to.layout
    of_row = dict(zip(layout.names, layout.units, strict=False))
    units, why = [], []
    for name in names:
        suffixes = {unit_of(suffix_of(cell)) for cell in layout.cells[name] if cell} - {""}
        said = [
            (meanings[name].unit, "its name"),
            (of_row.get(name, ""), "the row of units"),
            (suffixes.pop() if len(suffixes) == 1 else "", "its cells"),
        ]
        given = [(unit, reason) for unit, reason in said if unit]
        if len({unit for unit, _ in given}) > 1:
            given = [("?", " and ".join(f"{reason} says {unit}" for unit, reason in given))]
        units.append(given[0][0] if given else "")
        why.append(given[0][1] if given else "")
    key = f"{to.prefix}unit.{what}"
    if key in to.answers:
        return [to.answers[key]] * len(names), ["as answered"] * len(names)
    stated = layout.stated_unit
    if what == "points" and stated and not any(units):
        units, why = (
            [stated[0]] * len(names),
            [f"the preamble: '{layout.above[stated[1]][:40]}'"] * len(names),
        )
    values = to.values(names)
    if not np.isfinite(values).any(axis=0).all():  # nothing to judge by: what the file states counts
        return [unit or UNDECIDED for unit in units], [reason or "open" for reason in why]
    doubt = _doubt(values, units, why, what)
    if doubt:
        likely = _likely(values, what)
        if not doubt[1] and likely == "deg" and what != "points":
            return ["deg"] * len(names), [
                f"up to {np.nanmax(np.abs(values)):.0f}: only degrees are so large"
            ] * len(names)
        to.ask(Question(key, doubt[0], choices, likely.rstrip("?"), evidence=True))
        return [UNDECIDED] * len(names), ["open: see the question"] * len(names)
    return units, why


def _doubt(values: Array, units: Sequence[str], why: Sequence[str], what: str) -> tuple[str, bool] | None:
    """Why the units of numbers (n, c) are open, and whether something states them; None where they are not."""
    size = float(np.nanmax(np.abs(values), initial=0.0))
    if any(unit == "?" for unit in units):
        return (
            f"The unit of the {what} is none that is taken: {next(w for u, w in zip(units, why, strict=True) if u == '?')}. Which?",
            True,
        )
    if not all(units):
        return f"Nothing states the unit of the {what}; they go up to {size:.4g}. Which is it?", any(units)
    if what.startswith("e"):
        return None
    lengths = all(unit in LENGTHS for unit in units)
    if what == "points":
        if not lengths:
            return f"Coordinates are said to be in {units[0]} ({why[0]}). Which is it?", True
        extent = (
            float(np.nanmax(np.nanmax(values, axis=0) - np.nanmin(values, axis=0), initial=0.0))
            * LENGTHS[units[0]]
        )
        if len(values) >= FEW and not SMALL_MM <= extent <= HUGE_MM:
            return (
                f"As {units[0]} ({why[0]}) the points span {extent:.4g} mm, and no robot is measured so. Which is it?",
                True,
            )
        return None
    known = (ANGLES, LENGTHS) if what == "angles" else (ANGLES,)  # a joint may slide
    if not all(any(unit in of for of in known) for unit in units):
        return f"Angles are said to be in {', '.join(dict.fromkeys(units))}. Which is it?", True
    if len(values) >= FEW and set(units) == {"deg"} and size <= LARGE_DEG and what == "angles":
        return (
            f"As deg ({why[0]}) no joint exceeds {size:.3f} deg, which looks like radians. Which is it?",
            True,
        )
    if (
        "rad" in units
        and np.nanmax(np.abs(values[:, [k for k, u in enumerate(units) if u == "rad"]])) > MOST_RAD
    ):
        return f"As rad ({why[0]}) they go up to {size:.4g}, which only degrees do. Which is it?", True
    return None


def _likely(values: Array, what: str) -> str:
    """The unit that numbers look like; for angles `deg` where nothing else can be so large."""
    size = float(np.nanmax(np.abs(values), initial=0.0))
    if what == "points":
        return (
            "mm"
            if float(np.nanmax(np.nanmax(values, axis=0) - np.nanmin(values, axis=0), initial=0.0)) > 150.0
            else "m"
        )
    return "deg" if size > MOST_RAD else "rad" if size <= LARGE_DEG else "deg?"


def _turns(to: Assigned, meanings: dict[str, Meaning]) -> None:
    """Orientation, where x, y and z are decided and of the same origin."""
    taken = [name for name, found in to.found.items() if found.read_as.endswith(" measured")]
    if not taken:
        return
    role = meanings[taken[0]].role
    sets: dict[tuple[str, ...], dict[int, str]] = {}
    for name, meaning in meanings.items():
        if meaning.kind in ("angle", "quaternion"):
            sets.setdefault((meaning.kind, meaning.role, meaning.family, _occurrence(name)), {}).setdefault(
                meaning.index, name
            )
    whole = {key: of for key, of in sets.items() if len(of) == (3 if key[0] == "angle" else 4)}
    for key, of in whole.items():
        if key[1] != role:
            for name in of.values():
                to.aside(name, "an orientation of another origin than the measured point")
    whole = {key: of for key, of in whole.items() if key[1] == role}
    if len(whole) > 1:
        for of in whole.values():
            for name in of.values():
                to.aside(name, "several orientations are there; a map may name one")
        return
    for key, of in whole.items():
        names = tuple(of[k] for k in sorted(of))
        if key[0] == "quaternion":
            _quaternion(to, names, key[2])
        else:
            _angles(to, names, key[2], meanings)


def _quaternion(to: Assigned, names: Set, family: str) -> None:
    why, order = "its name", "wxyz"
    if family == "numbered":
        key = f"{to.prefix}quaternion"
        order = to.ask(Question(key, f"Is {names[0]} .. {names[3]} a quaternion with the scalar first or last?",
                                ("wxyz", "xyzw", LEAVE), "wxyz", evidence=True))  # fmt: skip
        why = "as answered"
    if order == LEAVE:
        return
    if order == UNDECIDED:
        to.columns["rot_w"] = UNDECIDED
        return
    for part, name in zip(order, names, strict=True):
        to.columns[f"rot_{part}"] = name
        to.take(name, f"quaternion {part}", "", why)


def _angles(to: Assigned, names: Set, family: str, meanings: Mapping[str, Meaning]) -> None:
    convention, why = ANGLES_OF.get(family, ("", ""))
    key = f"{to.prefix}rotation"
    if not convention or key in to.answers:
        shown = ", ".join(names)
        convention = to.ask(Question(key, f"By which convention are {shown} an orientation?", (*USUAL, LEAVE),
                                     "roll-pitch-yaw" if family == "rpy" else "", evidence=True))  # fmt: skip
        why = "as answered"
    if convention == LEAVE:
        return
    to.rotation = convention
    units, reason = _unit(to, names, meanings, "rotation", ("deg", "rad"))
    for k, name in enumerate(names, start=1):
        to.columns[f"rot_{k}"] = f"{name}[{units[k - 1]}]"
        to.take(name, f"angle {k} of {convention}", units[k - 1], f"{reason[k - 1]}; {why}")


def _names(to: Assigned, meanings: Mapping[str, Meaning]) -> None:
    cells = to.layout.cells
    for name, meaning in meanings.items():
        if name in to.found or not any(cells[name]):
            continue
        kind, filled = meaning.kind, [cell for cell in cells[name] if cell]
        if kind == "time" and "time" not in to.columns:
            _time(to, name, meaning, filled)
        elif kind == "temperature" and "t_air" not in to.columns and np.isfinite(to.values([name])).all():
            to.columns["t_air"] = f"{name}[c]"
            to.take(name, "temperature of the air", "c")
        elif (
            kind == "target"
            and "target" not in to.columns
            and not to.targets
            and len(filled) == len(cells[name])
        ):
            to.columns["target"] = name
            to.take(name, "target")
        elif kind == "set" and set(filled) <= _SETS:
            to.columns["set"] = name
            to.take(name, "set")
        elif kind == "status":
            _status(to, name)
        elif kind in ("series", "waypoint", "visit") and kind not in to.columns:
            to.columns[kind] = name
            to.take(name, kind)
        elif kind == "id" and len(filled) == len(cells[name]):
            unique = len(set(filled)) == len(filled)
            key = "id" if unique and "id" not in to.columns else "pose"
            if key not in to.columns:
                to.columns[key] = name
                to.take(name, "name of the reading" if key == "id" else "name of the pose")


def _time(to: Assigned, name: str, meaning: Meaning, filled: Sequence[str]) -> None:
    if all(seconds_of(cell) is not None for cell in filled) and len(filled) == len(to.layout.rows):
        to.columns["time"] = f"{name}[date]"
        to.take(name, "time", "date", "its cells are dates with a time of day")
    elif np.isfinite(to.values([name])).all() and meaning.unit in ("s", "ms", "us", "min"):
        to.columns["time"] = f"{name}[{meaning.unit}]"
        to.take(name, "time", meaning.unit)
    elif np.isfinite(to.values([name])).all() and (
        of := dict(zip(to.layout.names, to.layout.units, strict=False)).get(name)
    ):
        to.columns["time"] = f"{name}[{of}]"
        to.take(name, "time", of, "the row of units")
    else:
        to.aside(name, 'a time without unit or date; a map may name it: time = "...[s]"')


def _status(to: Assigned, name: str) -> None:
    words = dict.fromkeys(cell for cell in to.layout.cells[name])
    good = [word for word in words if word.lower() in _GOOD]
    unknown = [word for word in words if word.lower() not in _GOOD | _BAD]
    if unknown and not (unknown == [""] and not good):
        shown = ", ".join(f"'{word}'" for word in list(words)[:8])
        answer = to.ask(Question(f"{to.prefix}status", f"Column '{name}' holds {shown}. Which of these mean that a reading counts (with "
                                 "commas between; 'all' to leave the column aside)?", ()))  # fmt: skip
        if answer == "all":
            to.aside(name, "as answered")
            return
        good = [word.strip() for word in answer.split(",")]
        if answer == UNDECIDED:
            to.columns["status"] = UNDECIDED
            return
    elif unknown:  # empty where nothing was wrong
        good = [""]
    to.columns["status"] = name
    to.status_ok = tuple(word for word in good if word)
    to.take(name, "status", "", f"counts where it is {' or '.join(map(repr, good))}")

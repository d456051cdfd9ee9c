"""Every driver x its simulator x every fault of the proxy.

Never a wrong reading, never an answer to another question, always an end within the deadline with an error of
the right class, and working again after a reconnect. Of the three answers of a question that may be spoiled each pair
of driver and fault takes one, another one than its neighbours; `--whole` (`make long`) takes all.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from drivers import CTrack, FaroTracker, LeicaTracker, LinkError, Qc20w
from mocks.faultproxy import FAULTS
from service.conformance import DriverRig
from service.conformance.faults import CLASSES, LOUD, MANY, booting, clock_steps, many_questions, one_fault
from tests.conformance.rigs import REQUESTS_ONLY, RIGS
from tests.drivers.waiting import until

# No checksum, and a point cannot be measured twice the same; a beam that is sent elsewhere finds what is there.
UNDETECTABLE = {("leica-emscon", fault) for fault in ("flip", "request_flip", "request_digit")}
BRIDGED = {"faro-mbp1", "leica-mbp1", "ctrack-mbp1", "qc20w-mbp1", "qc20w-serial"}
# What they answer carries the clock of the device.
CLOCKED = BRIDGED | {"ur-rtde", "ur-realtime", "ur-primary", "ur-x-rtde"}
# A stream may lack a package, and half of two is one; on 30003 and 30001 it goes on behind the answer, unread.
QUIET = {(rig, "half") for rig in ("ur-rtde", "ur-x-rtde", "abb-simple-state")}
# Robot Web Services are asked again on a new connection, since a controller may close an old one.
QUIET |= {(rig, fault) for rig in ("ur-realtime", "ur-primary", "abb-rws") for fault in LOUD}


NAMES = sorted(set(RIGS) - REQUESTS_ONLY)
PLACES = 3  # behind so many answers, 0 to 2, the spoiled one comes


@pytest.fixture(scope="module", params=NAMES)
def named_rig(request: pytest.FixtureRequest) -> Iterator[tuple[str, DriverRig]]:
    with ExitStack() as stack:
        yield request.param, RIGS[request.param](stack)


def test_every_fault_has_its_classes() -> None:
    assert set(CLASSES) == set(FAULTS)


def places(name: str, fault: str, *, whole: bool) -> list[int]:
    """Behind how many answers a rig meets a fault."""
    every = list(range(PLACES))
    return every if whole else [every[(NAMES.index(name) + sorted(map(str, FAULTS)).index(fault)) % PLACES]]


def test_every_driver_meets_every_fault_and_each_of_them_every_place() -> None:
    met = {(name, fault): places(name, fault, whole=False) for name in NAMES for fault in FAULTS}
    for name in NAMES:
        assert {place for fault in FAULTS for place in met[name, fault]} == set(range(PLACES))
    for fault in FAULTS:
        assert {place for name in NAMES for place in met[name, fault]} == set(range(PLACES))


@pytest.mark.parametrize("fault", sorted(FAULTS))
def test_one_fault(named_rig: tuple[str, DriverRig], fault: str, pytestconfig: pytest.Config) -> None:
    name, rig = named_rig
    if (name, fault) in UNDETECTABLE:
        return
    for after in places(name, fault, whole=bool(pytestconfig.getoption("whole"))):
        one_fault(rig, fault, after, quiet=(name, fault) in QUIET)


def test_no_wrong_reading_in_many_questions(named_rig: tuple[str, DriverRig]) -> None:
    """No answer is wrong under all faults together, at twice the usual rate.

    `make conformance` asks 400 questions for every fault.
    """
    name, rig = named_rig
    faults = [f for f in sorted(FAULTS) if (name, f) not in UNDETECTABLE and f not in ("delay", "drip")]
    many_questions(rig, faults, questions=MANY // 2, rate=0.06)


def test_booting_device(named_rig: tuple[str, DriverRig]) -> None:
    booting(named_rig[1])


def ask_often(rig: DriverRig, first: int) -> None:
    for i in range(first, first + 5):
        assert rig.ask(i) <= rig.tolerance


def test_working_at_once_after_a_reboot(named_rig: tuple[str, DriverRig]) -> None:
    """A rebooted device works at once, without a deadline; the best of three tries counts.

    Deadlines of a patient driver are longer.
    """
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


def test_a_clock_that_steps_costs_one_reading(named_rig: tuple[str, DriverRig]) -> None:
    """A client that does not reconnect is not refused for ever either."""
    name, rig = named_rig
    if name in CLOCKED:
        clock_steps(rig)


def test_the_stream_of_somebody_else_is_no_answer(named_rig: tuple[str, DriverRig]) -> None:
    name, rig = named_rig
    if name not in BRIDGED:
        return
    rig.proxy.heal()
    rig.be_patient()
    rig.do("stream", rate=1000.0, model="T1", base="B1", target="T1")
    try:
        for i in range(10):
            if i % 5 == 0:
                rig.restart()  # the stream runs before the greeting as well
            assert rig.ask(i) <= rig.tolerance
        assert isinstance(rig.driver, FaroTracker | LeicaTracker | CTrack | Qc20w)
        assert rig.driver.session.client.samples > 10
    finally:
        rig.do("stream", rate=0.0)

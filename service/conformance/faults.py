"""A rig under faults: no wrong answer, the right error in time, and recovery afterwards.

Faults of answers are those of `mocks.faultproxy.FAULTS`, faults of requests those of `REQUEST_FAULTS`. A
function raises `RequirementFailed` if its promise does not hold.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

from drivers import (
    AcquisitionError,
    CommandRefused,
    LinkError,
    LinkLost,
    LinkTimeout,
    NoisyMeasurement,
    ProtocolError,
    Unmeasurable,
)
from service.conformance.common import SLACK_S, DriverRig, RequirementFailed, hold, refused

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
MANY = 120


def right(rig: DriverRig, question: int) -> None:
    """Put one question and check the answer.

    Raises
    ------
    RequirementFailed
        The answer is wrong.
    AcquisitionError
        There is no answer.
    """
    miss = rig.ask(question)
    hold(miss <= rig.tolerance, f"question {question} was answered wrongly, by {miss:.4g}")


def well(rig: DriverRig, question: int) -> None:
    """Check the rig without a fault: connect, arm, and put one question."""
    rig.proxy.heal()
    rig.be_patient()
    rig.restart()
    right(rig, question)


def one_fault(rig: DriverRig, fault: str, after: int, *, quiet: bool = False) -> None:
    """Check one spoiled message, the one behind `after` others.

    With `quiet`, this fault need not be noticed on this wire. Errors must name device and command, and recommend an
    action.
    """
    well(rig, after)
    if LinkTimeout in CLASSES[fault]:  # these cost a deadline; the others must do without one
        rig.hurry()
    hit = rig.proxy.spoiled
    rig.proxy.spoil(fault, times=1, after=after)
    begin = time.monotonic()
    failure: AcquisitionError | None = None
    for i in range(3):  # the second question meets what the first left behind
        try:
            right(rig, 10 + i)
        except CLASSES[fault] as error:
            failure = error
            break
        except AcquisitionError as error:
            allowed = " or ".join(kind.__name__ for kind in CLASSES[fault]) or "no error"
            raise RequirementFailed(
                f"{type(error).__name__} ({error.message}), {allowed} is right"
            ) from error
    took_s = time.monotonic() - begin
    hold(rig.proxy.spoiled == hit + 1, f"three questions took fewer than {after + 1} answers")
    hold(took_s < 3 * rig.longest_s + SLACK_S, f"ended after {took_s:.1f} s")
    hold(failure is not None or fault not in LOUD or quiet, "was not noticed")
    if failure is not None:
        explained(failure, rig)
    well(rig, 50)


def explained(error: AcquisitionError, rig: DriverRig) -> None:
    """Check that an error names its device, its command and a remedy."""
    name = type(error).__name__
    hold(error.device.startswith(rig.driver.name), f"{name} names the device '{error.device}'")
    hold(bool(error.command), f"{name} does not say during what")
    hold(bool(error.what_to_do), f"{name} does not say what to do")


def many_questions(
    rig: DriverRig, faults: Sequence[str], *, questions: int = MANY, rate: float = 0.03
) -> tuple[int, int]:
    """Put questions while messages are spoiled by any of the faults.

    Returns the numbers of answers and of failures.
    """
    rig.proxy.heal()
    rig.be_patient()
    rig.restart()
    rig.hurry()
    rig.proxy.spoil(*faults, times=None, rate=rate)
    good = bad = 0
    for i in range(questions):
        try:
            right(rig, i)
            good += 1
        except (LinkError, Unmeasurable):
            bad += 1
            rig.proxy.heal()
            rig.be_patient()
            rig.restart()
            rig.hurry()
            rig.proxy.spoil(*faults, times=None, rate=rate)
    hold(good > questions // 6, f"only {good} of {questions} questions were answered")
    hold(bad > 2, f"only {bad} of {questions} questions met a fault")
    return good, bad


def booting(rig: DriverRig) -> None:
    """Check that a device that accepts and closes is lost, and works at once when it is up."""
    rig.be_patient()
    rig.proxy.refuse()
    refused(LinkLost, "connecting to a device that boots", rig.driver.connect)
    begin = time.monotonic()
    well(rig, 1)
    took_s = time.monotonic() - begin
    hold(took_s < SLACK_S, f"works {took_s:.1f} s later")


def clock_steps(rig: DriverRig) -> None:
    """Check that a step of the clock costs one reading, and not every one behind it."""
    well(rig, 0)
    for i, by_s in enumerate((-3600.0, 3600.0, 7200.0, -7200.0, -1e6), start=1):
        rig.do("clock_step", by_s=by_s)
        try:
            right(rig, i)
        except NoisyMeasurement:
            hold(by_s < 0.0, f"refused a reading after a step forth, by {by_s:g} s")
            right(rig, i)


def damaged_requests(rig: DriverRig, fault: str, *, rate: float, questions: int = 20) -> int:
    """Put questions while requests are spoiled on their way, and count the failures.

    Nothing wrong may be read, and the next question without a fault must be answered.
    """
    spoiled, failures = rig.proxy.spoiled, 0
    spoiling = False
    for i in range(questions):
        if not spoiling:
            rig.start_again()
            rig.hurry(requests=True)
            rig.proxy.spoil(fault, times=None, rate=rate)
            spoiling = True
        try:
            right(rig, i)
        except AcquisitionError as error:
            failures += 1
            hold(error.device.startswith(rig.driver.name), f"{type(error).__name__} names '{error.device}'")
            hold(bool(error.what_to_do), f"{type(error).__name__} does not say what to do")
            spoiling = False
    hold(rig.proxy.spoiled > spoiled, "no request was spoiled")
    rig.start_again()
    right(rig, questions)
    return failures

"""Every rig under every fault: right answers, loud failures, wrong answers, slowest time.

For damaged requests, unrequested moves of the robot are counted as well. A flipped bit (`flip`) cannot be detected
if a protocol has no checksum and the answer is read once: such a cell is bracketed, and not counted.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import product
from multiprocessing import get_context

from drivers import AcquisitionError, LinkTimeout
from mocks.faultproxy import FAULTS, REQUEST_FAULTS
from service.conformance import SLACK_S, DriverRig
from service.conformance.faults import CLASSES
from tests.conformance.rigs import MOVE_AT_ONCE, REQUESTS_ONLY, RIGS
from tests.conformance.test_faults import UNDETECTABLE

COLUMNS = 5
ALL_FAULTS = (*FAULTS, *REQUEST_FAULTS)
# A late package holds up all that come behind it.
STREAMS = ("abb-simple-state", "ur-realtime", "ur-rtde", "ur-primary", "ur-x-rtde")


@dataclass(frozen=True)
class Cell:
    """Result of one rig under one fault.

    `allowed_s` is the time that the deadlines of the driver allow for one question.
    """

    rig: str
    fault: str
    right: int
    loud: int
    wrong: int
    spoiled: int
    longest_s: float
    allowed_s: float
    elsewhere: int = 0

    @property
    def counts(self) -> bool:
        return (self.rig, self.fault) not in UNDETECTABLE

    @property
    def good(self) -> bool:
        planned = not self.elsewhere or self.rig in MOVE_AT_ONCE
        return not self.counts or (self.wrong == 0 and planned and self.longest_s <= self.allowed_s)

    def __str__(self) -> str:
        text = f"{self.right} / {self.loud} / {self.wrong} · {self.longest_s:.2f} s"
        if self.elsewhere:
            text += f" · {self.elsewhere} elsewhere"
        return text if self.counts else f"({text})"


def _hasty(name: str, fault: str) -> bool:
    """Return whether deadlines are short.

    They are if the fault costs one deadline per question, or if the run would take hours.
    """
    return (
        fault in REQUEST_FAULTS
        or LinkTimeout in CLASSES[fault]
        or (name in STREAMS and fault in ("delay", "drip"))
    )


def _restart(rig: DriverRig, name: str, fault: str, rate: float) -> None:
    """Work again, then spoil again."""
    rig.start_again()
    if _hasty(name, fault):
        rig.hurry(requests=fault in REQUEST_FAULTS)
    rig.proxy.spoil(fault, times=None, rate=rate)


def _right(rig: DriverRig, question: int) -> bool:
    """Return whether the answer is true and belongs to this question.

    Raises
    ------
    AcquisitionError
        The question fails loudly.
    """
    try:
        return rig.ask(question) <= rig.tolerance
    except AssertionError:  # a rig asserts that the answer names its question
        return False


def cell(name: str, fault: str, questions: int, rate: float) -> Cell:
    """Put the questions to one rig under one fault."""
    right = loud = wrong = 0
    longest_s = 0.0
    with ExitStack() as stack:
        logging.disable(logging.WARNING)  # every driver warns that it is unverified on hardware
        stack.callback(logging.disable, logging.NOTSET)
        rig = RIGS[name](stack)
        _restart(rig, name, fault, rate)
        for i in range(questions):
            begin = time.monotonic()
            try:
                good = _right(rig, i)
            except AcquisitionError:
                loud += 1
                longest_s = max(longest_s, time.monotonic() - begin)
                _restart(rig, name, fault, rate)
                continue
            longest_s = max(longest_s, time.monotonic() - begin)
            right += good
            wrong += not good
        allowed_s = rig.longest_s + SLACK_S if _hasty(name, fault) else math.inf
        return Cell(
            name, fault, right, loud, wrong, rig.proxy.spoiled, longest_s, allowed_s, len(rig.elsewhere())
        )


def cells(names: Sequence[str], questions: int, rate: float, jobs: int) -> Iterator[Cell]:
    """Yield the results of all rigs and faults as they end; every rig has a separate process."""
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        asked = [
            pool.submit(cell, name, fault, questions, rate)
            for name, fault in product(names, ALL_FAULTS)
            if fault in REQUEST_FAULTS or name not in REQUESTS_ONLY
        ]
        for done in as_completed(asked):
            yield done.result()


def tables(found: Sequence[Cell]) -> Iterator[str]:
    """Lines of Markdown tables, some rigs each."""
    names = sorted({each.rig for each in found}, key=list(RIGS).index)
    at = {(each.rig, each.fault): str(each) for each in found}
    for first in range(0, len(names), COLUMNS):
        some = names[first : first + COLUMNS]
        yield "| " + " | ".join(["fault", *some]) + " |"
        yield "|---" * (len(some) + 1) + "|"
        for fault in (each for each in ALL_FAULTS if any((name, each) in at for name in some)):
            yield "| " + " | ".join([fault, *(at.get((name, fault), "") for name in some)]) + " |"
        yield ""

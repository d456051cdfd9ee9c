"""`python -m tests.benchmarks strangers [SEEDS]`: verdicts on unknown laws and arms.

Laws: each acts at three times the noise, on one of the arms that it fits. The verdict must never be `attributed` or
`complete` while the fit is worse than noise allows. It must be `unexplained` if the readings can show the law
(lambda > 200) and distinguish it from any single name (gap > 60). The first place must be right. Small sets of 50
and 100 readings only have to be honest.

Complete: sets without an unmodelled effect, in every design in which readings are alike. An alarm is any verdict
but `complete`.

Power: effects of the library, written independently. Their size is the one that the report says is seen in 95 of
100 sets. Every set of a law, every alarm and every planted effect that was missed is printed with its seed.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor

from calib.diagnose import diagnose
from calib.diagnose.found import POWER
from tests.benchmarks.clock import at_least, at_most, line
from tests.benchmarks.strangers.arms import arms
from tests.benchmarks.strangers.judge import VALIDATION, Asked, Told, examine
from tests.benchmarks.strangers.planted import planted
from tests.benchmarks.strangers.scene import LAWS
from tests.benchmarks.strangers.sets import Plan, made

FIRST_SEED = 300_000
LARGE, SMALL = (200, 1000), (50, 100)
FLAGGED, PLACED, ALARMS = 0.95, 0.80, 0.01
COMPLETE = (30, 50, 200, 1000)
DESIGNS = {
    "one reading a pose": (1, 1, 1.0),
    "5 visits a pose": (5, 1, 1.0),
    "repeatability 5 x the noise": (1, 1, 5.0),
    "3 targets a visit": (1, 3, 1.0),
    "5 visits, 3 targets, 5 x the noise": (5, 3, 5.0),
}
"""Visits of a pose, targets in each, and the repeatability over the usual, which is about the instrument's noise."""


def laws_at(readings: Sequence[int], seeds: int, first: int) -> list[Told]:
    """All laws at some numbers of readings; with every seed another arm."""
    asked = [
        Asked(name, i + number, n, first + i)
        for i in range(seeds)
        for n in readings
        for number, name in enumerate(LAWS)
    ]
    found: list[Told] = []
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for told in pool.map(examine, asked):
            print(f"  {told}", flush=True)
            found.append(told)
    return found


def sure(kind: str, found: Sequence[Told]) -> bool:
    """Require that no verdict contradicts a poor fit.

    Also print how many of the sets that count fit to the noise all the same.
    """
    counted = [told for told in found if told.counts]
    print(f"  {len(found)} sets, {len(counted)} count: {dict(Counter(told.verdict for told in counted))}")
    fitted = sum(told.verdict in ("attributed", "complete", "ambiguous") for told in counted)
    line(f"{kind}: told as explained, and fitting to the noise", str(fitted), "", True)
    name = f"{kind}: attributed or complete, p < 1e-3"
    return at_most(name, sum(told.too_sure for told in found), len(found), 0.0)


def laws(seeds: int, first: int = FIRST_SEED) -> bool:
    """Every law on 200 and on 1000 readings."""
    found = laws_at(LARGE, seeds, first)
    reached = sure("strangers", found)
    for n in LARGE:
        counted = [told for told in found if told.counts and told.asked.readings == n]
        flagged = [told for told in counted if told.verdict == "unexplained"]
        reached &= at_least(f"strangers, {n}: flagged unexplained", len(flagged), len(counted), FLAGGED)
        placed = sum(told.placed for told in flagged)
        reached &= at_least(f"strangers, {n}: the place named right", placed, len(flagged), PLACED)
    return reached


def small(seeds: int, first: int = FIRST_SEED) -> bool:
    """Every law on 50 and on 100 readings."""
    found = laws_at(SMALL, seeds, first)
    for n in SMALL:
        counted = [told for told in found if told.counts and told.asked.readings == n]
        warned = [told for told in counted if told.verdict in ("unexplained", "excess_noise")]
        flagged = [told for told in counted if told.verdict == "unexplained"]
        line(f"strangers, {n}: flagged unexplained, of {len(counted)}", str(len(flagged)), "", True)
        line(f"strangers, {n}: or excess noise, of {len(counted)}", str(len(warned)), "", True)
    return sure("strangers, small sets", found)


def alarm(asked: tuple[str, int, int, int]) -> str | None:
    """Diagnose one set without an unmodelled effect; return its report if it is an alarm."""
    design, number, n, seed = asked
    each, at_once, scatter = DESIGNS[design]
    arm = arms()[number % len(arms())]
    plan = Plan(n, VALIDATION, each, at_once, scatter)
    result = diagnose(made(arm, None, 0.0, plan, seed).data)
    if result.verdict == "complete":
        return None
    effects = " + ".join(f"{f.effect.label} (p {f.evidence.p_value:.1g})" for f in result.effects)
    places = "; ".join(f"{s.where} on {s.acts_on} (p {s.p_value:.1g})" for s in result.structure[:3])
    told = f"{result.verdict}, p {result.p_lack_of_fit:.1g}; {effects}; {places}"
    return f"{design}, {arm.name} n {n} seed {seed}: {told}"


def complete(seeds: int, first: int = FIRST_SEED) -> bool:
    """Sets that lack nothing, in every design and size."""
    total, found = 0, 0
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for number, design in enumerate(DESIGNS):
            asked = [
                (design, number + i + j, n, first + i) for i in range(seeds) for j, n in enumerate(COMPLETE)
            ]
            told = [text for text in pool.map(alarm, asked) if text is not None]
            for text in told:
                print(f"  {text}", flush=True)
            line(f"strangers, complete, {design}: alarms, of {len(asked)}", str(len(told)), "", True)
            total, found = total + len(asked), found + len(told)
    return at_most("strangers, complete, all designs: alarms", found, total, ALARMS)


def power(seeds: int, first: int = FIRST_SEED) -> bool:
    """Effects planted at the size that the readings would have shown, on every arm."""
    asked = [(number, first + i) for i in range(seeds) for number in range(len(arms()))]
    tried, seen = Counter[str](), Counter[str]()
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for found in pool.map(planted, asked):
            for each in found:
                tried[each.kind] += 1
                seen[each.kind] += each.seen
                if not each.seen:
                    print(f"  {each}", flush=True)
    for kind in tried:
        line(f"strangers, power: {kind} seen, of {tried[kind]}", str(seen[kind]), "", True)
    total, share = tried.total(), seen.total() / max(tried.total(), 1)
    error = math.sqrt(POWER * (1.0 - POWER) / max(total, 1))
    reached = abs(share - POWER) <= 2.0 * error
    name = f"strangers, power: seen at the size promised, of {total}"
    line(name, f"{share:.1%}", f"{POWER:.0%} +- {2.0 * error:.1%}", reached)
    return reached


PARTS: dict[str, Callable[[int, int], bool]] = {
    "laws": laws,
    "small": small,
    "complete": complete,
    "power": power,
}


def run(seeds: int = 1) -> bool:
    """Run all parts over `seeds` seeds.

    Each seed has 56 sets of laws, 56 small ones, 20 complete and 30 planted ones.
    """
    reached = [part(seeds, FIRST_SEED) for part in PARTS.values()]
    return all(reached)

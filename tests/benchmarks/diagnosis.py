"""Benchmark of the diagnosis over new seeds: names, false names, and held-out errors.

Sets are drawn by `diagnosis_sets`. `diagnosis_truth` computes their detectability before any diagnosis, and
`diagnosis_judge` judges the result. An effect counts if the data can show and distinguish it (lambda > 60 and gap >
30). Every miss is printed with its seed.
"""

from __future__ import annotations

import argparse
import functools
import itertools
import os
import resource
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from calib.diagnose.diagnosis import diagnose
from tests.benchmarks.clock import at_least, at_most, line
from tests.benchmarks.diagnosis_complete import alarms
from tests.benchmarks.diagnosis_follow_up import Followed, before_and_after
from tests.benchmarks.diagnosis_foreign import foreign
from tests.benchmarks.diagnosis_judge import APART, SHOWN, Case, examine, same
from tests.benchmarks.diagnosis_sets import Draw, complete, crowded, departing, lean, load, outside, several

IN_CLASS, UNIQUE, WRONG = 0.97, 0.95, 0.005
CLAIMS = 0.01
MECHANISM = 0.93
FLAGGED, FALSE_CERTAINTY, STRUCTURE = 0.98, 0.01, 200.0
SURROGATE = 0.05
CALIBRATED = 0.1
NEAR_IDEAL, IDEAL_SHARE, WORSE = 1.1, 0.95, 0.01
KINDS = (
    "single", "pair", "triple", "lean", "complete", "noisy", "departure", "beside", "outside", "missing", "narrow"
)  # fmt: skip
SEEDS = {kind: 10_000 * i for i, kind in enumerate(KINDS, start=1)}
RESOLVED = 0.95
GROWTH, MEMORY_GB = 15.0, 2.0
BINS = (0.0, 0.5, 0.7, 0.95, 1.0 + 1e-9)


def study(make: Callable[[int], Draw], first: int, count: int, missing: bool = False) -> list[Case]:
    """The first `count` sets from seed `first` on that can show something, on all cores."""
    cases: list[Case] = []
    judge = functools.partial(examine, missing=missing)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        while len(cases) < count:
            more = 2 + (count - len(cases)) * 5 // 4  # few cannot show anything
            found = pool.map(judge, [make(first + i) for i in range(more)])
            cases += [case for case in found if case is not None]
            first += more
    return cases[:count]


def tell(cases: Iterable[Case]) -> None:
    """Print what went wrong, so that it can be run again."""
    for case in cases:
        print(f"  {case}")


def named(kind: str, cases: Sequence[Case]) -> bool:
    """Judge the names of detectable effects.

    They must be in the class and unique, and no certain name may be wrong.
    """
    pairs = [(case, s.label) for case in cases for s in case.shown]
    within = sum(case.in_class(label) for case, label in pairs)
    unique = sum(case.unique(label) for case, label in pairs)
    clear = [case for case in cases if len(case.shown) == len(case.truth.effects)]
    wrong = sum(bool(case.wrong) for case in clear)
    tell(c for c in cases if c.wrong or not all(c.unique(s.label) and c.in_class(s.label) for s in c.shown))
    print(f"  {len(cases)} sets, verdicts {dict(Counter(c.verdict for c in cases))}")
    reached = at_least(f"{kind}: in the reported class", within, len(pairs), IN_CLASS)
    reached &= at_least(f"{kind}: unique", unique, len(pairs), UNIQUE)
    beside = sum(bool(case.wrong) for case in cases) - wrong
    name = f"{kind}: wrong name beside what cannot be shown, of {len(cases) - len(clear)}"
    line(name, str(beside), "", True)
    return at_most(f"{kind}: wrong name told as certain", wrong, len(clear), WRONG) and reached


def known(count: int) -> bool:
    """Judge effects of the library alone, in pairs and in triples.

    All of them also judge weights and held-out errors.
    """
    reached, cases = True, []
    for many, kind in enumerate(("single", "pair", "triple"), start=1):
        found = study(functools.partial(several, kind, many), SEEDS[kind], count)
        reached &= named(kind, found)
        cases += found
    found = study(lean, SEEDS["lean"], max(count // 4, 4))
    reached &= named("lean base model", found)
    cases += found
    reached &= calibrated(cases)
    return held_out(cases) and reached


def calibrated(cases: Sequence[Case]) -> bool:
    """Compare weights with the share of right names, by bins of the top weight.

    A bin misses when it is off by more than the tolerance and by more than two standard errors of its share.
    """
    tops = []
    for case in cases:
        hidden = [s.label for s in case.truth.effects]
        for candidates in case.classes:
            top, weight = next(iter(candidates.items()))
            tops.append((weight, any(same(top, label) for label in hidden)))
    reached = True
    for low, high in itertools.pairwise(BINS):
        weights, right = np.array([(w, r) for w, r in tops if low <= w < high]).reshape(-1, 2).T
        if not len(weights):
            continue
        off = float(np.mean(weights) - np.mean(right))
        spread = np.sqrt(np.sum(weights * (1.0 - weights))) / len(weights)
        name = f"weights {low:.2f} to {high:.2f}: mean less share right, of {len(weights)}"
        good = abs(off) <= max(CALIBRATED, 2.0 * float(spread))
        line(name, f"{off:+.3f}", f"<= {CALIBRATED}", good)
        reached &= good
    return reached


def held_out(cases: Sequence[Case]) -> bool:
    """Held-out error against the ideal fit's, and against the base model's."""
    near = [case.after <= NEAR_IDEAL * case.truth.ideal for case in cases]
    worse = [bool(case.classes) and case.after > case.before for case in cases]
    print("  held-out error over 1.1 of ideal, or worse than before:")
    tell(case for case, close, bad in zip(cases, near, worse, strict=True) if bad or not close)
    reached = at_least(f"held-out error within {NEAR_IDEAL} of the ideal", sum(near), len(near), IDEAL_SHARE)
    return at_most("held-out error made worse", sum(worse), len(worse), WORSE) and reached


def nothing_missing(count: int) -> bool:
    """Sets that lack nothing, and such with noise declared a quarter too large or too small."""
    cases = study(complete, SEEDS["complete"], 3 * count)
    tell(c for c in cases if c.classes or c.verdict != "complete")
    claims = sum(bool(c.classes) for c in cases)
    reached = at_most("nothing missing: sets with a claim", claims, len(cases), CLAIMS)
    other = sum(c.verdict != "complete" for c in cases)
    line("nothing missing: other verdicts than complete", str(other), "", True)
    for declared, true in ((1.25, "0.8"), (0.8, "1.25")):
        cases = study(functools.partial(complete, declared=declared), SEEDS["noisy"], count)
        tell(c for c in cases if c.classes)
        claims = sum(bool(c.classes) for c in cases)
        reached &= at_most(f"noise {true} of the declared: sets with a claim", claims, len(cases), 0.0)
    return reached


def departures(count: int) -> bool:
    """Judge laws that depart from the textbook, alone and together with two other effects."""
    reached = True
    for beside, kind in ((0, "departure"), (2, "beside")):
        cases = study(functools.partial(departing, beside=beside), SEEDS[kind], count)
        first = [(c, c.truth.effects[0]) for c in cases]
        counted = [(c, s) for c, s in first if s.size > SHOWN and s.gap > APART]
        right = [c.right_mechanism(s.label) for c, s in counted]
        tell(c for (c, _), good in zip(counted, right, strict=True) if c.wrong_mechanism or not good)
        print(f"  verdicts {dict(Counter(c.verdict for c in cases))}")
        name = f"departures, {beside} effects beside" if beside else "departures"
        reached &= at_least(f"{name}: right mechanism in the class", sum(right), len(right), MECHANISM)
        wrong = sum(c.verdict == "attributed" and bool(c.wrong_mechanism) for c in cases)
        line(f"{name}: attributed to a wrong mechanism", str(wrong), "", True)
    return reached


def unknown(count: int) -> bool:
    """Structure that no law describes, and effects whose law was taken out of the library."""
    cases = [c for c in study(outside, SEEDS["outside"], count) if c.truth.effects[0].size > STRUCTURE]
    flagged = [c.verdict == "unexplained" for c in cases]
    tell(c for c, good in zip(cases, flagged, strict=True) if not good)
    reached = at_least("outside the library: flagged unexplained", sum(flagged), len(cases), FLAGGED)
    sure = sum(c.verdict in ("attributed", "complete") for c in cases)
    reached &= at_most("outside the library: told as explained", sure, len(cases), FALSE_CERTAINTY)
    cases = study(functools.partial(several, "missing", 1), SEEDS["missing"], count, missing=True)
    cases = [c for c in cases if c.shown]
    wrong = [c.verdict == "attributed" and bool(c.wrong_mechanism) for c in cases]
    tell(c for c, bad in zip(cases, wrong, strict=True) if bad)
    print(f"  verdicts {dict(Counter(c.verdict for c in cases))}")
    beside = sum(c.verdict != "attributed" and bool(c.wrong_mechanism) for c in cases)
    line("law taken out: another mechanism named beside a warning", str(beside), "", True)
    return (
        at_most("law taken out: attributed to a wrong mechanism", sum(wrong), len(cases), SURROGATE)
        and reached
    )


def asked_for(count: int) -> bool:
    """Judge ambiguous narrow starts before and after the follow-up poses of the diagnosis.

    There are half as many as of other sets: about six starts are diagnosed for every ambiguous one.
    """
    count = max(1, count // 2)
    found: list[Followed] = []
    first = SEEDS["narrow"]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        while len(found) < count:
            more = 4 + 4 * (count - len(found))  # most starts are not ambiguous
            found += [f for f in pool.map(before_and_after, range(first, first + more)) if f is not None]
            first += more
    found = found[:count]
    can = [f for f in found if f.apart > APART]
    for f in found:
        if not settled(f):
            tell((f.before, f.after))
            print(f"    gap over whole ranges {f.apart:.0f}; {' '.join(f.procedures)}")
    name = "ambiguous narrow starts that no pose can settle: settled"
    line(f"{name}, of {len(found) - len(can)}", str(sum(settled(f) for f in found if f not in can)), "", True)
    reached = at_least(
        "ambiguous narrow starts: settled by 12 poses", sum(settled(f) for f in can), len(can), RESOLVED
    )
    return calibrated([f.before for f in found]) and reached


def settled(f: Followed) -> bool:
    """Return whether the second diagnosis names the effect, as the only one and as certain."""
    return f.after.verdict == "attributed" and f.after.unique(f.after.truth.effects[0].label)


def seconds_of(readings: int, labels: Sequence[str]) -> float:
    """Return the time of a diagnosis of `readings` readings, s."""
    result = diagnose(load(crowded(readings, labels)))
    print(
        f"  {readings} readings: {len(result.effects)} effects found, {result.verdict}, {result.seconds:.1f} s"
    )
    return result.seconds


def times(_: int) -> bool:
    """Seconds of a diagnosis of one effect, by readings."""
    reached = True
    for readings in (50, 200, 1000):
        taken = seconds_of(readings, ["periodic:j2:n3"])
        wanted = 1.0 if readings == 200 else float("inf")
        line(
            f"seconds of a diagnosis, {readings} readings",
            f"{taken:.2f} s",
            f"<= {wanted:g} s",
            taken <= wanted,
        )
        reached &= taken <= wanted
    return reached


def growth(_: int) -> bool:
    """Compare time and memory of 12,000 readings with those of 1,000; takes minutes.

    Both have the same 40 effects.
    """
    labels = [f"periodic:j{k}:n{order}" for k in range(1, 7) for order in (3, 7, 16, 31, 47, 101)]
    labels += ["backlash:j4", "drift_translation", "thermal_growth", "encoder_scale:j6"]
    few, many = seconds_of(1_000, labels), seconds_of(12_000, labels)
    line(
        "12,000 readings with 40 effects over 1,000",
        f"{many / few:.1f}",
        f"<= {GROWTH}",
        many <= GROWTH * few,
    )
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    line("peak memory, GB", f"{peak:.2f}", f"<= {MEMORY_GB:g}", peak <= MEMORY_GB)
    return many <= GROWTH * few and peak <= MEMORY_GB


PARTS = {
    "known": known,
    "complete": nothing_missing,
    "departures": departures,
    "unknown": unknown,
    "foreign": foreign,
    "alarms": alarms,
    "follow-up": asked_for,
    "times": times,
}


def run(count: int = 100) -> bool:
    """Print the table with `count` sets of every kind.

    A seed of foreign laws is 40 sets, one of designs 20.
    """
    seeds = {"foreign": max(1, count // 20), "alarms": max(1, count // 10)}
    reached = [part(seeds.get(name, count)) for name, part in PARTS.items()]
    return all(reached)


def main() -> int:
    """Run one part of the table, or the growth of time and memory, which takes minutes."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.diagnosis")
    parser.add_argument("part", choices=(*PARTS, "growth"))
    parser.add_argument("count", nargs="?", type=int, default=100)
    options = parser.parse_args()
    return 0 if (PARTS | {"growth": growth})[options.part](options.count) else 1


if __name__ == "__main__":
    sys.exit(main())

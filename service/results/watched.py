"""Verdict on a watched robot, for the command line (`truepose-watch/1`).

The module also describes the plan of a watch as text: the causes that it detects, and remedies for the others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib import watch
from calib.data import Dataset
from calib.errors import DataError
from calib.fit import silent
from calib.saved import CalibratedModel, save_update
from calib.units import percent
from calib.watch import (
    REPEATS,
    SEEN,
    TIMES,
    WANTED,
    SmallestDetected,
    WatchPlan,
    WatchPlanProposal,
    WatchVerdict,
    WhitenedReadings,
)
from service import exit_codes
from service.results.upkept import on_its_clock
from service.results.watch_answers import WatchResult

FORMAT = "truepose-watch/1"

CODES = {
    "unchanged": exit_codes.DONE,
    "changed": exit_codes.NOT_MET,
    "ambiguous": exit_codes.UNKNOWN_CAUSE,
    "unexplained": exit_codes.UNKNOWN_CAUSE,
}
"""Exit code of every verdict."""

_NAMES = {
    "joint_step": "a lost zero of joint {}",
    "backlash": "play of joint {}",
    "tool_shift": "a bumped tool",
    "base_shift": "a moved base",
}

_HIDDEN = (
    "More readings do not reduce the uncertainty of the baseline, the error that it left on its validation readings, "
    "or the uncertainty of the frame, which is set up anew on its nests. What helps: more poses, nests farther apart, "
    "or a calibration with more poses."
)


@dataclass(frozen=True)
class WatchRequest:
    """Request to judge the readings of a watch.

    Attributes
    ----------
    history, update
        Files of the earlier watches and of the updated model; None if not used.
    rate
        False-alarm rate.
    frame_known
        Whether robot and instrument are in the same place as for the baseline.
    missing_allowed
        Whether check poses may be missing.
    running_s
        Time from the cold start of the robot to the first reading, s; None if it is not known.
    """

    history: Path | None = None
    update: Path | None = None
    rate: float = watch.RATE
    frame_known: bool = True
    missing_allowed: bool = False
    running_s: float | None = None


def watch_result(
    dataset: Dataset,
    saved: CalibratedModel,
    model: Path,
    asked: WatchRequest,
    say: Callable[[str], None] = silent,
) -> WatchResult:
    """Judge, append to the history, write the updated model where a cause is known. Raises DataError, OSError."""
    watch.refuse_copies(dataset)
    notes = saved.notes + watch.refuse_unlike(
        saved, dataset, model, frame_known=asked.frame_known, missing_allowed=asked.missing_allowed
    )
    dataset = on_its_clock(saved, dataset, model, asked.running_s)
    history = None if asked.history is None else watch.read_history(asked.history)
    say("judging")
    seen = WhitenedReadings.of(saved, dataset, frame_known=asked.frame_known)
    baseline = watch.baseline_hash(saved)
    before: Sequence[Any] = ()
    if history is not None:
        before, left_out = history.before(seen, dataset, baseline)
        if left_out:
            notes += (
                f"{asked.history}: {left_out} earlier watches are of another model or other poses and were not "
                "averaged.",
            )
    verdict = watch.judge(seen, before, asked.rate)
    if watch.missing(dataset):
        shown = left_to_see(watch.seen_from(seen, verdict.questions[0].p_limit))
        notes += (shown,) if shown else ()
    if asked.history is not None and history is not None and not history.holds(dataset):
        watch.append(asked.history, seen, dataset, baseline, verdict)
    updated = False
    if asked.update is not None and verdict.kind != "unchanged":
        notes, updated = _update(saved, seen, dataset, model, asked.update, verdict, notes)
    said = {
        "format": FORMAT,
        "verdict": verdict.kind,
        "exit_code": CODES[verdict.kind],
        "in_words": verdict.in_words,
        "advice": verdict.advice,
        "questions": verdict.questions,
        "causes": [
            {
                "label": cause.label,
                "weight": weight,
                "size": cause.size,
                "parameters": watch.in_display(cause.effect, cause.values, cause.covariance),
                "in_words": cause.changed,
            }
            for cause, weight in verdict.causes
        ],
        "p_left": verdict.left,
        "error_mm": watch.missed(seen, dataset),
        "notes": notes,
    }
    return WatchResult.of(dataset, model, verdict, asked.update if updated else None, said)


def _update(
    saved: CalibratedModel,
    seen: WhitenedReadings,
    dataset: Dataset,
    model: Path,
    out: Path,
    verdict: WatchVerdict,
    notes: tuple[str, ...],
) -> tuple[tuple[str, ...], bool]:
    """Write the updated model, or add the reason why there is none to the notes.

    The verdict is valid without it. The result is the notes, and whether the model was written.
    """
    try:
        cause = watch.cause_to_update(verdict)
        if verdict.questions[0].watches == 1 and not verdict.questions[0].alarm:
            raise DataError(
                "only the mean over watches shows the change, and not how large it is now.",
                do="Measure again.",
                file="--update",
            )
    except DataError as error:
        return (*notes, str(error)), False
    goal, estimate, covariance = watch.updated(saved, seen, cause)
    kept = replace(saved, model=goal, estimate=estimate, covariance=covariance)
    times = watch.times_as_uncertain(saved, kept, dataset.header, _targets(dataset))
    if times > watch.DOUBTFUL:
        notes += (
            f"{out.name} is {times:.1f} times as uncertain as a recalibration would make it: too few readings for this "
            "cause. Measure again by a plan with more --visits and --readings, or recalibrate.",
        )
    occasion = dataset.header.occasion
    save_update(
        out,
        model,
        goal,
        estimate,
        covariance,
        {
            "by": "truepose watch",
            "measured": None if occasion is None else occasion.began,
            "data": dataset.name,
            "data_sha256": dataset.sha256,
            "cause": cause.label,
            "class": [each.label for each, _ in verdict.causes],
            "changed": watch.in_display(cause.effect, cause.values, cause.covariance),
        },
    )
    return notes, True


def _targets(dataset: Dataset) -> tuple[str, ...]:
    """Return the names of the targets that were read."""
    conditions = dataset.conditions
    return tuple(
        conditions.target_names[t] for t in sorted(set(conditions.target[dataset.fit_rows].tolist()))
    )


def in_words(
    plan: WatchPlan, proposals: Sequence[WatchPlanProposal], targets: Sequence[str], poses: int
) -> str:
    """Describe which causes a plan detects at their target sizes, and remedies for the others.

    Parameters
    ----------
    targets : sequence of str
        Names of the targets that are read.
    poses : int
        Requested number of check poses.
    """
    stated = [each for each in plan.shown.causes if each.wanted is not None]
    short = sorted((c for c in stated if (c.share or 0.0) < SEEN), key=lambda c: c.share or 0.0)
    if not short:
        return (
            f"Every cause with a wanted size is detected at that size in {percent(SEEN)} of watches or more."
            if stated
            else ""
        )
    beyond = [each for each in short if each.label in plan.beyond]
    others = [each for each in short if each.label not in plan.beyond]
    said = []
    if others:
        ways = _ways(plan, proposals, targets, poses)
        mended = f" To detect them: {'; or '.join(ways)}." if ways else ""
        said.append(f"Detected too rarely: {', '.join(map(_named, others))}.{mended}")
    if beyond:
        said.append(
            f"Even {TIMES[-1]} visits with {REPEATS[-1]} readings each would detect too rarely at these poses: "
            f"{', '.join(map(_named, beyond))}.{_elsewhere(plan, proposals)} {_HIDDEN}"
        )
    return " ".join(said)


def left_to_see(sizes: Mapping[str, float]) -> str:
    """Name the causes that a watch without some of its poses cannot detect at their target size.

    Parameters
    ----------
    sizes : mapping
        Smallest size that the remaining readings detect, mm or deg, by cause.

    Returns
    -------
    str
        One sentence; empty if all causes are still detected.
    """
    said = []
    for label, size in sizes.items():
        name, _, joint = label.partition(":j")
        if size > WANTED[name]:
            unit = "mm" if name.endswith("shift") else "deg"
            said.append(
                f"{_NAMES[name].format(joint)} {f'from {size:.2g} {unit}' if np.isfinite(size) else 'never'}"
            )
    return f"What is left shows, in {percent(SEEN)} of watches: {', '.join(said)}." if said else ""


def _named(cause: SmallestDetected) -> str:
    name, _, joint = cause.label.partition(":j")
    seen = percent(cause.share or 0.0)
    return f"{_NAMES[name].format(joint)} of {cause.wanted:g} {cause.unit} (in {seen} of watches)"


def _ways(
    plan: WatchPlan, proposals: Sequence[WatchPlanProposal], targets: Sequence[str], poses: int
) -> list[str]:
    """List remedies: more readings, other targets, more poses, a target farther from the axis."""
    least = len(plan.beyond)
    ways = []
    for same in (True, False):
        good = [p for p in proposals if (p.targets == targets) == same and len(p.beyond) <= least]
        if good:
            others = "" if same else f"--targets {','.join(good[0].targets)} "
            ways.append(f"{others}--visits {good[0].rounds} --readings {good[0].repeats}")
    if plan.enough is not None:
        ways.append(f"{plan.enough} poses instead of {poses}")
    if plan.lever is not None:
        label, lever = plan.lever
        now = next(c.lever_mm for c in plan.shown.causes if c.label == label)
        joint = label.partition(":j")[2]
        ways.append(
            f"with as many readings as here a target {lever:.0f} mm from the axis of joint {joint} instead of {now:.0f}"
        )
    return ways


def _elsewhere(plan: WatchPlan, proposals: Sequence[WatchPlanProposal]) -> str:
    """Name other targets that detect more of the causes; empty if there are none."""
    first = next(iter(proposals), None)
    if first is None or len(first.beyond) >= len(plan.beyond):
        return ""
    targets = f"--targets {','.join(first.targets)} --visits {first.rounds} --readings {first.repeats}"
    hidden = ", ".join(label for label, _ in first.beyond)
    return f" {targets} detects all{f' but {hidden}' if hidden else ''}."

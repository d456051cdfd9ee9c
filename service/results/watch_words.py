"""The plan of a watch in words: what it detects, or what would detect the rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calib.units import percent
from calib.watch import REPEATS, SEEN, TIMES, WANTED, Plan, Proposal, Smallest

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


def in_words(plan: Plan, proposals: Sequence[Proposal], targets: Sequence[str], poses: int) -> str:
    """The plan in words: which causes its check poses detect at their wanted sizes, and what would detect the rest.

    targets: names of those that are read; poses: number of check poses that was asked for.
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
    """The sentence that says which causes a watch without some of its poses can no longer detect at the wanted size.

    sizes: by cause, the smallest size that the remaining readings detect, mm or deg; empty text where none is missed.
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


def _named(cause: Smallest) -> str:
    name, _, joint = cause.label.partition(":j")
    seen = percent(cause.share or 0.0)
    return f"{_NAMES[name].format(joint)} of {cause.wanted:g} {cause.unit} (in {seen} of watches)"


def _ways(plan: Plan, proposals: Sequence[Proposal], targets: Sequence[str], poses: int) -> list[str]:
    """The remedies: more readings at these poses, other targets, more poses, a target farther off the axis."""
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


def _elsewhere(plan: Plan, proposals: Sequence[Proposal]) -> str:
    """Other targets that detect more of the causes."""
    first = next(iter(proposals), None)
    if first is None or len(first.beyond) >= len(plan.beyond):
        return ""
    targets = f"--targets {','.join(first.targets)} --visits {first.rounds} --readings {first.repeats}"
    hidden = ", ".join(label for label, _ in first.beyond)
    return f" {targets} detects all{f' but {hidden}' if hidden else ''}."

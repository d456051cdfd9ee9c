"""The question of a plan of a watch: how many check poses, of what kind, and how they are approached."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PlanQuestion:
    """The question: what to plan. targets: names, None for all of the cell; offset_deg: from how far every joint
    arrives; both: from sides drawn for every joint, else from below; rate: of false alarms; rounds: how often each pose
    is visited; touch: balls that are touched, empty where an instrument measures; touch_mm: how well a touch repeats;
    frame_known: whether instrument or artefact will stand where they stood; repeats: how often each target is read in a
    visit. rounds, repeats None: as few as show every cause, where an instrument measures points."""

    poses: int
    candidates: int
    targets: tuple[str, ...] | None
    offset_deg: float
    both: bool
    rate: float
    seed: int
    rounds: int | None = 1
    touch: tuple[str, ...] = ()
    touch_mm: float = 0.02
    frame_known: bool = True
    repeats: int | None = 1

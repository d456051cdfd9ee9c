"""Judge one set with an unknown law: its detectability, and the program's report."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.diagnose import diagnose
from calib.effects import Survey, offers
from calib.fit.identify import identify
from calib.scan.scores import Space
from tests.benchmarks.diagnosis_truth import Shown, shown_beside
from tests.benchmarks.strangers import laws_of_arms, laws_of_cells
from tests.benchmarks.strangers.arms import arms
from tests.benchmarks.strangers.scene import LAWS
from tests.benchmarks.strangers.sets import Made, Plan, made

SIZE = 3.0
STRUCTURE, APART = 200.0, 60.0
NOISY = 1e-3
VALIDATION = 45
KNOWN = (laws_of_arms, laws_of_cells)  # importing them enters their laws


@dataclass(frozen=True)
class Asked:
    """Law to examine, with the number of an arm among those that it fits, readings, and a seed."""

    law: str
    number: int
    readings: int
    seed: int


@dataclass(frozen=True)
class Told:
    """Report of the program on a set."""

    asked: Asked
    arm: str
    shown: Shown
    verdict: str
    chance: float
    places: tuple[tuple[str, str], ...]
    effects: tuple[str, ...]
    seconds: float

    @property
    def counts(self) -> bool:
        """Whether the readings can show the law and distinguish it from any single name."""
        return self.shown.size > STRUCTURE and self.shown.gap > APART

    @property
    def too_sure(self) -> bool:
        """Whether the verdict claims a complete explanation of a fit that is worse than the noise."""
        return self.verdict in ("attributed", "complete") and self.chance < NOISY

    @property
    def placed(self) -> bool:
        """Whether the first place of the report is one where the law lives."""
        return bool(self.places) and self.places[0][0].startswith(LAWS[self.asked.law].places)

    def __str__(self) -> str:
        where = "; ".join(f"{driver} on {acts}" for driver, acts in self.places[:3])
        mark = "" if not self.counts else "ok" if self.verdict == "unexplained" and self.placed else "<--"
        return (
            f"{self.asked.law} {self.arm} n {self.asked.readings} seed {self.asked.seed} "
            f"(lambda {self.shown.size:.0f}, gap {self.shown.gap:.0f} to {self.shown.rival}): "
            f"{self.verdict}, p {self.chance:.1g}; "
            f"{where or 'no place'}; {' + '.join(self.effects) or 'no effect'}; {self.seconds:.1f} s "
            f"{'TOO SURE' if self.too_sure else mark}"
        )


def examine(asked: Asked) -> Told:
    """Simulate one set, work out what it can show, and diagnose it."""
    law = LAWS[asked.law]
    able = [arm for arm in arms() if law.fits(arm)]
    arm = able[asked.number % len(able)]
    drawn = made(arm, law.act, SIZE, Plan(asked.readings, VALIDATION), asked.seed)
    result = diagnose(drawn.data)
    return Told(
        asked,
        arm.name,
        shown_of(drawn),
        result.verdict,
        result.p_lack_of_fit,
        tuple((s.where, s.acts_on) for s in result.structure),
        tuple(f.effect.label for f in result.effects),
        result.seconds,
    )


def shown_of(drawn: Made) -> Shown:
    """Compute lambda and gap of a law from its own displacement of the readings."""
    data, displaced = drawn
    base = identify(replace(data, points=data.points - displaced))
    readings = base.readings
    whitened = np.einsum("abn,nb->an", readings.observed.whiten, displaced[readings.rows])
    return shown_beside(Space.of(base), offers(Survey.of(base, data)), "a law", whitened.ravel(), [])

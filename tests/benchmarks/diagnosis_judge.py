"""Diagnose one data set and judge its names and its fit against the truth."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from unittest import mock

from calib import DiagnosisFit
from calib.diagnose import diagnose, select
from calib.diagnose import diagnosis as end_to_end
from calib.effects import Survey, offers
from calib.scan import Family
from tests.benchmarks.diagnosis_sets import Draw, load
from tests.benchmarks.diagnosis_truth import Shown, Truth, truth_of

SHOWN, APART = 60.0, 30.0
"""lambda and gap from which the data can show an effect, and tell it from any other."""
CERTAIN = 0.95

MECHANISMS: dict[str, str] = {
    "periodic": "angle of gear",
    "encoder_scale": "angle of gear",
    "joint_offset": "angle of gear",
    "joint_step": "angle of gear",
    "coupling": "angle of gear",
    "joint_compliance": "load on gear",
    "dead_zone": "load on gear",
    "cubic_stiffness": "load on gear",
    "backlash": "arrival of gear",
    "backlash_load": "arrival of gear",
    "settling": "arrival of gear",
    "lost_motion": "arrival of gear",
    "parallel_twist": "structure",
    "link_torsion": "structure",
    "bearing_tilt": "structure",
    "pedestal": "structure",
    "payload_mass": "payload",
    "payload_cog": "payload",
    "tool_offset": "tool",
    "tool_tilt": "tool",
    "target_offset": "tool",
    "tool_shift": "tool",
    "base_shift": "place of robot and instrument",
    "base_target_shift": "place of robot and instrument",
    "drift_translation": "place of robot and instrument",
    "drift_rotation": "place of robot and instrument",
    "tracker_scale": "scale",
    "thermal_growth": "warmth",
    "thermal_joint": "warmth",
    "warm_up": "warmth",
}
"""Mechanism by name of the label, for gears of the joint too. Near-exact surrogates of one another, by projection of
noise-free displacements, stand together: whoever is sent to look at one finds the other. Written before any run."""


def mechanism(label: str) -> str:
    """Return the part that a technician would inspect: 'angle of gear 4', 'tool'."""
    name, _, rest = label.partition(":")
    group = MECHANISMS.get(name, name)
    joint = rest.partition(":")[0].rpartition("j")[2]
    return f"{group} {joint}" if group.endswith("gear") else group


def same(label: str, truth: str) -> bool:
    """Return whether two labels name one effect.

    Harmonic orders that are not whole numbers may differ by a tenth.
    """
    if label == truth:
        return True
    one, other = label.rpartition(":n"), truth.rpartition(":n")
    if not truth.startswith("periodic") or one[0] != other[0]:
        return False
    order = float(other[2])
    return not order.is_integer() and abs(float(one[2]) - order) <= 0.1


@dataclass(frozen=True)
class Case:
    """Hidden truth of a data set, and the result of its diagnosis.

    `classes` maps, for every effect found, label to weight, heaviest first. `before` and `after` are RMS errors on
    validation rows, mm, of the base model and of the final model.
    """

    draw: Draw
    truth: Truth
    verdict: str
    classes: tuple[dict[str, float], ...]
    before: float
    after: float
    seconds: float
    withdrawn: tuple[str, ...] = ()  # names whose condition is right and whose law is not

    @property
    def shown(self) -> list[Shown]:
        """The effects that the data can show and tell apart."""
        return [s for s in self.truth.effects if s.size > SHOWN and s.gap > APART]

    def in_class(self, label: str) -> bool:
        """Return whether some class contains the label."""
        return any(same(c, label) for candidates in self.classes for c in candidates)

    def unique(self, label: str) -> bool:
        """Return whether the label is the certain name of some class."""
        return any(same(top, label) for top, _ in self.certain)

    def right_mechanism(self, label: str) -> bool:
        """Return whether some class or withdrawn name has the mechanism of the label.

        A name is withdrawn when carried terms explain more than it does.
        """
        told = [*self.withdrawn, *(c for candidates in self.classes for c in candidates)]
        return any(mechanism(c) == mechanism(label) for c in told)

    @property
    def certain(self) -> list[tuple[str, dict[str, float]]]:
        """Names reported as certain, each with its class."""
        tops = [(next(iter(candidates)), candidates) for candidates in self.classes]
        return [(top, candidates) for top, candidates in tops if candidates[top] >= CERTAIN]

    @property
    def wrong(self) -> list[str]:
        """Names reported as certain that are wrong, from classes without any hidden effect."""
        hidden = [s.label for s in self.truth.effects]
        return [
            top for top, candidates in self.certain if not any(same(c, h) for c in candidates for h in hidden)
        ]

    @property
    def wrong_mechanism(self) -> list[str]:
        """Names reported as certain whose mechanism is none of the hidden ones."""
        hidden = {mechanism(s.label) for s in self.truth.effects}
        return [top for top, _ in self.certain if mechanism(top) not in hidden]

    def __str__(self) -> str:
        hidden = ", ".join(
            f"{s.label} (lambda {s.size:.0f}, gap {s.gap:.0f} to {s.rival})" for s in self.truth.effects
        )
        told = " + ".join(
            " | ".join(f"{label} {weight:.2f}" for label, weight in candidates.items())
            for candidates in self.classes
        )
        d = self.draw
        return (
            f"{d.kind}, seed {d.seed}: {d.robot} n {d.n} size {d.size:.2f} {d.departure or ''} {d.approach}: "
            f"{hidden or 'nothing'}; {self.verdict}: {told or 'nothing'}; "
            f"error {self.before:.4f} -> {self.after:.4f}, ideal {self.truth.ideal:.4f}"
        )


def case_of(draw: Draw, truth: Truth, result: DiagnosisFit) -> Case:
    """Combine the result of a diagnosis with the hidden truth."""
    before, after = result.error_before, result.error_after
    return Case(
        draw,
        truth,
        result.verdict,
        tuple(dict(f.evidence.candidates) for f in result.effects),
        float("nan") if before is None else before.rms,
        float("nan") if after is None else after.rms,
        result.seconds,
        result.withdrawn,
    )


def examine(draw: Draw, missing: bool = False) -> Case | None:
    """Simulate and diagnose one set; return None if the data cannot show any hidden effect.

    If `missing`, the families of the hidden effects are removed from the library.
    """
    try:
        campaign = draw.campaign()
    except ValueError:
        return None  # the effect moves nothing, such as a dead zone of a joint that gravity never loads
    data = load(campaign)
    truth = truth_of(campaign, data)
    if truth.effects and not any(s.size > SHOWN for s in truth.effects):
        return None
    if missing:
        with without(*(s.label for s in truth.effects)):
            result = diagnose(data)
    else:
        result = diagnose(data)
    return case_of(draw, truth, result)


@contextmanager
def without(*labels: str) -> Iterator[None]:
    """Remove the families of these labels from the library.

    For a periodic error, all orders of its joint are removed.
    """

    def fewer(survey: Survey) -> list[Family]:
        return [
            offer
            for offer in offers(survey)
            if not any(label == offer.label or label.startswith(offer.label + ":") for label in labels)
        ]

    with mock.patch.object(select, "offers", fewer), mock.patch.object(end_to_end, "offers", fewer):
        yield

"""Benchmark of false alarms in complete sets, in every design in which readings are alike.

An alarm is any verdict but `complete`. In the first design, poses are visited once with one target each. The others
have five visits per pose, repeatability of five times the instrument's noise, or three targets read in every visit,
which share its repeatability. The last design combines all of these. Every alarm is printed with its seed.
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from calib.data.dataset import Dataset
from calib.diagnose.diagnosis import diagnose
from mocks.campaign import DEFAULT_FIT, Campaign
from mocks.world import Session, World, noise_rms, stream
from mocks.world.dataset import header_of, row_of
from mocks.world.world import POSE_STREAM, REPEATABILITY_DEG
from tests.benchmarks.clock import at_most
from tests.benchmarks.diagnosis_sets import load, visits

READINGS = (30, 50, 200, 1000)
ALARMS = 0.01
FIRST_SEED = 130_000
VALIDATION = 15
NOISIER = 5.0  # repeatability over the instrument's noise


@dataclass(frozen=True)
class Design:
    """Design of the visits: visits per pose, targets per visit, and the repeatability."""

    each: int = 1
    at_once: int = 1
    noisy: bool = False


DESIGNS = {
    "one reading a pose": Design(),
    "5 visits a pose": Design(each=5),
    "repeatability 5 x the noise": Design(noisy=True),
    "3 targets a visit": Design(at_once=3),
    "5 visits, 3 targets, 5 x the noise": Design(5, 3, True),
}


def campaign(name: str, n: int, seed: int) -> Campaign:
    """A campaign of a design in which nothing is hidden."""
    design = DESIGNS[name]
    total = n + 2 * VALIDATION

    def world_with(repeatability: float) -> World:
        return World("abb-irb120", seed, session=Session(total), repeatability_deg=repeatability)

    def plan(world: World):
        return visits(
            world,
            n,
            VALIDATION,
            design.each,
            design.at_once,
            ("varied", "direct")[seed % 2],
            stream(seed, POSE_STREAM),
        )

    world = world_with(REPEATABILITY_DEG)
    sets, readings = plan(world)
    if design.noisy:
        still = noise_rms(world_with(0.0), readings[:30])
        arm = np.sqrt(noise_rms(world, readings[:30]) ** 2 - still**2)
        world = world_with(REPEATABILITY_DEG * NOISIER * still / float(arm))
    rows = [row_of(world, i, s, reading) for i, (s, reading) in enumerate(zip(sets, readings, strict=True))]
    return Campaign(rows, header_of(world, 1.0, list(DEFAULT_FIT)), {}, world, readings)


def examine(drawn: tuple[str, int, int]) -> str | None:
    """Diagnose one complete set; return its report if it is an alarm."""
    name, n, seed = drawn
    data: Dataset = load(campaign(name, n, seed))
    result = diagnose(data)
    if result.verdict == "complete":
        return None
    effects = " + ".join(f"{f.effect.label} (p {f.evidence.p_value:.1g})" for f in result.effects)
    places = "; ".join(f"{s.where} on {s.acts_on} (p {s.p_value:.1g})" for s in result.structure[:3])
    return f"{name}, n {n}, seed {seed}: {result.verdict}, p {result.p_lack_of_fit:.1g}; {effects}; {places}"


def alarms(count: int) -> bool:
    """Every design at every size, over `count` seeds."""
    reached, total, found = True, 0, 0
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for name in DESIGNS:
            drawn = [(name, n, FIRST_SEED + i) for i in range(count) for n in READINGS]
            told = [text for text in pool.map(examine, drawn) if text is not None]
            for text in told:
                print(f"  {text}", flush=True)
            reached &= at_most(f"alarms, {name}", len(told), len(drawn), ALARMS)
            total, found = total + len(drawn), found + len(told)
    return at_most("alarms, all designs", found, total, ALARMS) and reached

"""A simulated measurement campaign: random poses as a data set, with the hidden truth.

`python -m mocks.campaign --seed 7 --effect backlash:j4 --out DIR` writes DIR/data.csv, DIR/data.toml and
DIR/truth.json and prints one JSON line with their paths. Without --effect one undeclared effect is drawn from
the seed (`mocks.world.demo_labels` lists the candidates).

Design of the campaign (thesis section 2.5, and requirements of a diagnosis):

- Random poses in random order, with three targets off each other.
- Approach sides drawn independently per joint.
- An air temperature that does not follow the clock.
- Validation rows interleaved in time.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from mocks.world import (
    DEPARTURES,
    ROBOTS,
    ArmState,
    Session,
    TrackerNoise,
    World,
    noise_rms,
    random_label,
    scaled,
    stream,
)
from mocks.world.dataset import csv_text, header_of, row_of, write_atomically
from mocks.world.poses import (
    APPROACH_DEG,
    LONG_APPROACH_DEG,
    approach_point,
    random_pose,
    random_sides,
)
from mocks.world.scaling import Reading
from mocks.world.world import LABEL_STREAM, POSE_STREAM, REPEATABILITY_DEG, STATION_MM, Point

DEFAULT_FIT = ["base", "geometry", "parallel_twist", "compliance"]
GROSS_ERROR_MM = 2.0
APPROACHES = ("offset", "varied", "direct")


@dataclass
class Campaign:
    """A data set and its hidden truth.

    Attributes
    ----------
    rows : list of dict
        Rows by the contract's column names, in order of time.
    header : dict
        The contract's TOML.
    truth : dict
        Plain data; see `hidden_truth`.
    world : World
        The cell that was measured.
    readings : list of Reading
        States and targets behind the rows.
    """

    rows: list[dict[str, Any]]
    header: dict[str, Any]
    truth: dict[str, Any]
    world: World
    readings: list[Reading]


def make_campaign(
    robot: str = "abb-irb120",
    seed: int = 1,
    n: int = 200,
    n_validation: int = 100,
    effects: Sequence[str] | None = None,
    size: float = 3.0,
    both_sides: bool = True,
    *,
    departure: str | None = None,
    approach: str = "offset",
    reference_every: int = 0,
    seconds_per_reading: float = 20.0,
    gross_rows: int = 0,
    swapped_rows: int = 0,
    targets: Mapping[str, Sequence[float]] | None = None,
    tool_mass_kg: float | None = None,
    tool_cog_mm: Point | None = None,
    noise: TrackerNoise | None = None,
    repeatability_deg: float = REPEATABILITY_DEG,
    noise_declared_factor: float = 1.0,
    station_mm: Sequence[float] = STATION_MM,
    fit: Sequence[str] | None = None,
) -> Campaign:
    """Measure a campaign of calibration and validation rows, all drawn from `seed`.

    Parameters
    ----------
    n, n_validation : int
        Number of calibration and of validation rows.
    effects : sequence of str, optional
        Labels. An empty list hides nothing; None draws one label from the seed.
    size : float
        Each effect is scaled so that the displacement it causes over all rows is `size` times the noise, both RMS
        per axis.
    both_sides : bool
        Draw approach sides at random per joint; otherwise they are +1 everywhere.
    departure : str, optional
        Replaces the textbook law of those labels that it applies to.
    approach : {"offset", "varied", "direct"}
        "offset" comes from q - side x 5 deg. "varied" comes from 5 to 15 deg, drawn for each pose. "direct" comes
        straight from the previous row's pose; the side is then the sign of the move.
    reference_every : int
        Number of rows between two reference rows, which share one pose; 0 for no reference rows.
    gross_rows, swapped_rows : int
        Number of calibration rows with an error of 2 mm, and with a wrong target name.
    targets, tool_mass_kg, tool_cog_mm, noise, repeatability_deg, station_mm
        As for `World`: targets in mm in the flange frame, mass and centre of the tool.
    noise_declared_factor : float
        Ratio of declared noise to true noise.
    """
    if approach not in APPROACHES:
        raise ValueError(f"approach {approach!r} is not one of {APPROACHES}")
    if n < 1 or n_validation < 0:
        raise ValueError(f"n = {n} and n_validation = {n_validation}: at least one calibration row is needed")
    if gross_rows + swapped_rows > n:
        raise ValueError(f"{gross_rows} gross and {swapped_rows} swapped rows do not fit into {n} rows")
    rng = stream(seed, POSE_STREAM)
    sets = ["calibration"] * n + ["validation"] * n_validation
    sets = [sets[i] for i in rng.permutation(len(sets))]
    if reference_every > 0:
        for place in range(len(sets) - len(sets) % reference_every, -1, -reference_every):
            sets.insert(place, "reference")
    world = World(
        robot,
        seed,
        station_mm=station_mm,
        targets=targets,
        tool_mass_kg=tool_mass_kg,
        tool_cog_mm=tool_cog_mm,
        noise=noise,
        repeatability_deg=repeatability_deg,
        session=Session(len(sets), seconds_per_reading),
    )
    readings = plan(world, sets, both_sides, approach, rng)
    labels = effects
    if labels is None:
        labels = [random_label(world.robot, stream(seed, LABEL_STREAM), departure)]
    drawn = [world.draw_effect(label, departure_for(label, departure)) for label in labels]
    if departure is not None and all(effect.shape != departure for effect in drawn):
        raise ValueError(f"departure {departure!r} applies to none of {list(labels)}")
    world.effects = [scaled(world, effect, readings, size) for effect in drawn]

    rows = [row_of(world, i, s, reading) for i, (s, reading) in enumerate(zip(sets, readings, strict=True))]
    faulty, relabelled = spoil(rows, list(world.targets), gross_rows, swapped_rows, rng)
    header = header_of(world, noise_declared_factor, list(fit or DEFAULT_FIT))
    truth = hidden_truth(world, readings, size) | {"faulty_rows": faulty, "relabelled_rows": relabelled}
    return Campaign(rows, header, truth, world, readings)


def departure_for(label: str, departure: str | None) -> str | None:
    """Return `departure` if it replaces the law of `label`, or None.

    Raises
    ------
    ValueError
        The departure is unknown.
    """
    if departure is None:
        return None
    if departure not in DEPARTURES:
        raise ValueError(f"departure {departure!r} is not one of {sorted(DEPARTURES)}")
    return departure if label.split(":", maxsplit=1)[0] in DEPARTURES[departure][0] else None


def plan(
    world: World, sets: Sequence[str], both_sides: bool, approach: str, rng: np.random.Generator
) -> list[Reading]:
    """Plan the state and target of every row, in order of time."""
    names = list(world.targets)
    reference = random_pose(world.robot, world.targets, rng)
    readings: list[Reading] = []
    previous = random_pose(world.robot, world.targets, rng)
    for order, kind in enumerate(sets):
        joints = random_pose(world.robot, world.targets, rng)
        sides = random_sides(len(joints), rng) if both_sides else (1,) * len(joints)
        target = names[int(rng.integers(len(names)))]
        if kind == "reference":
            joints, sides, target = reference, (1,) * len(joints), names[0]
        length = APPROACH_DEG
        if approach == "varied":
            length = float(rng.uniform(APPROACH_DEG, LONG_APPROACH_DEG))
        start = approach_point(joints, sides, length)
        if approach == "direct":
            start = previous
            sides = tuple(1 if q >= p else -1 for q, p in zip(joints, start, strict=True))
        t_s = round((order + 1) * world.session.seconds, 3)
        t_air_c = round(world.air_c(t_s), 2)
        readings.append((ArmState(joints, start, sides, t_s, t_air_c, order), target))
        previous = joints
    return readings


def spoil(
    rows: list[dict[str, Any]],
    targets: list[str],
    gross_rows: int,
    swapped_rows: int,
    rng: np.random.Generator,
) -> tuple[list[int], list[list[Any]]]:
    """Spoil calibration rows in place.

    Returns the ids of the gross errors, and [id, written, true] for each swapped target name.
    """
    if gross_rows + swapped_rows == 0:
        return [], []
    if swapped_rows and len(targets) < 2:
        raise ValueError("a target's name can only be swapped where there are two")
    candidates = [i for i, row in enumerate(rows) if row["set"] == "calibration"]
    chosen = [candidates[i] for i in rng.permutation(len(candidates))[: gross_rows + swapped_rows]]
    faulty, relabelled = [], []
    for i in chosen[:gross_rows]:
        error = rng.normal(size=3)
        error *= GROSS_ERROR_MM / math.sqrt(float(error @ error))
        for name, part in zip(("x_mm", "y_mm", "z_mm"), error, strict=True):
            rows[i][name] = round(rows[i][name] + float(part), 6)
        faulty.append(rows[i]["reading_id"])
    for i in chosen[gross_rows:]:
        true = rows[i]["tool_target"]
        others = [name for name in targets if name != true]
        rows[i]["tool_target"] = others[int(rng.integers(len(others)))]
        relabelled.append([rows[i]["reading_id"], rows[i]["tool_target"], true])
    return sorted(faulty), sorted(relabelled)


def hidden_truth(world: World, readings: Sequence[Reading], size: float) -> dict[str, Any]:
    """Return the truth that the identifier may not see, as plain data.

    Hidden effects, the true robot (rad, mm, rad/(N.mm)), the noise per axis, and mean and largest error of
    the nominal robot over all rows.
    """
    g = world.geometry
    errors = [math.dist(world.nominal_point(*r), world.true_point(*r)) for r in readings]
    return {
        "format": "truepose-truth/1",
        "seed": world.seed,
        "size": size,
        "effects": world.truth,
        "noise_rms_mm": noise_rms(world, readings),
        "nominal_error_mm": {"mean": sum(errors) / len(errors), "max": max(errors)},
        "robot": {
            "name": world.robot.name,
            "alpha_rad": g.alpha,
            "a_mm": g.a,
            "theta_rad": g.theta,
            "d_mm": g.d,
            "beta_rad": g.beta,
            "base_mm": g.base_mm,
            "base_rad": g.base_rad,
            "compliance_rad_per_nmm": world.compliance,
        },
    }


def write_campaign(campaign: Campaign, folder: Path) -> dict[str, str]:
    """Write data.csv, data.toml and truth.json into `folder`.

    Returns their paths under the keys csv, toml and truth.
    """
    folder.mkdir(parents=True, exist_ok=True)
    texts = {
        "csv": ("data.csv", csv_text(campaign.rows)),
        "toml": ("data.toml", tomli_w.dumps(campaign.header)),
        "truth": ("truth.json", json.dumps(campaign.truth, indent=1) + "\n"),
    }
    for name, text in texts.values():
        write_atomically(folder / name, text)
    return {key: str(folder / name) for key, (name, _) in texts.items()}


def parser() -> argparse.ArgumentParser:
    """Create the argument parser of `python -m mocks.campaign`."""
    p = argparse.ArgumentParser(prog="python -m mocks.campaign", description="Simulate a campaign.")
    p.add_argument("--seed", type=int, required=True)
    p.add_argument("--robot", default="abb-irb120", choices=sorted(ROBOTS))
    p.add_argument("--readings", type=int, default=200, help="calibration rows")
    p.add_argument("--validation", type=int, default=100, help="validation rows")
    p.add_argument("--reference-every", type=int, default=0, help="number of rows between reference rows")
    p.add_argument("--effect", nargs="+", metavar="LABEL", help="labels, or none (default: one at random)")
    p.add_argument("--size", type=float, default=3.0, help="RMS of an effect over RMS of the noise")
    p.add_argument("--departure", choices=sorted(DEPARTURES), help="replaces the textbook law")
    p.add_argument("--one-side", action="store_true", help="approach every joint from below")
    p.add_argument("--approach", choices=APPROACHES, default="offset")
    p.add_argument("--noise-declared-factor", type=float, default=1.0, help="declared over true noise")
    p.add_argument("--gross-rows", type=int, default=0, help="rows with an error of 2 mm")
    p.add_argument("--swapped-rows", type=int, default=0, help="rows with a wrong target name")
    p.add_argument("--out", type=Path, required=True, metavar="DIR")
    return p


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code is 0, or 2 if it cannot be simulated."""
    options = parser().parse_args(arguments)
    labels = options.effect
    if labels == ["none"]:
        labels = []
    try:
        campaign = make_campaign(
            options.robot,
            options.seed,
            options.readings,
            options.validation,
            labels,
            options.size,
            not options.one_side,
            departure=options.departure,
            approach=options.approach,
            reference_every=options.reference_every,
            gross_rows=options.gross_rows,
            swapped_rows=options.swapped_rows,
            noise_declared_factor=options.noise_declared_factor,
        )
    except ValueError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    sys.stdout.write(json.dumps(write_campaign(campaign, options.out)) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

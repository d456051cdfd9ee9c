"""Benchmark of adaptive campaigns with a ballbar: when they end, whether that is right, and what they save.

As `adaptive`, with the LR Mate and the cups of the example. Every seed draws an arm, cups that stand some millimetres
from where the cell file has them, and balls of the tool. The robot touches the cups, and its stances are those of the
touched cups. A leg counts if it lies within the stroke of the bar. The true error over the zone is that of positions
relative to the cups, and the repeatability of the robot. The default campaign is that of the example: both triangles,
61 stances in two stages, 8 others and 40 points of a sphere to validate. An arm goes on to `FINEST_MM`, so that looks
and ends for all of the wanted accuracies are seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from acquisition.campaign.blocks.adaptive import pool_of, visits_of
from acquisition.campaign.blocks.sphere import SphereBlock
from acquisition.campaign.campaign import Campaign, campaign_from, read_campaign
from acquisition.campaign.plan import site_of, visit_of
from acquisition.cell.cell import MADE_MM, TAUGHT_MM, Cell, point, read_cell, with_nests
from acquisition.cell.reach import configurations
from acquisition.cell.workspace import targets_at
from acquisition.run.adaptive import MOUNTING_S, block_of, rest_s
from acquisition.run.ballbar.driven_stances import driven
from calib.arm import forward, nearest_branch, with_sides
from calib.arm.start import align
from calib.data import Dataset, header_of
from calib.diagnose import diagnose
from calib.fit import IdentificationFit, identify
from calib.model import StatedConditions
from calib.selection import zone_of
from mocks.world import ArmState, Session, World, demo_labels, stream
from mocks.world.world import LABEL_STREAM
from tests.benchmarks import nests
from tests.benchmarks.adaptive import WANTED_MM, Arm, judged_right
from tests.benchmarks.clock import line
from tests.benchmarks.nests import EXAMPLE, LEG_SIGMA_MM, sides_of

FINEST_MM, MOST = 0.024, 30
OFF_MM = 2.0
DEFAULT_STANCES, DEFAULT_OTHERS, DEFAULT_SPHERE = 61, 8, 40
BEFORE_S = 780.0  # triangles and cups, as a calibration expects
_SESSION = Session(readings=40, seconds=230.0)


def run(seeds: int = 10) -> bool:
    """Print the figures; whether all are reached."""
    arms = [BallbarArm(seed, effects) for seed in range(1, seeds + 1) for effects in ([], [_label(seed)])]
    paths, defaults = [arm.path() for arm in arms], [arm.default() for arm in arms]
    reached = judged_right("ballbar", paths)
    within = [arm.within_stroke for arm in arms]
    for stage, some in (
        ("first poses", [each[0] for each in within]),
        ("later ones", [each[1] for each in within]),
    ):
        line(
            f"ballbar: legs of the {stage} within the stroke, %, median (least)",
            f"{100 * np.median(some):.0f} ({100 * min(some):.0f})",
            "",
            True,
        )
    for wanted in WANTED_MM:
        ends = [next((seen for seen in path if seen.claims(wanted)), None) for path in paths]
        shares = [
            (BEFORE_S + end.at_s) / default_s
            for end, (_, default_s) in zip(ends, defaults, strict=True)
            if end is not None
        ]
        share = f"{np.median(shares):.2f} ({max(shares):.2f})" if shares else "never"
        good = bool(shares) and float(np.median(shares)) <= 0.33
        line(
            f"ballbar: share of the default's time for {wanted:.2f} mm, median (largest)",
            share,
            "<= 0.33",
            good,
        )
        reached &= good
    ends = [next((seen.true_mm for seen in path if seen.claims(WANTED_MM[-1])), np.nan) for path in paths]
    line(
        "ballbar: true error at the end for 0.05 mm, mm, median (largest)",
        f"{np.nanmedian(ends):.3f} ({np.nanmax(ends):.3f})",
        "",
        True,
    )
    own = [each for each, _ in defaults]
    line(
        "ballbar: that of the default campaign, mm, median (largest)",
        f"{np.median(own):.3f} ({max(own):.3f})",
        "",
        True,
    )
    return reached


def _label(seed: int) -> str:
    """Draw a hidden effect that a ballbar can show: none of a tracker."""
    world = World("fanuc-lrmate200ic", seed, [])
    choices = {
        name: labels for name, labels in demo_labels(world.robot).items() if not name.startswith("drift")
    }
    rng = stream(seed, LABEL_STREAM)
    labels = list(choices.values())[int(rng.integers(len(choices)))]
    return labels[int(rng.integers(len(labels)))]


class BallbarArm(Arm):
    """A simulated arm with a ballbar between cups that it has touched, and the stances of an adaptive block."""

    readings_each = 6

    def __init__(self, seed: int, effects: Sequence[str] = ()) -> None:
        cell = read_cell(EXAMPLE / "cell.toml")
        rng = np.random.default_rng([seed, 99])
        askew = {
            name: cell.tool.stated_mm.get(name, MADE_MM) * rng.normal(size=3) for name in cell.tool.targets
        }
        self.world = World(
            cell.robot.model.name,
            seed,
            effects,
            targets=cell.tool.targets,
            misplaced_mm=askew,
            tool_mass_kg=cell.tool.mass_kg,
            tool_cog_mm=cell.tool.cog_mm,
            session=_SESSION,
        )
        off = rng.normal(size=(len(cell.nests), 3))
        away = OFF_MM * off / np.linalg.norm(off, axis=1)[:, None]
        cups = {
            name: np.add(place, each) for (name, place), each in zip(cell.nests.items(), away, strict=True)
        }
        balls = {name: np.add(place, askew[name]) for name, place in cell.tool.targets.items()}
        self.truth = nests.Truth(self.world, cups, balls)
        self.cell = with_nests(cell, self._touched(cell))
        self.campaign: Campaign = campaign_from(
            {
                "format": "truepose-campaign/1",
                "seed": seed,
                "approach": {"offset_deg": -5.0, "sides": "both"},
                "block": [{"kind": "adaptive", "accuracy_mm": FINEST_MM, "most": MOST}],
            },
            "campaign.toml",
        )
        found = block_of(self.campaign)
        assert found is not None
        self.block = found[1]
        self.site = site_of(self.cell, self.campaign, 0)
        self.targets = self.site.targets
        self.pool = pool_of(self.block, self.site)
        self.reading_s = (rest_s(self.site, 0.0, self.campaign.samples)) / self.readings_each
        table = nests.header_of(
            self.cell,
            self.cell.nests,
            self.cell.tool.targets,
            base_targets_u_mm=dict.fromkeys(self.cell.nests, TAUGHT_MM),
            tool_targets_u_mm=dict(self.cell.tool.stated_mm),
        )
        self.header = header_of(table, Path("cell.toml"), tomli_w.dumps(table))
        self._rng = np.random.default_rng([seed, 98])
        self._ranks: list[int] = []  # of the first reading of each visit
        self._seen: dict[bool, list[bool]] = {False: [], True: []}

    @property
    def within_stroke(self) -> tuple[float, float]:
        """Share of the legs within the stroke, of stances driven as they are and through a model."""
        plain, through = (
            float(np.mean(self._seen[key])) if self._seen[key] else 1.0 for key in (False, True)
        )
        return plain, through

    def _touched(self, cell: Cell) -> dict[str, tuple[float, float, float]]:
        """Return where the nominal robot believes the touched cups to be, with the sides that the bar measures."""
        sphere = next(
            b for b in read_campaign(EXAMPLE / "campaign.toml").blocks if isinstance(b, SphereBlock)
        )
        taught = np.array([sphere.centre_deg])
        robot, first = cell.robot, next(iter(cell.nests))
        flange = np.repeat(forward(robot.model, robot.model_angles(taught)), len(cell.nests), axis=0)
        flange[:, :3, 3] += np.array(list(cell.nests.values())) - cell.nests[first]
        found = configurations(cell, flange, taught[0])
        joints = found[range(len(found)), nearest_branch(found, np.repeat(taught, len(found), axis=0))]
        nominal = targets_at(cell, joints)[:, 0]
        true = np.array(
            [self.world.true_point(state, next(iter(cell.tool.targets))) for state in self._states(joints)]
        )
        cups = np.array(list(self.truth.cups.values()))
        sides = [np.linalg.norm(cups[i] - cups[k]) for i, k in ((0, 1), (1, 2), (2, 0))]
        placed = with_sides(cups - (true - nominal), sides)
        return {name: point(place) for name, place in zip(cell.nests, placed, strict=True)}

    def _states(self, joints_deg: Any) -> list[ArmState]:
        angles = np.degrees(self.world_angles(joints_deg))
        return [ArmState(tuple(row), tuple(row), (1,) * len(row)) for row in angles.tolist()]

    def world_angles(self, joints_deg: Any) -> Any:
        """Return joints of the controller, deg, as the simulated arm counts them, rad."""
        return read_cell(EXAMPLE / "cell.toml").robot.model_angles(joints_deg)

    def _read(
        self, i: int, order: int, now_s: float, final: IdentificationFit | None
    ) -> list[dict[str, Any]]:
        visit = visit_of(self.block, self.site, self.pool.visit(self.site, i, order + 1))
        if final is not None:
            visit = driven(self.cell, final, [visit])[0]
        angles, before = np.degrees(self.world_angles([visit.joints_deg, visit.approach_deg]))
        rests = angles + np.degrees(self.world.arrival_error(order))
        sides = tuple(np.where(angles >= before, 1, -1).tolist())
        rows: list[dict[str, Any]] = []
        del self._ranks[order + 1 :]
        self._ranks = self._ranks or [0]
        for k, (target, base) in enumerate(visit.readings):
            at_s = now_s + self.reading_s * k
            air = round(self.world.air_c(at_s), 2)
            state = ArmState(tuple(rests.tolist()), tuple(before.tolist()), sides, round(at_s, 3), air, order)
            leg = float(
                np.linalg.norm(np.subtract(self.world.true_point(state, target), self.truth.cups[base or ""]))
            )
            leg += float(self._rng.normal(0.0, LEG_SIGMA_MM))
            within = abs(leg - self.cell.instrument.nominal_mm) <= (
                self.cell.instrument.declared.stroke_mm or 0.0
            )
            self._seen[final is not None].append(within)
            row: dict[str, Any] = {
                "reading_id": 10 * order + k,
                "set": "calibration",
                "t_s": at_s,
                "visit": order,
            }
            for n, (q, p, side) in enumerate(
                zip(visit.joints_deg, visit.approach_deg, visit.sides, strict=True), 1
            ):
                row |= {f"j{n}_deg": q, f"prev{n}_deg": p, f"approach{n}": side}
            row |= {"tool_target": target, "base_target": base, "other_target": "", "length_mm": leg}
            if within:
                rows.append(row | {"t_air_c": air, "status": "ok"})
        self._ranks.append(self._ranks[order] + len(rows))
        return rows

    def dataset(self, rows: list[dict[str, Any]]) -> Dataset:
        sides = [row | {"status": "ok"} for row in sides_of(self.truth, self.cell, rows[0])]
        return super().dataset([*sides, *rows])

    def default(self) -> tuple[float, float]:
        """Return the true error of the default campaign, mm, and its time, s."""
        seen = {key: list(each) for key, each in self._seen.items()}
        first = identify(self.dataset(self.readings(range(DEFAULT_STANCES))))
        out = sum(not each for each in self._seen[False][len(seen[False]) :])
        rows = self.readings(range(DEFAULT_STANCES), first)
        self._seen = seen
        stances = DEFAULT_STANCES + DEFAULT_OTHERS
        again = -(-out // 2)  # stances of the second stage, with two legs each
        each_s = rest_s(self.site, self.campaign.settle_s, self.campaign.samples)
        time_s = BEFORE_S + stances * each_s + out * MOUNTING_S + again * MOUNTING_S
        time_s += DEFAULT_SPHERE * (2 * MOUNTING_S + self.campaign.settle_s) + 6 * MOUNTING_S
        final = diagnose(self.dataset(rows)).final
        return self._true_mm(final, float(rows[-1]["t_s"]), DEFAULT_STANCES), time_s

    def _true_mm(self, final: IdentificationFit, until_s: float, poses: int) -> float:
        """RMS error of positions in the zone relative to the cups: of the model, and repeatability."""
        share = np.random.default_rng(self.world.seed).uniform(0.0, 1.0, len(self.pool.zone))
        times, many = share * until_s, len(self.targets)
        stated = StatedConditions(loads=self.header.loads, gravity=self.header.gravity)
        asked = visits_of(self.site, self.pool.zone, final.model, stated)
        air = [round(self.world.air_c(float(at)), 2) for at in times]
        visits = (share * poses).astype(int)
        asked = replace(
            asked,
            time=np.repeat(times, many),
            temperature=np.repeat(air, many),
            order=np.repeat(np.array(self._ranks)[visits], many),
        )
        joints = np.array([pose.joints_deg for pose in self.pool.zone])
        sides = np.array([pose.sides for pose in self.pool.zone])
        reach = np.array([pose.reach_deg for pose in self.pool.zone])
        angles = np.degrees(self.world_angles(joints))
        before = np.degrees(self.world_angles(joints - sides * reach[:, None]))
        moved = np.where(angles >= before, 1, -1)
        states = [
            ArmState(tuple(q), tuple(p), tuple(s), float(at), t, order)
            for q, p, s, at, t, order in zip(
                angles.tolist(), before.tolist(), moved.tolist(), times, air, visits.tolist(), strict=True
            )
        ]
        true = np.array([self.world.true_point(state, target) for state in states for target in self.targets])
        found, cups = np.array(list(final.model.anchors.values())), np.array(list(self.truth.cups.values()))
        for i, name in enumerate(final.model.anchors):
            for k, axis in enumerate("xyz"):
                if (key := f"{name}.{axis}") in final.model.index:
                    found[i, k] += final.estimate[final.model.index[key]]
        turn, shift = align(found, cups, np.ones(len(found)))
        floor_mm = zone_of(final.model, final.estimate, asked, self.header.noise).floor_mm
        error = np.sum((final.predict(asked) @ turn.T + shift - true) ** 2, axis=1)
        return float(np.sqrt(np.mean(error) + floor_mm**2))

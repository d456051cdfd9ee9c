"""`kind = "legs"`: given poses at which a ballbar measures given legs, from given sides: the check poses of a watch.

Where a calibrated model chose the poses, their legs lie within the stroke, and there is no second stage. What else is
true of a hexapod holds here: somebody moves the bar, and the robot leaves when it is off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from acquisition.campaign.blocks.block import BlockVisit, Joints, Site
from calib.text import TomlTable
from drivers.errors import ConfigError

KEYS = ("joints_deg", "legs", "approach_sides")

Leg = tuple[str, str]


@dataclass(frozen=True)
class Legs:
    """`joints_deg`: the poses; `legs`: of each pose target and ball on the base, in the order in which they are
    measured; `sides`: from where every joint arrives; empty: as the approach of the block says."""

    joints_deg: tuple[Joints, ...]
    legs: tuple[tuple[Leg, ...], ...]
    sides: tuple[tuple[int, ...], ...] = ()
    ordered = True
    lengths = True

    def visits_at(self, site: Site) -> list[BlockVisit]:
        for target, base in (leg for legs in self.legs for leg in legs):
            if target not in site.cell.tool.targets or base not in site.cell.nests:
                raise ConfigError(
                    f"block {site.number + 1}: a leg from {target!r} to {base!r}; the cell has the targets "
                    f"{', '.join(site.cell.tool.targets)} and the balls {', '.join(site.cell.nests)}"
                )
        sides = self.sides or (site.sides(),) * len(self.legs)
        return [
            site.visit(f"pose {i}", site.posture(f"pose {i}", pose), side, legs)
            for i, (pose, side, legs) in enumerate(
                zip(self.joints_deg, sides, self.legs, strict=True), start=1
            )
        ]


def read(table: TomlTable, folder: Path | None) -> Legs:
    """The block of a table of the campaign, which names no file in `folder`. Raises ConfigError."""
    legs = _legs(table)
    rows = table.values.get("joints_deg")
    width = (
        len(rows[0]) if isinstance(rows, list | tuple) and rows and isinstance(rows[0], list | tuple) else 0
    )
    poses = tuple(table.rows("joints_deg", width))
    sides = tuple(table.rows("approach_sides", width))
    if len(poses) != len(legs):
        raise table.refuse(
            "joints_deg", f"has {len(poses)} poses for {len(legs)} rows of legs.", "Give one each."
        )
    if sides and (len(sides) != len(poses) or any(abs(side) != 1.0 for row in sides for side in row)):
        raise table.refuse(
            "approach_sides",
            "is not one row a pose.",
            "Give +1 (from below) or -1 for every joint of every pose.",
        )
    return Legs(poses, legs, tuple(tuple(int(side) for side in row) for row in sides))


def _legs(table: TomlTable) -> tuple[tuple[Leg, ...], ...]:
    given = table.values.get("legs")
    rows = given if isinstance(given, list | tuple) else ()
    if not rows or not all(_are_legs(row) for row in rows):
        raise table.refuse(
            "legs",
            "is no list of legs a pose.",
            "Give [['T1', 'B1'], ...] for every pose: target and ball on the base.",
        )
    return tuple(tuple((str(target), str(base)) for target, base in row) for row in rows)


def _are_legs(row: object) -> bool:
    return (
        isinstance(row, Sequence)
        and len(row) > 0
        and all(
            isinstance(leg, list | tuple)
            and len(leg) == 2
            and all(isinstance(name, str) and name for name in leg)
            for leg in row
        )
    )

"""`kind = "hexapod"`: the tool on six ballbar legs between three balls on the base and three on the tool.

Every pose brings six distances, and with them the place and turn of the tool. Poses: all stances of the balls
(`calib.arm.hexapod`) that the arm reaches within the limits, its approach point included, all legs on the side away
from the flange. Stances whose leg labels agree follow one another, and of two legs in a row one end of the bar stays
where it is. A robot misses by millimetres, the bar shows one: with `stages = 2` what lies outside its stroke is
measured after a calibration by what lies within (`run.second_stage`). Source: Nubiola, thesis, sections 4.2 to 4.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acquisition.campaign.blocks.block import DECIMALS, BlockVisit, Site
from acquisition.cell.reach import configurations
from acquisition.cell.transit import may_visit
from acquisition.cell.workspace import Array
from calib.arm import LEGS, stances
from calib.errors import DataError
from calib.text import TomlTable
from drivers.errors import ConfigError

KEYS = ("base", "count", "stages", "configurations")
_ONE_END = ((2, 0), (0, 0), (0, 1), (1, 1), (1, 0), (1, 2))
"""The legs of a design (`calib.arm.hexapod.LEGS`) in an order in which a person moves one end of the bar at a time."""
_ORDER = tuple(LEGS.index(leg) for leg in _ONE_END)


@dataclass(frozen=True)
class Hexapod:
    """`base`: the balls on the base, None for the cell's first three; `count`: at most so many poses, None for all;
    `every_configuration`: a stance that the arm reaches in several branches is taken in each.
    """

    base: tuple[str, ...] | None
    count: int | None
    stages: int
    every_configuration: bool
    ordered = True
    lengths = True

    def visits_at(self, site: Site) -> list[BlockVisit]:
        base = self.base or tuple(site.cell.nests)[:3]
        if len(base) != 3 or len(site.targets) != 3 or not set(base) <= set(site.cell.nests):
            raise ConfigError(
                f"block {site.number + 1}: a hexapod lies between three balls of world.nests and three targets, "
                f"not {', '.join(base)} and {', '.join(site.targets)}"
            )
        cell = site.cell
        tool = np.array([cell.tool.targets[name] for name in site.targets])
        try:
            found = stances(np.array([cell.nests[name] for name in base]), tool, cell.instrument.nominal_mm)
            joints = configurations(cell, found.flange[found.outward])
        except (DataError, ValueError) as error:
            raise ConfigError(f"block {site.number + 1}: {error}") from error
        which, joints = self._allowed(site, joints)
        if not len(which):
            raise ConfigError(
                f"block {site.number + 1}: the arm reaches no stance of the legs between {', '.join(base)} and "
                f"{', '.join(site.targets)}; move the balls, or widen limits_deg"
            )
        legs = list(zip(found.base[found.outward][which], found.tool[found.outward][which], strict=True))
        sides = site.sides()
        return [
            site.visit(
                f"hexapod pose {i}",
                tuple(float(q) for q in pose),
                sides,
                [(site.targets[leg[1][k]], base[leg[0][k]]) for k in _ORDER],
            )
            for i, (pose, leg) in enumerate(zip(joints, legs, strict=True), start=1)
        ]

    def _allowed(self, site: Site, joints_deg: Array) -> tuple[NDArray[np.int64], Array]:
        """Stance (k,) and joints (k, N), deg, of those that may be driven, of configurations (n, 8, N)."""
        n, branches, axes = joints_deg.shape
        flat = np.round(joints_deg.reshape(-1, axes), DECIMALS)
        approach = flat - abs(site.approach.offset_deg) * np.array(site.sides())
        good = np.all(np.isfinite(flat), axis=1)
        good[good] = may_visit(site.cell, flat[good], approach[good])
        good = good.reshape(n, branches)
        if not self.every_configuration:
            good &= np.cumsum(good, axis=1) == 1  # the first of every stance
        which, branch = np.nonzero(good)
        if self.count is not None and self.count < len(which):
            spread = np.round(np.linspace(0, len(which) - 1, self.count)).astype(int)
            which, branch = which[spread], branch[spread]
        return which, np.round(joints_deg[which, branch], DECIMALS)


def read(table: TomlTable, folder: Path | None) -> Hexapod:
    """Raises ConfigError."""
    return Hexapod(
        base=table.names("base"),
        count=table.whole("count", low=1) if "count" in table.values else None,
        stages=table.whole("stages", 2, low=1, high=2),
        every_configuration=table.text("configurations", "one", ("one", "all")) == "all",
    )

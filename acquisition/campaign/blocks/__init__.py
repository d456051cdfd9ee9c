"""The blocks of a campaign, one recipe a kind. `read_block` reads one; `KINDS` says what there is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from acquisition.campaign.blocks import ballbar_geometry, hexapod, legs, path, poses, repeat, sphere, sweep
from acquisition.campaign.blocks.block import Approach, Block, Recipe, Settle, read_approach, read_settle
from calib.text import TomlTable

SHARED = ("kind", "set", "targets", "approach", "settle_s", "settle_check", "new_station")


@dataclass(frozen=True)
class BlockKind:
    """A kind of block and how it is read; the first of its sets is the one it has unless the file says."""

    keys: tuple[str, ...]
    sets: tuple[str, ...]
    read: Callable[[TomlTable, Path | None], Recipe]
    settle_s: float | None = None


_FITTED = ("calibration", "validation")
KINDS: Mapping[str, BlockKind] = {
    "poses": BlockKind(poses.OWN_KEYS, _FITTED, poses.read),
    "sweep": BlockKind(sweep.KEYS, _FITTED, sweep.read_sweep),
    "repeat": BlockKind(repeat.KEYS, ("repeat", "validation"), repeat.read),
    "circle_point": BlockKind(sweep.CIRCLE_KEYS, _FITTED, sweep.read_circle_point),
    "hexapod": BlockKind(hexapod.KEYS, _FITTED, hexapod.read),
    "legs": BlockKind(legs.KEYS, _FITTED, legs.read),
    "ballbar_geometry": BlockKind(ballbar_geometry.KEYS, ("calibration",), ballbar_geometry.read),
    "path": BlockKind(path.KEYS, _FITTED, path.read),
    "sphere": BlockKind(sphere.KEYS, ("validation", "calibration"), sphere.read, sphere.SETTLE_S),
}


def read_block(table: TomlTable, approach: Approach, settle: Settle, folder: Path | None) -> Block:
    """Read one [[block]]; `approach` and `settle` are those of the campaign. Raises ConfigError naming the key.

    folder: where pose files are; None: they are not read again.
    """
    name = table.text("kind", "poses", tuple(KINDS))
    kind = KINDS[name]
    table.only((*SHARED, *kind.keys))
    if kind.settle_s is not None:
        settle = Settle(kind.settle_s, settle.check)
    return Block(
        kind=name,
        set=table.text("set", kind.sets[0], kind.sets),
        targets=table.names("targets"),
        approach=read_approach(table.table("approach"), approach),
        settle=read_settle(table, settle),
        new_station=table.flag("new_station", False),
        recipe=kind.read(table, folder),
    )

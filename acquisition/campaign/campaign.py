"""The campaign file `campaign.toml` (`truepose-campaign/1`): what to measure, how often, from which side.

Angles deg, lengths mm, times s (campaign time, which a simulated cell runs `time_scale` times faster). A campaign
says what; `campaign.blocks` has its kinds of blocks, `campaign.plan` turns it into poses for one cell.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomli_w

from acquisition.campaign.blocks import read_block
from acquisition.campaign.blocks.block import Approach, Block, Settle, read_approach, read_settle
from acquisition.campaign.blocks.path import WaypointPath
from acquisition.campaign.blocks.poses import read_poses
from acquisition.errors import as_config_error
from calib.text import TomlTable, parse_toml, read_toml

__all__ = [
    "FORMAT",
    "Approach",
    "Block",
    "Campaign",
    "NestCheck",
    "Settle",
    "WarmUpRule",
    "campaign_from",
    "campaign_of_record",
    "read_campaign",
    "read_poses",
]

FORMAT = "truepose-campaign/1"
_KEYS = (
    "format name approach settle_s settle_check samples retries warm_up_s warm_up nest_check reference_every "
    "zero_every order seed block robot"
)
_DEVICE = ("maker", "model", "serial")


@dataclass(frozen=True)
class WarmUpRule:
    """The arm is warm when its last `over` readings of the reference pose lie within `below_mm` of each other.

    They are `every_s` apart; after `at_most_s` a person decides.
    """

    below_mm: float
    over: int
    every_s: float
    at_most_s: float


@dataclass(frozen=True)
class NestCheck:
    """The nests are measured again after `every` readings; one that moved more than `limit_mm` stops for a person."""

    every: int
    limit_mm: float


@dataclass(frozen=True)
class Campaign:
    """A measurement campaign as its file describes it.

    source: the text of the file, kept in the record; robot: `maker`, `model` and `serial` of the only robot that may be
    measured, such as that of a watch's baseline; empty for any.
    """

    blocks: tuple[Block, ...]
    settle: Settle
    samples: int
    retries: int
    warm_up_s: float
    warm_up: WarmUpRule | None
    nest_check: NestCheck | None
    reference_every: int
    zero_every: int
    shuffled: bool
    seed: int
    source: str = field(repr=False)
    robot: Mapping[str, str] = field(default_factory=dict)

    @property
    def settle_s(self) -> float:
        """The pause before a reading, s, unless a block says otherwise."""
        return self.settle.seconds

    def settle_of(self, block: int) -> Settle:
        """The settling of a visit of the block with this number; records of old have reference poses of none, -1."""
        return self.settle if block < 0 else self.blocks[block].settle

    def path_of(self, block: int) -> WaypointPath | None:
        """The path of the block with this number, with how it is recorded; None where the block is no path."""
        recipe = self.blocks[block].recipe if block >= 0 else None
        return recipe if isinstance(recipe, WaypointPath) else None

    def station_of(self, block: int) -> int:
        """Number of times that the instrument has been set up anew when the block is measured."""
        return sum(each.new_station for each in self.blocks[: block + 1])


@as_config_error()
def read_campaign(path: Path) -> Campaign:
    """Read `campaign.toml`. Raises ConfigError naming file and key."""
    text, table = read_toml(path)
    return campaign_from(table, str(path), beside=path.parent, source=text)


@as_config_error()
def campaign_of_record(source: str, where: str) -> Campaign:
    """The campaign of a record from its text; poses of files are in the record's plan and not read again."""
    return campaign_from(parse_toml(source, where), where, source=source, read_files=False)


@as_config_error()
def campaign_from(
    table: Mapping[str, Any],
    file: str,
    *,
    beside: Path | None = None,
    source: str = "",
    read_files: bool = True,
) -> Campaign:
    """A campaign from a parsed table (a file, or the body of a request). Raises ConfigError."""
    top = TomlTable(table, file)
    top.text("format", allowed=(FORMAT,))
    top.only(_KEYS.split())
    top.text("name", "")
    approach = read_approach(top.table("approach"), Approach())
    settle = read_settle(top, Settle(4.0, check=False))
    blocks = top.tables("block")
    if not blocks:
        raise top.refuse("block", "is missing.", "A campaign measures at least one [[block]].")
    folder = (beside or Path()) if read_files else None
    return Campaign(
        blocks=_stations(blocks, tuple(read_block(block, approach, settle, folder) for block in blocks)),
        settle=settle,
        samples=top.whole("samples", 100, low=1, high=100_000),
        retries=top.whole("retries", 2, high=100),
        warm_up_s=top.number("warm_up_s", 0.0, low=0.0, high=86_400.0),
        warm_up=_warm_up(top),
        nest_check=_nest_check(top),
        reference_every=top.whole("reference_every", 0),
        zero_every=top.whole("zero_every", 0),
        shuffled=top.text("order", "blocks", ("blocks", "shuffled")) == "shuffled",
        seed=top.whole("seed", 1, high=2**53),
        source=source or tomli_w.dumps(table),
        robot=_robot(top.table("robot")),
    )


def _stations(tables: list[TomlTable], blocks: tuple[Block, ...]) -> tuple[Block, ...]:
    if blocks[0].new_station:
        raise tables[0].refuse(
            "new_station", "is true in the first block.", "The nests are measured there anyway."
        )
    return blocks


def _robot(table: TomlTable) -> dict[str, str]:
    table.only(_DEVICE)
    return {key: table.text(key) for key in _DEVICE if key in table.values}


def _warm_up(top: TomlTable) -> WarmUpRule | None:
    if "warm_up" not in top.values:
        return None
    table = top.table("warm_up")
    table.only(("below_mm", "over", "every_s", "at_most_s"))
    return WarmUpRule(
        below_mm=table.number("below_mm", low=1e-4, high=10.0),
        over=table.whole("over", 3, low=2, high=100),
        every_s=table.number("every_s", 300.0, low=0.0, high=3600.0),
        at_most_s=table.number("at_most_s", 7200.0, low=0.0, high=86_400.0),
    )


def _nest_check(top: TomlTable) -> NestCheck | None:
    if "nest_check" not in top.values:
        return None
    table = top.table("nest_check")
    table.only(("every", "limit_mm"))
    return NestCheck(table.whole("every", low=1), table.number("limit_mm", low=1e-4, high=10.0))

"""The campaign file `campaign.toml` (`truepose-campaign/1`): what to measure, how often, from which side.

Angles deg, times s (campaign time, which a simulated cell runs `time_scale` times faster). A campaign says
what; `acquisition.plan` turns it into poses for one cell.
"""

from __future__ import annotations

import csv
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, cast

import tomli_w

from acquisition.toml_table import TomlTable, parse_toml
from drivers.errors import ConfigError

FORMAT = "truepose-campaign/1"
SETS = ("calibration", "validation")
_KEYS = "format name approach settle_s samples retries warm_up_s reference_every order seed block"
KINDS = ("poses", "sweep", "repeat", "circle_point", "hexapod", "sphere")

Joints = tuple[float, ...]
Sides = Literal["one", "both"]
Select = Literal["random", "file", "list", "observability"]
DRAWN = ("random", "observability")


@dataclass(frozen=True)
class Approach:
    """From where the last move starts: `offset_deg` on every joint; `both`: its sign drawn for each joint."""

    offset_deg: float = -5.0
    sides: Sides = "one"


@dataclass(frozen=True)
class Block:
    """Poses of one set. `joints_deg`: the poses themselves where they are given, else drawn (select in `DRAWN`)."""

    set: str
    select: Select
    count: int
    targets: tuple[str, ...] | None
    approach: Approach
    joints_deg: tuple[Joints, ...] = ()


@dataclass(frozen=True)
class Campaign:
    """One campaign. `targets` of a block None: all of the cell. `source`: its text, kept in the record."""

    blocks: tuple[Block, ...]
    settle_s: float
    samples: int
    retries: int
    warm_up_s: float
    reference_every: int
    shuffled: bool
    seed: int
    source: str = field(repr=False)


def read_campaign(path: Path) -> Campaign:
    """Read `campaign.toml`. Raises ConfigError naming file and key."""
    text, table = parse_toml(path)
    return campaign_from(table, str(path), beside=path.parent, source=text)


def campaign_of_record(source: str, where: str) -> Campaign:
    """The campaign of a record from its text; poses of files are in the record's plan and not read again."""
    return campaign_from(tomllib.loads(source), where, source=source, read_files=False)


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
    approach = _approach(top.table("approach"), Approach())
    blocks = top.tables("block")
    if not blocks:
        raise top.refuse("block", "is missing: a campaign measures at least one [[block]].")
    folder = (beside or Path()) if read_files else None
    return Campaign(
        blocks=tuple(_block(block, approach, folder) for block in blocks),
        settle_s=top.number("settle_s", 4.0, low=0.0, high=3600.0),
        samples=top.whole("samples", 100, low=1, high=100_000),
        retries=top.whole("retries", 2, high=100),
        warm_up_s=top.number("warm_up_s", 0.0, low=0.0, high=86_400.0),
        reference_every=top.whole("reference_every", 0),
        shuffled=top.text("order", "blocks", ("blocks", "shuffled")) == "shuffled",
        seed=top.whole("seed", 1, high=2**53),
        source=source or tomli_w.dumps(table),
    )


def _approach(table: TomlTable, default: Approach) -> Approach:
    table.only(("offset_deg", "sides"))
    offset = table.number("offset_deg", default.offset_deg, low=-30.0, high=30.0)
    if abs(offset) < 0.1:
        raise table.refuse(
            "offset_deg", f"is {offset:g}; without an approach, backlash spoils every reading."
        )
    return Approach(offset, cast(Sides, table.text("sides", default.sides, ("one", "both"))))


def _block(table: TomlTable, approach: Approach, folder: Path | None) -> Block:
    table.only(("kind", "set", "count", "select", "targets", "approach", "file", "joints_deg"))
    kind = table.text("kind", "poses", KINDS)
    if kind != "poses":
        raise table.refuse("kind", f"is {kind!r}; this version measures kind = 'poses' only.")
    select = table.text("select", "random", ("random", "file", "list", "observability"))
    poses: tuple[Joints, ...] = ()
    if select == "list":
        poses = _listed(table)
    elif select == "file" and folder is not None:
        poses = read_poses(folder / table.text("file"))
    return Block(
        set=table.text("set", "calibration", SETS),
        select=cast(Select, select),
        count=table.whole("count", len(poses) or None, low=1) if select in DRAWN else len(poses),
        targets=table.names("targets"),
        approach=_approach(table.table("approach"), approach),
        joints_deg=poses,
    )


def _listed(table: TomlTable) -> tuple[Joints, ...]:
    rows = table.values.get("joints_deg")
    if not isinstance(rows, Sequence) or not rows:
        raise table.refuse("joints_deg", "is missing or empty: select = 'list' needs the poses.")
    width = len(rows[0]) if isinstance(rows[0], Sequence) else 0
    return tuple(table.rows("joints_deg", width))


def read_poses(path: Path) -> tuple[Joints, ...]:
    """Poses of a CSV file with columns `j1_deg`, `j2_deg`, ... Raises ConfigError naming the line."""
    try:
        lines = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read ({error}).") from error
    names = [name.strip() for name in lines[0]] if lines else []
    columns = []
    while f"j{len(columns) + 1}_deg" in names:
        columns.append(names.index(f"j{len(columns) + 1}_deg"))
    if not columns:
        raise ConfigError(f"{path}, line 1: has no columns j1_deg, j2_deg, ...")
    poses = []
    for number, line in enumerate(lines[1:], start=2):
        if any(cell.strip() for cell in line):
            try:
                poses.append(tuple(float(line[column]) for column in columns))
            except (ValueError, IndexError) as error:
                raise ConfigError(f"{path}, line {number}: a joint angle is not a number.") from error
    if not poses:
        raise ConfigError(f"{path}: has no poses.")
    return tuple(poses)

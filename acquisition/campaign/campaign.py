"""The campaign file `campaign.toml` (`truepose-campaign/1`).

It states what to measure, how often, and from which side. Angles are in deg, lengths in mm, times in s (campaign
time, which a simulated cell runs `time_scale` times faster). `campaign.blocks` has the kinds of blocks;
`campaign.plan` turns a campaign into poses for one cell.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import tomli_w
from pydantic import PrivateAttr, Strict, model_validator

from acquisition.campaign.blocks import AnyBlock
from acquisition.campaign.blocks.adaptive import AdaptiveBlock
from acquisition.campaign.blocks.block import Approach, ApproachTable, Block, Settle
from acquisition.campaign.blocks.path import PathBlock
from acquisition.campaign.blocks.poses import read_poses
from acquisition.errors import as_config_error
from acquisition.file_table import Table, Text, Written, no_default, read_table, refused, told
from calib.text import parse_toml, read_toml

__all__ = [
    "FORMAT",
    "Approach",
    "Block",
    "Campaign",
    "Settle",
    "campaign_from",
    "campaign_of_record",
    "read_campaign",
    "read_poses",
]

FORMAT = "truepose-campaign/1"


class WarmUpTable(Table):
    """The warm-up: the reference pose is measured until the arm is warm."""

    below_mm: Annotated[
        float, told("The last readings must lie within this of each other, mm.", 0.02, ge=1e-4, le=10.0)
    ]
    over: Annotated[int, told("Number of those readings.", 3, ge=2, le=100)] = 3
    every_s: Annotated[float, told("Time between two of them, s.", 300.0, ge=0.0, le=3600.0)] = 300.0
    at_most_s: Annotated[float, told("After this a person decides, s.", 7200.0, ge=0.0, le=86_400.0)] = 7200.0


class NestCheckTable(Table):
    """The repeated measurement of the nests while the campaign runs."""

    every: Annotated[int, told("Number of readings between two checks.", 100, ge=1, le=1_000_000)]
    limit_mm: Annotated[
        float, told("A nest that moved by more stops for a person, mm.", 0.05, ge=1e-4, le=10.0)
    ]


class CampaignTable(Table):
    """A campaign: the content of `campaign.toml`, also as JSON.

    Every key has a default except `format` and `block`. An unknown key is refused by name. Null is not allowed: leave
    the key out.
    """

    format: Annotated[Literal["truepose-campaign/1"], told("The format of the table.", FORMAT)]
    name: Annotated[Written, told("A name for people; nothing depends on it.", "night 1")] = ""
    seed: Annotated[int, told("Everything random is drawn from it; no unit.", 7, ge=0, le=2**53)] = 1
    order: Annotated[
        Literal["blocks", "shuffled"],
        told("`shuffled` mixes the poses of all blocks; sweeps and repeats stay whole.", "shuffled"),
    ] = "blocks"
    approach: Annotated[
        ApproachTable,
        told(
            "How the last move to a pose begins.",
            {"offset_deg": -5.0, "sides": "both"},
            json_schema_extra=no_default,
        ),
    ] = ApproachTable()
    settle_s: Annotated[float, told("Pause before a reading, s.", 4.0, ge=0.0, le=3600.0)] = 4.0
    settle_check: Annotated[
        bool, told("Then also wait until two read-backs half a second apart agree.", True)
    ] = False
    samples: Annotated[int, told("Number of samples of one reading.", 100, ge=1, le=100_000)] = 100
    retries: Annotated[
        int, told("Number of times a failed reading is repeated before it is put off.", 2, ge=0, le=100)
    ] = 2
    warm_up_s: Annotated[
        float, told("Wait before the first pose, s, in every execution.", 600.0, ge=0.0, le=86_400.0)
    ] = 0.0
    warm_up: Annotated[WarmUpTable | None, told("Left out: nobody waits.", {"below_mm": 0.02})] = None
    nest_check: Annotated[
        NestCheckTable | None, told("Left out: not checked.", {"every": 100, "limit_mm": 0.05})
    ] = None
    reference_every: Annotated[
        int, told("The reference pose again after this number of readings; 0: never.", 20, ge=0, le=1_000_000)
    ] = 0
    zero_every: Annotated[
        int,
        told(
            "The ballbar's calibrator again after this number of distances; 0: never.", 30, ge=0, le=1_000_000
        ),
    ] = 0
    robot: Annotated[
        dict[Literal["maker", "model", "serial"], Text],
        told("The one robot that may be measured; left out: any.", {"serial": "120-500000"}),
    ] = {}  # noqa: RUF012 pydantic copies it
    block: Annotated[
        tuple[AnyBlock, ...],
        Strict(False),
        told(
            "What is measured, one after the other.",
            [{"kind": "poses", "set": "calibration", "count": 60}],
            missing="A campaign measures at least one [[block]].",
        ),
    ]
    _source: str = PrivateAttr("")

    @model_validator(mode="after")
    def _complete(self) -> Self:
        """Fill in the campaign's values for the keys that its blocks leave out."""
        if not self.block:
            raise refused("block", "is missing.", "A campaign measures at least one [[block]].")
        if self.block[0].new_station:
            what = "is true in the first block."
            raise refused("block[0].new_station", what, "The nests are measured there anyway.")
        adaptive = [i for i, each in enumerate(self.block) if isinstance(each, AdaptiveBlock)]
        for i, each in enumerate(self.block):
            if adaptive and i > adaptive[0] and (i in adaptive or each.new_station):
                key = f"block[{i}].{'kind' if i in adaptive else 'new_station'}"
                what = f"comes after block[{adaptive[0]}], which adds its poses to the end of the campaign."
                raise refused(key, what, "Put the adaptive block last, or make two campaigns.")
        approach = self.approach.within(ApproachTable(), "approach.")
        settle = Settle(self.settle_s, self.settle_check)
        blocks = tuple(each.within(approach, settle, f"block[{i}].") for i, each in enumerate(self.block))
        return self.model_copy(update={"approach": approach, "block": blocks})

    @property
    def blocks(self) -> tuple[AnyBlock, ...]:
        return self.block

    @property
    def settle(self) -> Settle:
        return Settle(self.settle_s, self.settle_check)

    @property
    def shuffled(self) -> bool:
        return self.order == "shuffled"

    @property
    def source(self) -> str:
        """The text of the file, kept in the record."""
        return self._source

    def settle_of(self, block: int) -> Settle:
        """Return the settling of the visits of a block.

        Old records have reference poses without a block, -1; they settle as the campaign states.
        """
        return self.settle if block < 0 else self.blocks[block].settle

    def path_of(self, block: int) -> PathBlock | None:
        """Return the path block with this number, or None if the block is not a path."""
        found = self.blocks[block] if block >= 0 else None
        return found if isinstance(found, PathBlock) else None

    def station_of(self, block: int) -> int:
        """Return how often the instrument has been set up again before the block is measured."""
        return sum(each.new_station for each in self.blocks[: block + 1])


@as_config_error()
def read_campaign(path: Path) -> Campaign:
    """Read `campaign.toml`.

    Raises
    ------
    ConfigError
        The file cannot be used; the message names file and key.
    """
    text, table = read_toml(path)
    return campaign_from(table, str(path), beside=path.parent, source=text)


@as_config_error()
def campaign_of_record(source: str, where: str) -> Campaign:
    """Return the campaign of a record from its text.

    Pose files are not read again: their poses are in the plan of the record.
    """
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
    """Create a campaign from a parsed table (a file, or the body of a request).

    Parameters
    ----------
    table
        The parsed table.
    file
        Name of the file in error messages.
    beside
        Folder of the pose files that the campaign names. Default: the current folder.
    source
        Text that the record keeps. Default: the table as TOML.
    read_files
        Whether to read the pose files.

    Raises
    ------
    ConfigError
        The table cannot be used; the message names file and key.
    """
    campaign = read_table(CampaignTable, table, file, (beside or Path()) if read_files else None)
    campaign._source = source or tomli_w.dumps(table)
    return campaign


Campaign = CampaignTable

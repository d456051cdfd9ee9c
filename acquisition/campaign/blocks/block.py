"""The common part of all campaign blocks: set, targets, approach, settling and recipe.

A recipe turns a block into visits of the robot for one cell. A pose is reached over its approach point q - side x
length (Nubiola, thesis 2.5). The length is that of the block, is drawn with the pose, or the recipe names the point.
Joints are in deg, or in mm if they slide. They are rounded to a resolution that every controller accepts; the record
holds the rounded values.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BeforeValidator, PrivateAttr, ValidationInfo, model_validator

from acquisition.cell.cell import Cell
from acquisition.file_table import List, Once, Table, Text, no_default, refused, told
from drivers.errors import ConfigError

DECIMALS = 4  # a stock open_abb request carries four
_LONGER, _LONGEST_DEG = 3.0, 30.0  # last moves of drawn poses: up to three times the shortest

Joints = tuple[float, ...]
Sides = Literal["one", "both"]


def _no_flag(value: Any) -> Any:
    """Refuse true and false, which are 1 and 0 to a Literal."""
    if isinstance(value, bool):
        raise ValueError("a flag")
    return value


Side = Annotated[Literal[-1, 1], BeforeValidator(_no_flag)]
ASide = "Give +1 (from below) or -1 for every joint of every pose."
Posture = Annotated[
    List[float] | None, told("The posture, deg; left out: drawn.", [0.0, 20.0, 0.0, 0.0, 60.0, 0.0])
]
Step = Annotated[float, told("Step, deg.", 5.0, ge=0.01, le=180.0)]
Balls = Annotated[
    Once[Text] | None, told("Names of balls on the base; left out: the cell's.", ["N1", "N2", "N3"])
]
Stages = Annotated[
    int, told("Number of stages, 1 or 2: what lay out of the bar's stroke comes again.", 2, ge=1, le=2)
]
Set = Annotated[
    Literal["calibration", "validation"],
    told("Calibration enters the fit, validation never does.", "calibration"),
]


class RandomStream(IntEnum):
    """Streams of random numbers from the seed of a campaign, one per purpose."""

    POSE, SIDE, ORDER, REFERENCE, POSTURE, REACH = range(6)


class ApproachTable(Table):
    """The last move to a pose: it begins at an approach point that is offset in every joint."""

    offset_deg: Annotated[
        float,
        told(
            "How far off every joint starts, deg; left out: -5, or as the campaign.",
            -5.0,
            ge=-30.0,
            le=30.0,
            json_schema_extra=no_default,
        ),
    ] = -5.0
    sides: Annotated[
        Sides,
        told(
            "`both`: from a side drawn for each joint of each pose; left out: `one`, or as the campaign.",
            "both",
            json_schema_extra=no_default,
        ),
    ] = "one"
    longest_deg: Annotated[
        float | None,
        told(
            "The length is drawn anew for each pose up to this, deg; left out: the kind of block says it.",
            15.0,
        ),
    ] = None

    @model_validator(mode="after")
    def _is_an_approach(self) -> Self:
        if abs(self.offset_deg) < 0.1:
            raise refused(
                "offset_deg",
                f"is {self.offset_deg:g}.",
                "Without an approach, backlash spoils every reading.",
            )
        return self

    def within(self, default: ApproachTable, where: str = "") -> ApproachTable:
        """Return this table with missing keys from `default`.

        A length out of range raises the error of `refused`, for a key below `where`.
        """
        given = {key: getattr(self, key) for key in self.model_fields_set}
        kept = {} if "offset_deg" in given else {"longest_deg": default.longest_deg}
        found = default.model_copy(update={"longest_deg": None, **kept, **given})
        least, most = abs(found.offset_deg), max(_LONGEST_DEG, abs(found.offset_deg))
        if "longest_deg" in given and not least <= (longest := self.longest_deg or 0.0) <= most:
            raise refused(
                f"{where}longest_deg", f"is {longest!r}.", f"Give a number from {least:g} to {most:g}."
            )
        return found

    @property
    def side(self) -> int:
        """The side of approach if it is the same for all joints: +1 from below, -1 from above."""
        return 1 if self.offset_deg < 0 else -1

    @property
    def usual_longest_deg(self) -> float:
        """The upper limit of the lengths that are drawn together with random poses, deg."""
        shortest = abs(self.offset_deg)
        return self.longest_deg or min(_LONGER * shortest, max(_LONGEST_DEG, shortest))

    def point(self, joints_deg: Joints, sides: Iterable[int], reach_deg: float | None = None) -> Joints:
        """Return the start of the last move, deg.

        If a joint arrives from below (side +1), its start lies below the pose. `reach_deg` replaces the length of the
        table.
        """
        reach = abs(self.offset_deg) if reach_deg is None else reach_deg
        return rounded(q - side * reach for q, side in zip(joints_deg, sides, strict=True))


@dataclass(frozen=True)
class Settle:
    """The pause of the robot before a reading, in seconds.

    With `check`, it then also lasts until two consecutive read-backs agree.
    """

    seconds: float
    check: bool


@dataclass(frozen=True)
class BlockVisit:
    """A pose to be visited, before it has its place in the order of the campaign.

    Attributes
    ----------
    what
        Name of the visit within its block.
    distances
        Pairs of a target and a ball on the base, if a ballbar measures them, or of two balls of one body, if the arm
        takes no part (no joints).
    waypoints
        The further waypoints of a path.
    readings
        Number of readings of every target while the arm rests.
    targets
        The targets that are measured, if not all of the block.
    """

    what: str
    joints_deg: Joints
    sides: tuple[int, ...]
    approach_deg: Joints
    distances: Sequence[tuple[str, str]] = ()
    waypoints: tuple[Joints, ...] = ()
    readings: int = 1
    targets: tuple[str, ...] = ()


@dataclass(frozen=True)
class Site:
    """The context of a block: its cell, its number (from 0), its targets and its approach.

    `taken` holds the poses, deg, of the calibration blocks that precede a validation block.
    """

    cell: Cell
    seed: int
    number: int
    targets: tuple[str, ...]
    approach: Approach
    taken: tuple[Joints, ...] = ()

    def rng(self, stream: RandomStream) -> np.random.Generator:
        """Return a random generator that belongs to this block alone."""
        return np.random.default_rng([self.seed, stream, self.number])

    def visit(
        self,
        what: str,
        joints_deg: Joints,
        sides: tuple[int, ...],
        distances: Sequence[tuple[str, str]] = (),
        reach_deg: float | None = None,
    ) -> BlockVisit:
        """Return a visit with the approach of its block, or with another length of the last move."""
        return BlockVisit(
            what, joints_deg, sides, self.approach.point(joints_deg, sides, reach_deg), distances
        )

    def sides(self) -> tuple[int, ...]:
        """Return the usual side on every joint, or one drawn for each."""
        joints = self.cell.robot.model.joints
        if self.approach.sides == "one":
            return (self.approach.side,) * joints
        return tuple(int(s) for s in self.rng(RandomStream.SIDE).choice((-1, 1), size=joints))

    def posture(self, key: str, joints_deg: Joints) -> Joints:
        """Round a pose from a file.

        Raises
        ------
        ConfigError
            The pose has another number of joints than the robot.
        """
        if len(joints_deg) != self.cell.robot.model.joints:
            raise ConfigError(
                f"block {self.number + 1}, {key} has {len(joints_deg)} joints, "
                f"the robot {self.cell.robot.model.joints}",
                what_to_do="Give one value per joint.",
            )
        return rounded(joints_deg)


class Block(Table):
    """A block of a campaign: the base class of all kinds.

    Attributes
    ----------
    ordered
        Whether the poses stay together and in order when a campaign is shuffled.
    of_lengths
        Whether the kind measures distances.
    usual_settle_s
        Pause of this kind unless the block states another, s; None for the campaign's.
    """

    ordered: ClassVar[bool] = True
    of_lengths: ClassVar[bool] = False
    usual_settle_s: ClassVar[float | None] = None
    _model_file: Path | None = PrivateAttr(None)

    targets: Annotated[
        Once[Text] | None, told("Names of targets of the cell; left out: all.", ["T1", "T3"])
    ] = None
    approach: Annotated[
        ApproachTable,
        told(
            "How the last move to a pose begins; left out: as the campaign.",
            {"offset_deg": -5.0, "sides": "both"},
            json_schema_extra=no_default,
        ),
    ] = ApproachTable()
    settle_s: Annotated[
        float,
        told(
            "Pause before a reading, s; left out: the campaign's, 2 on a sphere.",
            4.0,
            ge=0.0,
            le=3600.0,
            json_schema_extra=no_default,
        ),
    ] = 4.0
    settle_check: Annotated[
        bool,
        told(
            "Then also wait until two read-backs half a second apart agree; left out: as the campaign.",
            True,
            json_schema_extra=no_default,
        ),
    ] = False
    model: Annotated[
        Text | None,
        told(
            "A saved model: a file beside the campaign, or by HTTP the id of the job or loop that found it. The real "
            "robot, by the model, takes the poses of this block.",
            "m.json",
        ),
    ] = None
    new_station: Annotated[bool, told("A person sets the instrument up anew before this block.", False)] = (
        False
    )

    @model_validator(mode="after")
    def _has_a_model(self, info: ValidationInfo) -> Self:
        folder: Path | None = (info.context or {}).get("folder")
        self._model_file = None if self.model is None or folder is None else folder / self.model
        return self

    def drive_through(self, file: Path) -> None:
        """Use this file as that of `model`, which then is a name for it."""
        self._model_file = file

    @property
    def model_file(self) -> Path | None:
        """The file of `model`; None if there is none, or if the campaign is that of a record."""
        return self._model_file

    @property
    def wanted(self) -> int | None:
        """Number of poses that the block asks for; None if it depends on the cell."""
        return None

    @property
    def lengths(self) -> bool:
        """Whether the block measures distances."""
        return self.of_lengths

    @property
    def settle(self) -> Settle:
        return Settle(self.settle_s, self.settle_check)

    def within(self, approach: ApproachTable, settle: Settle, where: str) -> Self:
        """Return the block with the campaign's values for all keys that it leaves out."""
        usual = settle.seconds if self.usual_settle_s is None else self.usual_settle_s
        given = self.model_fields_set
        return self.model_copy(
            update={
                "approach": self.approach.within(approach, f"{where}approach.")
                if "approach" in given
                else approach,
                "settle_s": self.settle_s if "settle_s" in given else usual,
                "settle_check": self.settle_check if "settle_check" in given else settle.check,
            }
        )

    @abstractmethod
    def visits_at(self, site: Site) -> list[BlockVisit]:
        """Return the visits of the block in a cell.

        Raises
        ------
        ConfigError
            The block asks for something that this cell cannot do.
        """


def rounded(joints_deg: Iterable[float]) -> Joints:
    """Round joint angles to the form in which they are sent and recorded."""
    return tuple(round(float(q), DECIMALS) for q in joints_deg)


Approach = ApproachTable

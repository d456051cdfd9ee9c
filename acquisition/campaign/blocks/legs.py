"""Blocks of `kind = "legs"`: a ballbar measures given legs at given poses, from given sides.

These are the check poses of a watch. If a calibrated model chose the poses, their legs lie within the stroke, and
there is no second stage. As for a hexapod, a person moves the bar, and the robot leaves when it is off.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, Strict, model_validator

from acquisition.campaign.blocks.block import ASide, Block, BlockVisit, Set, Side, Site
from acquisition.file_table import List, Rows, Text, no_default, refused, same_width, told
from drivers.errors import ConfigError

Leg = Annotated[tuple[Text, Text], Strict(False)]
SidesOfPoses = Annotated[
    List[List[Side]],
    AfterValidator(same_width),
    told(
        "From where each joint comes, 1 from below, -1 from above, one row a pose; left out: `approach` says it.",
        [[1, -1, 1, 1, -1, 1]],
        do=ASide,
        json_schema_extra=no_default,  # empty, which a file may not say
    ),
]


def refuse_other_shape(sides: tuple[tuple[int, ...], ...], poses: tuple[tuple[float, ...], ...]) -> None:
    """Raise the error of `refused` unless the given sides have one row per pose."""
    if sides and [len(row) for row in sides] != [len(row) for row in poses]:
        raise refused("approach_sides", "is not one row a pose.", ASide)


def refuse_unknown_legs(site: Site, rows: Iterable[Iterable[tuple[str, str]]]) -> None:
    """Refuse legs, per pose, of targets or balls that the cell does not have.

    Raises
    ------
    ConfigError
        The cell does not have one of them.
    """
    for target, base in (leg for legs in rows for leg in legs):
        if target not in site.cell.tool.targets or base not in site.cell.nests:
            raise ConfigError(
                f"block {site.number + 1}: the cell has no leg from {target!r} to {base!r}",
                what_to_do=f"Use the targets {', '.join(site.cell.tool.targets)} and the balls "
                f"{', '.join(site.cell.nests)}.",
            )


class LegsBlock(Block):
    """A block in which a ballbar measures given legs at given poses, as in a watch."""

    of_lengths: ClassVar[bool] = True

    kind: Annotated[Literal["legs"], told("The kind of block.", "legs")]
    set: Set = "calibration"
    joints_deg: Annotated[Rows, told("The poses, deg.", [[0.0, 20.0, 0.0, 0.0, 60.0, 0.0]])]
    legs: Annotated[
        List[List[Leg]],
        told(
            "Of every pose its legs: target and ball on the base.",
            [[["T1", "B1"], ["T2", "B1"]]],
            do="Give [['T1', 'B1'], ...] for every pose: target and ball on the base.",
        ),
    ]
    approach_sides: SidesOfPoses = ()

    @model_validator(mode="after")
    def _one_each(self) -> Self:
        if len(self.joints_deg) != len(self.legs):
            what = f"has {len(self.joints_deg)} poses for {len(self.legs)} rows of legs."
            raise refused("joints_deg", what, "Give one each.")
        refuse_other_shape(self.approach_sides, self.joints_deg)
        return self

    def visits_at(self, site: Site) -> list[BlockVisit]:
        refuse_unknown_legs(site, self.legs)
        sides = self.approach_sides or (site.sides(),) * len(self.legs)
        return [
            site.visit(f"pose {i}", site.posture(f"pose {i}", pose), side, legs)
            for i, (pose, side, legs) in enumerate(
                zip(self.joints_deg, sides, self.legs, strict=True), start=1
            )
        ]

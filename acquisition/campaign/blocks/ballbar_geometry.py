"""Blocks of `kind = "ballbar_geometry"`: the ballbar measures the triangles of the balls.

The robot takes no part. Every two balls of the tool, and every two of the base, between which a bar fits are a
reading (`cell.bars`). The tool triangle is measured with the 150 mm bar, the base triangle with the 300 mm bar.
They are measured at the place of the block in the campaign. A first block measures them before the legs; another block
at the end shows whether a cup has moved in the meantime. Readings of one bar follow one another.

With `touch_with = "T1"` a person jogs that ball of the tool into every cup between the two triangles
(`run.prompts.touches`). The three taught points and the three sides give the positions of the cups. Source: Nubiola,
thesis, section 4.2.
"""

from __future__ import annotations

from itertools import combinations
from typing import Annotated, ClassVar, Literal

from acquisition.campaign.blocks.block import Balls, Block, BlockVisit, Site
from acquisition.cell.cell import Cell, bar_between
from acquisition.file_table import Text, told
from drivers.errors import ConfigError


class BallbarGeometryBlock(Block):
    """A block that measures the sides of the triangles of tool targets and base balls.

    The robot takes no part.
    """

    of_lengths: ClassVar[bool] = True

    kind: Annotated[Literal["ballbar_geometry"], told("The kind of block.", "ballbar_geometry")]
    set: Annotated[Literal["calibration"], told("Such distances enter the fit.", "calibration")] = (
        "calibration"
    )
    base: Balls = None
    repeats: Annotated[int, told("Number of times each side is measured.", 2, ge=1, le=100)] = 1
    touch_with: Annotated[
        Text | None,
        told("A target that a person jogs into the cup of each ball; left out: none is touched.", "T1"),
    ] = None

    def visits_at(self, site: Site) -> list[BlockVisit]:
        cell, base = site.cell, self.base or tuple(site.cell.nests)
        for name in base:
            if name not in cell.nests:
                raise ConfigError(
                    f"block {site.number + 1}: base names {name!r}, none of {', '.join(cell.nests)}",
                    what_to_do="Name cups of world.nests of the cell.",
                )
        if self.touch_with is not None and self.touch_with not in cell.tool.targets:
            raise ConfigError(
                f"block {site.number + 1}: touch_with = {self.touch_with!r} is none of {', '.join(cell.tool.targets)}",
                what_to_do="Name a target of the tool of the cell.",
            )
        if self.touch_with is not None and (
            len(cell.nests) < 3 or not set(list(cell.nests)[:3]) <= set(base)
        ):
            raise ConfigError(
                f"block {site.number + 1}: touch_with needs the first three of {', '.join(cell.nests)} in its base",
                what_to_do="Add the missing cups to base.",
            )
        of_tool, of_base = self._spans(cell, site.targets), self._spans(cell, base)
        if not of_tool and not of_base and self.touch_with is None:
            raise ConfigError(
                f"block {site.number + 1}: no bar fits between two balls of {', '.join((*site.targets, *base))}",
                what_to_do="Check their positions in the cell file.",
            )
        if (ball := self.touch_with) is None:
            return self._measured([*of_tool, *of_base])
        touches = [BlockVisit(f"touch of {name} by {ball}", (), (), (), ((ball, name),)) for name in base]
        return [*self._measured(of_tool), *touches, *self._measured(of_base)]

    def _measured(self, spans: list[tuple[float, str, str]]) -> list[BlockVisit]:
        """Return one visit per distance, sorted by the bar that is needed."""
        lengths = list(dict.fromkeys(length for length, _, _ in spans))
        return [
            BlockVisit(f"distance {one} to {other}", (), (), (), ((one, other),))
            for _, one, other in sorted(spans, key=lambda span: lengths.index(span[0]))
            for _ in range(self.repeats)
        ]

    @staticmethod
    def _spans(cell: Cell, names: tuple[str, ...]) -> list[tuple[float, str, str]]:
        """Return the bar length, mm, and the two balls of every distance that can be measured."""
        found = [(bar_between(cell, *two), *two) for two in combinations(names, 2)]
        return [(bar.length_mm, one, other) for bar, one, other in found if bar is not None]

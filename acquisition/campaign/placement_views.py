"""Pictures of placements of the base balls: balls, arm and reached tool places.

The arm is in one pose. One row per placement, from above and from the side; the places of the tool by the branch of
shoulder and elbow.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acquisition.campaign.placements import HexapodSurvey, ReachResult
from acquisition.cell.picture import BASE, as_picture, views
from acquisition.cell.workspace import Array, targets_at
from calib.arm import BRANCHES

COLOURS = {"front/up": "#c2410c", "back/down": "#4c3ba8", "front/down": "#b9770e", "back/up": "#2f7d32"}


def placement_picture(hexapod: HexapodSurvey, reached: Sequence[ReachResult]) -> str:
    """Draw placements as SVG text."""
    rows = []
    for each in reached:
        cell = hexapod.moved(each.placement)
        balls = np.array([cell.nests[name] for name in hexapod.base])
        places = _places(hexapod, each)
        lines = np.zeros((0, 2, 3))
        if each.configurations:
            first = each.joints_deg[tuple(np.argwhere(each.there)[0])]
            lines = cell.clearance.arm.lines(first[None])[0]
        what = (
            f"shift {', '.join(f'{s:g}' for s in each.placement.shift_mm)} mm, turn {each.placement.turn_deg:g} deg: "
            f"{each.poses} poses"
        )
        named = ", ".join(f"{arm} {len(points)}" for arm, points in places.items())
        panels = views(cell, np.vstack([balls, *places.values(), *lines]))
        for panel, title in zip(
            panels, (f"{what}, from above", f"{named or 'none'}, from the side"), strict=True
        ):
            panel.title = title
            for ends, radius in zip(lines, cell.clearance.arm.radii, strict=False):
                panel.limb(ends, float(radius))
            panel.line(balls[:3], BASE, 1.2, shape="polygon")
            for arm, points in places.items():
                panel.dots(points, COLOURS[arm])
            for name, ball in zip(hexapod.base, balls, strict=True):
                panel.ball(ball, name, BASE)
        rows.append(panels)
    return as_picture(
        rows, "Placements of the base balls and the places of the tool that the arm reaches from them"
    )


def _places(hexapod: HexapodSurvey, reached: ReachResult) -> dict[str, Array]:
    """Return the middle of the tool balls, (k, 3) mm, by branch of shoulder and elbow.

    Branches that do not occur are left out.
    """
    which, branch = np.nonzero(reached.there)
    if not len(which):
        return {}
    middle = targets_at(hexapod.cell, reached.joints_deg[which, branch]).mean(axis=1)
    arms = np.array([BRANCHES[b].rpartition("/")[0] for b in branch])
    return {arm: middle[arms == arm] for arm in COLOURS if (arms == arm).any()}

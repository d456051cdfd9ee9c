"""Pictures of a cell with base balls as SVG text, from above and from the side.

The robot is on the left of the side view. Parallel projections, in the scale of the picture; the side view looks across
the line from the robot to the balls. Everything is drawn where the nominal robot and the cell file have it. Lengths mm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from acquisition.cell.cell import Cell
from acquisition.cell.workspace import Array, targets_at

INK, QUIET, LIMB, BASE, TOOL, NOW = "#1d2733", "#7a8794", "#b8c2cc", "#0f6b75", "#b9770e", "#c2410c"
_WIDTH, _HEIGHT, _MARGIN, _TITLE = 360.0, 300.0, 26.0, 18.0
_BALL = 5.0

Pair = tuple[str, str]


class CellView:
    """One view of a cell.

    Parameters
    ----------
    axes
        Directions to the right and upwards, shape (2, 3).
    shown
        Points that must be in the view, shape (n, 3).
    """

    def __init__(self, title: str, axes: Array, shown: Array) -> None:
        self.title, self._axes = title, axes
        flat = shown @ axes.T
        low, high = flat.min(axis=0), flat.max(axis=0)
        room = np.array([_WIDTH - 2 * _MARGIN, _HEIGHT - 2 * _MARGIN - _TITLE])
        self._scale = float(np.min(room / np.maximum(high - low, 1.0)))
        self._middle = 0.5 * (low + high)
        self._parts: list[str] = []

    def _at(self, points: Array) -> Array:
        """Project points (n, 3) to pixels (n, 2)."""
        flat = (np.atleast_2d(points) @ self._axes.T - self._middle) * self._scale
        return np.array([0.5 * _WIDTH, 0.5 * (_HEIGHT + _TITLE)]) + flat * [1.0, -1.0]

    def line(
        self, points: Array, colour: str, width: float, *, shape: str = "polyline", more: str = ""
    ) -> None:
        """Draw a line through points (n, 3), or a polygon."""
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in self._at(points))
        fill = f'fill="{colour}" fill-opacity="0.12"' if shape == "polygon" else 'fill="none"'
        self._parts.append(
            f'<{shape} points="{path}" {fill} stroke="{colour}" stroke-width="{width:.1f}" '
            f'stroke-linecap="round" stroke-linejoin="round"{more}/>'
        )

    def limb(self, ends: Array, radius_mm: float) -> None:
        """Draw a capsule of the arm with its thickness."""
        self.line(ends, LIMB, max(2.0 * radius_mm * self._scale, 2.0), more=' stroke-opacity="0.55"')

    def ball(self, place: Array, name: str, colour: str) -> None:
        """Draw a ball with its name."""
        ((x, y),) = self._at(place)
        self._parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{_BALL}" fill="{colour}"/>'
            f'<text x="{x + 7:.1f}" y="{y - 6:.1f}" font-size="12" fill="{INK}">{escape(name)}</text>'
        )

    def dots(self, points: Array, colour: str) -> None:
        """Draw small dots at points (n, 3)."""
        self._parts += [
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="1.6" fill="{colour}" fill-opacity="0.6"/>'
            for x, y in self._at(points)
        ]

    def svg(self, column: int, row: int) -> str:
        """Return the panel at its place in a picture."""
        return (
            f'<svg x="{column * _WIDTH:g}" y="{row * _HEIGHT:g}" width="{_WIDTH:g}" height="{_HEIGHT:g}">'
            f'<text x="8" y="14" font-size="12" fill="{QUIET}">{escape(self.title)}</text>'
            f"{''.join(self._parts)}</svg>"
        )


def as_picture(rows: Sequence[Sequence[CellView]], described: str) -> str:
    """Return the SVG of some panels, row by row."""
    width, height = _WIDTH * max(map(len, rows)), _HEIGHT * len(rows)
    parts = "".join(panel.svg(i, k) for k, row in enumerate(rows) for i, panel in enumerate(row))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}" '
        f'height="{height:g}" font-family="sans-serif" role="img"><title>{escape(described)}</title>'
        f'<rect width="100%" height="100%" fill="#fff"/>{parts}</svg>\n'
    )


def views(cell: Cell, shown: Array) -> list[CellView]:
    """Return the views from above and from the side.

    They have room for the points (n, 3) and the foot of the robot.
    """
    outwards = np.mean(list(cell.nests.values()), axis=0) * [1.0, 1.0, 0.0]
    far = float(np.linalg.norm(outwards))
    outwards = outwards / far if far > 1.0 else np.array([1.0, 0.0, 0.0])
    side = np.array([outwards, [0.0, 0.0, 1.0]])
    shown = np.vstack([shown, np.zeros((1, 3))])
    return [CellView("from above", np.eye(3)[:2], shown), CellView("from the side", side, shown)]


def scene(
    cell: Cell, joints_deg: Sequence[float] | None, legs: Sequence[Pair] = (), now: Pair | None = None
) -> str:
    """Draw the arm in a pose with its legs, base and tool triangle.

    Parameters
    ----------
    joints_deg
        The pose; None draws the balls alone.
    legs
        Pairs of a ball of the base and a ball of the tool.
    now
        The two balls about which a person is asked.
    """
    places: dict[str, Array] = {name: np.array(place) for name, place in cell.nests.items()}
    lines = np.zeros((0, 2, 3))
    if joints_deg is not None:
        joints = np.array([joints_deg])
        places |= dict(zip(cell.tool.targets, targets_at(cell, joints)[0], strict=True))
        lines = cell.clearance.arm.lines(joints)[0]
    elif now is not None and set(now) <= set(cell.tool.targets):
        places = {name: np.array(place) for name, place in cell.tool.targets.items()}
    panels = views(cell, np.vstack([*places.values(), *lines]))
    for panel in panels:
        for ends, radius in zip(lines, cell.clearance.arm.radii, strict=False):
            panel.limb(ends, float(radius))
        _triangles(panel, cell, places)
        for one, other in legs:
            panel.line(np.array([places[one], places[other]]), QUIET, 1.2)
        if now is not None and set(now) <= set(places):
            panel.line(np.array([places[name] for name in now]), NOW, 4.0)
        for name, place in places.items():
            panel.ball(place, name, NOW if now and name in now else BASE if name in cell.nests else TOOL)
    return as_picture([panels], f"{' to '.join(now)}" if now else cell.name)


def _triangles(panel: CellView, cell: Cell, places: Mapping[str, Array]) -> None:
    for names, colour in ((cell.nests, BASE), (cell.tool.targets, TOOL)):
        corners = [places[name] for name in list(names)[:3] if name in places]
        if len(corners) == 3:
            panel.line(np.array(corners), colour, 1.2, shape="polygon")

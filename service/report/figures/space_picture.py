"""Errors as arrows around the arm, before and after, as two SVG pictures of the same scale.

The frame is that of the robot's base; the arm stands in the measured posture that is nearest to the middle of all.
Lengths are in mm.
"""

from __future__ import annotations

import html
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib.arm import Robot
from calib.array import Array
from service.report.figures.arm_picture import body_of, eye_axes, line_of, skeleton_of
from service.report.figures.drawing import AFTER, GRID, QUIET

BEFORE = "#6d7780"
_EYE = eye_axes(-0.9, 0.35)
_WIDTH, _HEIGHT, _EDGE = 440.0, 225.0, 8.0
_LONGEST = 0.12  # of the cloud of places, which the longest arrow but the wildest takes
_HEAD, _DOT = 5.0, 2.0  # length of an arrow's head; a shorter arrow is a dot
_SQUARES = 6  # of the plane of the base
_FLOOR, _FILL = "#eef0f2", "#d3d9dd"


@dataclass(frozen=True)
class ErrorsInSpace:
    """Errors of two models at the same places.

    Attributes
    ----------
    joints : array of shape (n, N)
        Model joints of the readings.
    at, before, after : array of shape (n, 3)
        Places and errors, mm, base frame.
    """

    robot: Robot
    joints: Array
    at: Array
    before: Array
    after: Array

    @property
    def wanted_enlargement(self) -> float:
        """The enlargement with which the errors before are seen well."""
        usual = float(np.quantile(np.linalg.norm(self.before, axis=1), 0.95)) or 1.0
        return _LONGEST * float(np.max(np.ptp(self.at, axis=0))) / usual

    def pictures(self, times: float, described: tuple[str, str]) -> tuple[str, str]:
        """Draw the errors before and after, `times` enlarged; the descriptions are for screen readers."""
        middle = np.median(self.joints, axis=0)
        posture = self.joints[np.argmin(np.linalg.norm(self.joints - middle, axis=1))]
        body, radii = body_of(self.robot, posture)
        skeleton, _ = skeleton_of(self.robot, posture)
        arm = np.concatenate([skeleton, body.reshape(-1, 3)])
        paper = _Paper(np.concatenate([arm, self.at, self.at + times * self.before]), max(radii, default=0.0))
        still = [*_plane(paper, float(np.abs(arm[:, :2]).max()) + max(radii, default=0.0))]
        still += _arm(paper, body, radii, skeleton)
        one, other = (
            "\n".join(
                [
                    f'<svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" aria-label="{html.escape(words)}">',
                    *still,
                    _arrows(paper.places(self.at), paper.places(self.at + times * errors), colour),
                    "</svg>",
                ]
            )
            for words, errors, colour in zip(
                described, (self.before, self.after), (BEFORE, AFTER), strict=True
            )
        )
        return one, other


class _Paper:
    """A view in which places (n, 3), with a `margin` around them, mm, are seen whole."""

    def __init__(self, places: Array, margin: float) -> None:
        self._middle = np.zeros(3)
        seen = places @ _EYE.T
        size = np.ptp(seen, axis=0)[:2] + 2.0 * margin
        self.scale = float(np.min((np.array([_WIDTH, _HEIGHT]) - 2.0 * _EDGE) / np.maximum(size, 1e-6)))
        self._middle[:2] = (seen.max(axis=0) + seen.min(axis=0))[:2] / 2.0

    def places(self, places: Array) -> Array:
        """Return places (n, 3) in the picture: to the right, down, and towards the eye."""
        seen = (places @ _EYE.T - self._middle) * [self.scale, -self.scale, 1.0]
        return seen + np.array([_WIDTH / 2.0, _HEIGHT / 2.0, 0.0])


def _plane(paper: _Paper, reach: float) -> Iterator[str]:
    """Draw the plane of the base as a grid around the arm."""
    steps = np.linspace(-reach, reach, _SQUARES + 1)
    ends = np.array([[(a, -reach, 0.0), (a, reach, 0.0)] for a in steps])
    for lines in (ends, ends[:, :, [1, 0, 2]]):
        for line in lines:
            start, end = paper.places(line)
            yield line_of(start, end, f'stroke="{_FLOOR}" stroke-width="1.2"')


def _arm(paper: _Paper, body: Array, radii: list[float], skeleton: Array) -> Iterator[str]:
    """Draw the capsules of the arm, the nearest last; without a body its skeleton."""
    lines = body if len(body) else np.array(list(pairwise(skeleton)))
    widths = [2.0 * paper.scale * radius for radius in radii] if len(body) else [6.0] * len(lines)
    drawn = paper.places(lines.reshape(-1, 3)).reshape(-1, 2, 3)
    for number in np.argsort(drawn[:, :, 2].sum(axis=1)):
        (start, end), width = drawn[number], widths[number]
        yield line_of(start, end, f'stroke="{QUIET}" stroke-width="{width + 2:.1f}" stroke-linecap="round"')
        yield line_of(start, end, f'stroke="{_FILL}" stroke-width="{width:.1f}" stroke-linecap="round"')
        yield line_of(start, end, f'stroke="{GRID}" stroke-width="{width / 2:.1f}" stroke-linecap="round"')


def _arrows(start: Array, end: Array, colour: str) -> str:
    """Draw arrows between places of the picture (n, 3) as one path; those that are too short as dots."""
    along = (end - start)[:, :2]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    unit = along / np.maximum(length, 1e-9)
    back = end[:, :2] - np.minimum(_HEAD, 0.6 * length) * unit
    aside = 0.4 * np.minimum(_HEAD, 0.6 * length) * unit[:, ::-1] * [1.0, -1.0]
    rows = np.hstack([start[:, :2], end[:, :2], back + aside, back - aside, length])
    path = "".join(
        f"M{x:.1f} {y:.1f}h.01"
        if long < _DOT
        else f"M{x:.1f} {y:.1f}L{a:.1f} {b:.1f}M{c:.1f} {d:.1f}L{a:.1f} {b:.1f}L{e:.1f} {f:.1f}"
        for x, y, a, b, c, d, e, f, long in rows.tolist()
    )
    dots = "".join(f"M{x:.1f} {y:.1f}h.01" for x, y in start[:, :2].tolist())
    look = f'fill="none" stroke="{colour}" stroke-linecap="round"'
    return f'<path d="{dots}" {look} stroke-width="3.2"/><path d="{path}" {look} stroke-width="1.4"/>'

"""A picture of an arm from its robot file: oblique, from the front, from the side and from above, as one SVG file.

The body as capsules, every axis as a dashed line with the joint's number, the base frame with its letters. No library
is asked: it is lines and circles, and ids that could clash are not needed. Lengths mm; z up, x to the right in front.
"""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from calib.arm import Chain, Placement, Robot, nominal_values, propagate
from calib.array import Array
from calib.robot_file import axes_of
from service.report.figures.drawing import AFTER, FITTED, GRID, INK, NOMINAL, QUIET

# azimuth and elevation of the eye, rad, as on the operator's page
_VIEWS = {
    "oblique": (-0.9, 0.45),
    "from the front": (-np.pi / 2, 0.0),
    "from the side": (0.0, 0.0),
    "from above": (-np.pi / 2, np.pi / 2),
}
_SIZE, _EDGE, _HEAD = 380.0, 34.0, 26.0


def arm_svg(robot: Robot, joints: Array, title: str) -> str:
    """The arm at model joints (N,), rad or mm, as an SVG document."""
    frames = propagate(Chain.of(robot), nominal_values(robot, joints[None, :]), Placement())
    at = [tuple(np.broadcast_to(v, (3, 1))[:, 0] for v in frame) for frame in frames.link_frames]
    lines, radii = [], []
    for capsule in robot.body:
        x, y, z, p = at[capsule.link - 1]
        axes = np.stack([x, y, z], axis=1)
        lines.append([p + axes @ np.array(end) for end in (capsule.from_mm, capsule.to_mm)])
        radii.append(capsule.radius_mm)
    directions, points = axes_of(robot, joints)
    skeleton = np.array([np.zeros(3), *points, at[-1][3]])
    body = np.array(lines).reshape(-1, 2, 3)
    everything = np.concatenate([skeleton, body.reshape(-1, 3)])
    size = float(np.ptp(everything, axis=0).max()) + 2.0 * max(radii, default=0.0)
    scale = (_SIZE - 2.0 * _EDGE) / max(size, 1e-6)
    centre = (everything.min(axis=0) + everything.max(axis=0)) / 2.0
    height = 2.0 * (_SIZE + _HEAD) + _HEAD
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {2 * _SIZE:g} {height:g}" role="img" '
        f'aria-label="{html.escape(title, quote=True)}" font-family="sans-serif" font-size="13">',
        f'<rect width="100%" height="100%" fill="#fff"/><text x="12" y="18" fill="{INK}">{html.escape(title)}</text>',
    ]
    for number, (name, eye) in enumerate(_VIEWS.items()):
        across, down = (number % 2) * _SIZE, _HEAD + (number // 2) * (_SIZE + _HEAD)
        parts.append(f'<g transform="translate({across:g} {down:g})">')
        parts.append(f'<rect width="{_SIZE:g}" height="{_SIZE:g}" fill="none" stroke="{GRID}"/>')
        parts += _view(eye, scale, centre, body, radii, skeleton, directions)
        parts.append(f'<text x="10" y="{_SIZE + 17:g}" fill="{QUIET}">{name}</text></g>')
    parts.append(_bar(scale, height))
    return "\n".join([*parts, "</svg>"]) + "\n"


def _view(
    eye: tuple[float, float],
    scale: float,
    centre: Array,
    body: Array,
    radii: Sequence[float],
    skeleton: Array,
    directions: Array,
) -> Iterator[str]:
    turn = _turn(*eye)

    def paper(place: Array) -> Array:
        right, up, depth = (place - centre) @ turn.T
        return np.array([_SIZE / 2 + scale * right, _SIZE / 2 - scale * up, depth])

    shown = sorted(
        ((paper(a), paper(b), radius) for (a, b), radius in zip(body, radii, strict=True)),
        key=lambda each: each[0][2] + each[1][2],
    )
    for a, b, radius in shown:
        width = 2.0 * scale * radius
        yield _line(a, b, f'stroke="{QUIET}" stroke-width="{width + 2:.1f}" stroke-linecap="round"')
        yield _line(a, b, f'stroke="{GRID}" stroke-width="{width:.1f}" stroke-linecap="round"')
    for start, end in pairwise(skeleton):
        yield _line(paper(start), paper(end), f'stroke="{AFTER}" stroke-width="2.5" stroke-linecap="round"')
    reach = 42.0 / scale
    for axis, letter in zip(np.eye(3), "xyz", strict=True):
        end = paper(reach * axis)
        yield _line(paper(np.zeros(3)), end, f'stroke="{NOMINAL}" stroke-width="1.5"')
        yield f'<text x="{end[0] + 2:.1f}" y="{end[1]:.1f}" fill="{QUIET}" font-size="11">{letter}</text>'
    for number, (point, direction) in enumerate(zip(skeleton[1:-1], directions, strict=True), start=1):
        start, end = paper(point - 0.7 * reach * direction), paper(point + 0.7 * reach * direction)
        yield _line(start, end, f'stroke="{FITTED}" stroke-width="1.5" stroke-dasharray="5 3"')
        # Axes through one point would write over each other: each number a little farther out
        out = paper(point + (0.75 + 0.12 * (number % 3)) * reach * direction)
        yield f'<text x="{out[0]:.1f}" y="{out[1]:.1f}" fill="{FITTED}" font-size="12">{number}</text>'
    tip = paper(skeleton[-1])
    yield f'<circle cx="{tip[0]:.1f}" cy="{tip[1]:.1f}" r="4" fill="{AFTER}"/>'


def _turn(azimuth: float, elevation: float) -> Array:
    """(3, 3) rows: right, up and towards the eye."""
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    return np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])


def _line(a: Array, b: Array, look: str) -> str:
    # A line seen from its end has no length, and some viewers no round caps for it.
    return f'<line x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0] + 0.01:.2f}" y2="{b[1]:.1f}" {look}/>'


def _bar(scale: float, height: float) -> str:
    length = next(
        mm for mm in (5000, 2000, 1000, 500, 200, 100, 50, 20, 10, 5, 2, 1) if mm * scale < 200 or mm == 1
    )
    right, y = 2 * _SIZE - 12, height - 10
    return (
        f'<path d="M{right - length * scale:.1f} {y}H{right}" stroke="{INK}" stroke-width="2"/>'
        f'<text x="{right}" y="{y - 6}" text-anchor="end" fill="{INK}">{length} mm</text>'
    )

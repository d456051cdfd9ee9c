"""Picture of an arm from its robot file in four views as one SVG file.

The views are oblique, from the front, from the side and from above; z is up, and x to the right in front. The
body is drawn as capsules, every axis as a dashed line with the joint's number, and the base frame with its
letters. The length of every link, mm, is written once, in the view that shows it longest. Labels move aside
until they overlap no others. No library is used: the picture is lines and circles, and ids that could clash are
not needed.
"""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from itertools import pairwise, product

import numpy as np

from calib.arm import BasePoses, Chain, Robot, nominal_values, propagate
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
_LETTER, _LINE = 0.62, 1.1  # width and height of a letter, in sizes of its font
_LEAST = 20.0  # a link that is drawn shorter has no length written on it
_ASIDE = [
    (0.0, 0.0),
    *((r * np.cos(a), r * np.sin(a)) for r, a in product(range(6, 61, 6), np.arange(8) * np.pi / 4)),
]


def arm_svg(robot: Robot, joints: Array, title: str) -> str:
    """Draw the arm at model joints (N,), rad or mm, as an SVG document."""
    body, radii = body_of(robot, joints)
    directions, points = axes_of(robot, joints)
    skeleton, fixed = skeleton_of(robot, joints)
    written = _written(skeleton, fixed)
    everything = np.concatenate([skeleton, points, body.reshape(-1, 3)])
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
        here = [link for link, view in written.items() if view == number]
        parts += _view(eye, scale, centre, body, radii, skeleton, points, directions, here)
        parts.append(f'<text x="10" y="{_SIZE + 17:g}" fill="{QUIET}">{name}</text></g>')
    parts.append(_bar(scale, height))
    return "\n".join([*parts, "</svg>"]) + "\n"


def body_of(robot: Robot, joints: Array) -> tuple[Array, list[float]]:
    """Return the lines (c, 2, 3) and radii of the capsules at model joints (N,), mm, base frame."""
    frames = propagate(Chain.of(robot), nominal_values(robot, joints[None, :]), BasePoses())
    at = [tuple(np.broadcast_to(v, (3, 1))[:, 0] for v in frame) for frame in frames.link_frames]
    lines = []
    for capsule in robot.body:
        x, y, z, p = at[capsule.link - 1]
        axes = np.stack([x, y, z], axis=1)
        lines.append([p + axes @ np.array(end) for end in (capsule.from_mm, capsule.to_mm)])
    return np.array(lines).reshape(-1, 2, 3), [capsule.radius_mm for capsule in robot.body]


def skeleton_of(robot: Robot, joints: Array) -> tuple[Array, list[bool]]:
    """Trace a line from the base to the flange along every a and d of the robot file.

    Returns its corners (n + 1, 3), mm. For each of its n parts, also returns whether the file gives its length; it
    does not for a part along which a joint slides.
    """
    chain, values = Chain.of(robot), nominal_values(robot, joints[None, :])
    frames = propagate(chain, values, BasePoses())
    corners, fixed = [np.zeros(3)], []
    for slot in (motion.slot for link in (chain.base, *chain.links) for motion in link):
        length = np.broadcast_to(values.get(slot, 0.0), 1)[0]
        if not frames.turns[slot] and length != 0.0:
            corners.append(corners[-1] + length * np.broadcast_to(frames.axis[slot], (3, 1))[:, 0])
            fixed.append(slot not in robot.joint_slots)
    return np.array(corners), fixed


def _written(skeleton: Array, fixed: Sequence[bool]) -> dict[int, int]:
    """Choose for each line the view that has its length written on it.

    Lines are numbered from the base. It is the first of the views that show the line longest. A line whose length
    depends on a sliding joint has none.
    """
    lines = np.diff(skeleton, axis=0)
    seen = np.stack([np.linalg.norm(lines @ eye_axes(*eye)[:2].T, axis=1) for eye in _VIEWS.values()], axis=1)
    best = seen.max(axis=1)
    return {
        line: int(np.argmax(seen[line] > 0.999 * best[line])) for line in range(len(lines)) if fixed[line]
    }


class _Words:
    """Labels of one view that do not overlap."""

    def __init__(self) -> None:
        self._taken: list[tuple[float, float, float, float]] = []

    def put(self, x: float, y: float, words: str, size: float, look: str) -> str:
        """Place a text with its middle at x, y, or as little aside as is free."""
        wide, high = size * _LETTER * len(words) + 4.0, size * _LINE
        places = [(x + dx - wide / 2, y + dy - high / 2) for dx, dy in _ASIDE]
        left, top = next(((a, b) for a, b in places if self._free(a, b, wide, high)), places[0])
        self._taken.append((left, top, left + wide, top + high))
        at = f'x="{left + wide / 2:.1f}" y="{top + 0.8 * high:.1f}" text-anchor="middle"'
        halo = 'stroke="#fff" stroke-width="3" paint-order="stroke"'
        return f'<text {at} font-size="{size:g}" {halo} {look}>{words}</text>'

    def _free(self, left: float, top: float, wide: float, high: float) -> bool:
        if min(left, top) < 1.0 or max(left + wide, top + high) > _SIZE - 1.0:
            return False
        return all(
            left >= right or left + wide <= start or top >= low or top + high <= high_
            for start, high_, right, low in self._taken
        )


def _view(
    eye: tuple[float, float],
    scale: float,
    centre: Array,
    body: Array,
    radii: Sequence[float],
    skeleton: Array,
    points: Array,
    directions: Array,
    written: Sequence[int],
) -> Iterator[str]:
    """Draw one view; the links `written` have their lengths here."""
    turn = eye_axes(*eye)

    def paper(place: Array) -> Array:
        right, up, depth = (place - centre) @ turn.T
        return np.array([_SIZE / 2 + scale * right, _SIZE / 2 - scale * up, depth])

    shown = sorted(
        ((paper(a), paper(b), radius) for (a, b), radius in zip(body, radii, strict=True)),
        key=lambda each: each[0][2] + each[1][2],
    )
    for a, b, radius in shown:
        width = 2.0 * scale * radius
        yield line_of(a, b, f'stroke="{QUIET}" stroke-width="{width + 2:.1f}" stroke-linecap="round"')
        yield line_of(a, b, f'stroke="{GRID}" stroke-width="{width:.1f}" stroke-linecap="round"')
    for start, end in pairwise(skeleton):
        yield line_of(paper(start), paper(end), f'stroke="{AFTER}" stroke-width="2.5" stroke-linecap="round"')
    reach, words, base = 42.0 / scale, _Words(), []
    for axis, letter in zip(np.eye(3), "xyz", strict=True):
        end = paper(reach * axis)
        yield line_of(paper(np.zeros(3)), end, f'stroke="{NOMINAL}" stroke-width="1.5"')
        base.append(words.put(end[0] + 6.0, end[1], letter, 11.0, f'fill="{QUIET}"'))
    tip, said = paper(skeleton[-1]), []
    for number, (point, direction) in enumerate(zip(points, directions, strict=True), start=1):
        start, end = paper(point - 0.7 * reach * direction), paper(point + 0.7 * reach * direction)
        yield line_of(start, end, f'stroke="{FITTED}" stroke-width="1.5" stroke-dasharray="5 3"')
        out = paper(point + 0.85 * reach * direction)
        said.append(words.put(out[0], out[1], str(number), 12.0, f'fill="{FITTED}"'))
    for link in written:
        a, b = skeleton[link], skeleton[link + 1]
        start, end = paper(a), paper(b)
        if float(np.hypot(*(end - start)[:2])) < _LEAST:
            continue
        middle = (start + end) / 2.0
        length = float(np.linalg.norm(b - a))
        said.append(
            words.put(middle[0], middle[1], f"{length:.5g}", 11.0, f'fill="{AFTER}" font-weight="bold"')
        )
    yield f'<circle cx="{tip[0]:.1f}" cy="{tip[1]:.1f}" r="4" fill="{AFTER}"/>'
    yield from (*base, *said)  # no line crosses a word


def eye_axes(azimuth: float, elevation: float) -> Array:
    """Return the axes of a view as rows (3, 3): right, up and towards the eye."""
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    return np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])


def line_of(a: Array, b: Array, look: str) -> str:
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

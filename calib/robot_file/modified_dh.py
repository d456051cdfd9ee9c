"""Exact modified DH numbers of any serial chain, from its axes at the zero pose.

    FK(q) = base  Prod_k Rx(alpha_k) Tx(a_k) Rz(theta_k + q_k) Tz(d_k)  tool

z_k is axis k, x_k the common normal of axes k and k + 1. A normal that is not unique is chosen so that
numbers become small. For parallel axes it is the one through the normal before (d = 0), for axes that
coincide the direction before (theta = 0), and for axes that meet the sense that turns less. The frame
before the first link keeps the z of the base link, so that gravity in the base frame stays the same. The
last frame is at the point of axis N that is nearest to the tip.

Sources: Denavit, Hartenberg 1955 (common normals), Craig, chapter 3 (the frames).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.robot_file.serial_chain import SerialChain

PARALLEL = 1e-9  # sine of the angle between axes that count as parallel
_MEETING_MM = 1e-7
_BETTER = 1e-9  # rad


@dataclass(frozen=True)
class DhChain:
    """Modified DH numbers of a chain of N joints, and its constant frames.

    `alpha`, `a`, `theta`, `d` (N,) are in rad and mm. `base` and `tool` (4, 4), mm, are the frames
    before and behind the chain.
    """

    alpha: Array
    a: Array
    theta: Array
    d: Array
    base: Array
    tool: Array


@dataclass(frozen=True)
class _Normal:
    """The common normal of two axes.

    `foot` and `other` are its feet on both, `x` is its direction, `alpha` the angle about x and `a` the
    signed length.
    """

    foot: Array
    other: Array
    x: Array
    alpha: float
    a: float


def modified_dh(chain: SerialChain) -> DhChain:
    """Compute the modified DH numbers of a chain, and the constant frames before and behind."""
    points, axes, tip = _at_zero(chain)
    zs = [np.array([0.0, 0.0, 1.0]), *axes]
    # Axis 0 is the z of the base link, through its origin; at the end stands the tip.
    at, x = np.zeros(3), np.array([1.0, 0.0, 0.0])
    frames, normals = [], []
    for k, (z, following) in enumerate(zip(zs, [*zs[1:], None], strict=True)):
        if following is None:
            frames.append(_last(at, z, x, tip))
            break
        normal = _normal(at, z, x, _through(points, chain.slides, k, tip), following)
        frames.append(_frame(normal.foot, z, normal.x))
        normals.append(normal)
        at, x = normal.other, normal.x
    theta, d = np.zeros(len(axes)), np.zeros(len(axes))
    for k in range(len(axes)):
        before, after, z = normals[k], frames[k + 1], zs[k + 1]
        theta[k] = _angle(before.x, after[:3, 0], z)
        d[k] = float((after[:3, 3] - before.other) @ z)
    return DhChain(
        alpha=np.array([normal.alpha for normal in normals]),
        a=np.array([normal.a for normal in normals]),
        theta=theta,
        d=d,
        base=frames[0],
        tool=np.linalg.inv(frames[-1]) @ tip,
    )


def _at_zero(chain: SerialChain) -> tuple[list[Array], list[Array], Array]:
    """Compute points and directions of the axes, and the tip (4, 4), at the zero pose.

    They are in the base link.
    """
    pose, points, axes = np.eye(4), [], []
    for origin, axis in zip(chain.origins, chain.axes, strict=True):
        pose = pose @ origin
        points.append(pose[:3, 3])
        axes.append(_tidy(pose[:3, :3] @ axis))
    return points, axes, pose @ chain.tip


def _tidy(direction: Array) -> Array:
    """Remove rounding errors from a direction, and scale it to length 1."""
    out = np.where(np.abs(direction) < 1e-14, 0.0, direction)
    return out / np.linalg.norm(out)


def _through(points: list[Array], slides: Sequence[bool], k: int, tip: Array) -> Array:
    """Choose a point on axis k + 1.

    The position of a slide's axis is free: it goes through the part that the slide carries.
    """
    while k < len(points) and slides[k]:
        k += 1
    return points[k] if k < len(points) else tip[:3, 3]


def _normal(at: Array, z: Array, x: Array, point: Array, other: Array) -> _Normal:
    """Compute the common normal of two axes.

    The first axis passes through `at` along z, the second through `point` along `other`.
    """
    across = np.cross(z, other)
    sine, span = float(np.linalg.norm(across)), point - at
    if sine <= PARALLEL:
        foot, span = at, span - (span @ z) * z
        end = foot + span
        a = float(np.linalg.norm(span))
        direction = span / a if a > _MEETING_MM else x
        a = a if a > _MEETING_MM else 0.0
    else:
        direction = across / sine
        a = float(span @ direction)
        foot = at + float(np.cross(span, other) @ across) / sine**2 * z
        end = point + float(np.cross(span, z) @ across) / sine**2 * other
        a = a if abs(a) > _MEETING_MM else 0.0
    direction = _tidy(direction)
    # Both senses describe the same normal: the one that turns less from the direction before.
    if abs(_angle(x, -direction, z)) < abs(_angle(x, direction, z)) - _BETTER:
        direction, a = -direction, -a
    return _Normal(foot, end, direction, _angle(z, other, direction), a)


def _angle(one: Array, other: Array, about: Array) -> float:
    """Angle, rad in (-pi, pi], from one direction to another about an axis square to both."""
    sine, cosine = float(np.cross(one, other) @ about), float(one @ other)
    return float(np.arctan2(0.0 if abs(sine) < 1e-15 else sine, cosine))


def _last(at: Array, z: Array, x: Array, tip: Array) -> Array:
    """Compute the frame on the last axis.

    Its origin is nearest to the tip. Its x points along the tip's if that is square to the axis.
    """
    along = tip[:3, 0] - (tip[:3, 0] @ z) * z
    parallel = float(np.linalg.norm(np.cross(z, tip[:3, 2]))) <= 1e-9
    direction = along / np.linalg.norm(along) if parallel else x
    return _frame(at + float((tip[:3, 3] - at) @ z) * z, z, direction)


def _frame(origin: Array, z: Array, x: Array) -> Array:
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = x, np.cross(z, x), z, origin
    return pose

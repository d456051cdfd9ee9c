"""Forward kinematics, link by link.

Modified DH (Craig):  A_i = Rx(alpha) Ry(beta) Tx(a) Rz(theta) Tz(d)
Standard DH:          A_i = Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)
beta is Hayati's rotation, needed because nearly parallel axes have no stable common normal.

The base of the modified-DH robots follows equation (I.2) of Nubiola's thesis: d_1 stands before the base
rotations,  T(x_b, y_b, z_b + d_1) Rx Ry Rz(gamma_b + theta_1).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mocks.world.robots import Robot
from mocks.world.transforms import Matrix, Vector, rx, ry, rz, shift, turn


@dataclass
class Geometry:
    """The DH numbers of one arm (rad, mm) and its base in the world.

    `theta` is without the joint angle. `base_mm` and `base_rad` are x, y, z and the angles of Rx Ry Rz. `slides`
    marks the sliding joints. Index 0 is link 1.
    """

    alpha: list[float]
    a: list[float]
    theta: list[float]
    d: list[float]
    beta: list[float]
    slides: tuple[bool, ...]
    base_mm: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    base_rad: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])

    def copy(self) -> Geometry:
        """Return a copy whose lists may be changed."""
        return Geometry(
            list(self.alpha),
            list(self.a),
            list(self.theta),
            list(self.d),
            list(self.beta),
            self.slides,
            list(self.base_mm),
            list(self.base_rad),
        )


def nominal_geometry(robot: Robot) -> Geometry:
    """Return the DH numbers of the maker's drawing in rad and mm, base at the world's origin."""
    return Geometry(
        alpha=[math.radians(link.alpha_deg) for link in robot.links],
        a=[link.a_mm for link in robot.links],
        theta=[math.radians(link.theta_deg) for link in robot.links],
        d=[link.d_mm for link in robot.links],
        beta=[0.0] * len(robot.links),
        slides=robot.sliding,
    )


def link_transform(convention: str, alpha: float, beta: float, a: float, theta: float, d: float) -> Matrix:
    """Return one link, (4, 4), as the product of its elementary motions (rad, mm).

    Without beta it is written out: every element is one product then, and a campaign has tens of thousands of links.
    """
    if beta == 0.0:
        c, s, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
        if convention == "mdh":
            rows = [[c, -s, 0.0, a], [ca * s, ca * c, -sa, -sa * d], [sa * s, sa * c, ca, ca * d]]
        else:
            rows = [[c, -s * ca, s * sa, c * a], [s, c * ca, -c * sa, s * a], [0.0, sa, ca, d]]
        return np.array([*rows, [0.0, 0.0, 0.0, 1.0]])
    fixed = rx(alpha) @ ry(beta)
    moving = rz(theta)
    moving[2, 3] = d  # Rz Tz: the shift along z is untouched by the rotation about z
    if convention == "mdh":
        fixed[:3, 3] = a * fixed[:3, 0]  # R Tx(a): a mm along the rotated x axis
        return fixed @ moving
    fixed[0, 3] = a  # Tx Rx Ry: the shift comes before the rotations
    return moving @ fixed


def foot(convention: str, geometry: Geometry, lean: Sequence[float] | Vector | None = None) -> Matrix:
    """Return frame 0 in the world, (4, 4).

    `lean` is a rotation vector (rad) of a soft pedestal about the foot.
    """
    x, y, z = geometry.base_mm
    frame = shift(x, y, z)
    if lean is not None:
        frame = frame @ turn(lean)
    if convention == "mdh":
        frame = frame @ shift(0.0, 0.0, geometry.d[0])  # (I.2): d_1 before the rotations
    a, b, c = geometry.base_rad
    return frame @ rx(a) @ ry(b) @ rz(c)


def frames(
    convention: str,
    geometry: Geometry,
    joints: Sequence[float],
    lean: Sequence[float] | Vector | None = None,
    tilts: Mapping[int, Sequence[float] | Vector] | None = None,
) -> list[Matrix]:
    """Compute frames 0..N in the world, each (4, 4), at `joints` (N,) rad, mm for sliding ones.

    `tilts` maps a joint number K to a rotation vector (rad, in the frame that carries axis K). The bearing yields
    by this rotation about the origin of that frame, which is frame K in modified DH and frame K-1 in standard DH.
    """
    tilts = tilts or {}
    chain = [foot(convention, geometry, lean)]
    for i, moved in enumerate(joints):
        joint = i + 1
        if convention == "dh" and joint in tilts:
            chain[-1] = chain[-1] @ turn(tilts[joint])
        d = 0.0 if convention == "mdh" and i == 0 else geometry.d[i]  # d_1 is already in the foot
        theta = geometry.theta[i]
        if geometry.slides[i]:
            d += moved
        else:
            theta += moved
        step = link_transform(convention, geometry.alpha[i], geometry.beta[i], geometry.a[i], theta, d)
        chain.append(chain[-1] @ step)
        if convention == "mdh" and joint in tilts:
            chain[-1] = chain[-1] @ turn(tilts[joint])
    return chain


def axis_frame(convention: str, chain: list[Matrix], joint: int) -> Matrix:
    """Return the frame whose z is the axis of a joint K (1-based).

    It is frame K in modified DH, and frame K-1 in standard DH.
    """
    return chain[joint] if convention == "mdh" else chain[joint - 1]

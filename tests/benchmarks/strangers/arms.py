"""Arms used only in these benchmarks, and their kinematics as matrices over all poses.

Two arms are in the library and are read here independently from their tables; the others are made up. Angles are in
rad, lengths in mm, forces in N; a pose is a row of joints (n, N).
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib.arm.robot import BUILT_IN

Array = NDArray[np.float64]
DOWN = np.array([0.0, 0.0, -9.81])
LIBRARY = ("ur5e", "doosan-m1013")


@dataclass(frozen=True)
class Weight:
    """A mass that hangs on a link, 1-based: kg, and its centre in the frame of the link, mm."""

    link: int
    mass: float
    centre: tuple[float, float, float]


@dataclass(frozen=True)
class Arm:
    """Table of an arm: (N, 6) alpha, a, theta, d and both limits of every joint; rad and mm.

    `craig` selects the modified table. `slides` lists the sliding joints. `twisted` lists the links with an axis
    that may lean against the other one. That axis is at the start of the link (Craig) or at its end.
    """

    name: str
    craig: bool
    table: Array
    twisted: tuple[int, ...]
    weights: tuple[Weight, ...]
    slides: tuple[int, ...] = ()
    text: str = ""  # of its robot file; empty: it is in the library

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.table)

    @cached_property
    def reach(self) -> float:
        """Sum of its lengths, mm."""
        return float(np.sum(np.hypot(self.table[:, 1], self.table[:, 3])))

    @cached_property
    def unit(self) -> Array:
        """Unit of each joint in the files, (N,): deg in rad, or mm."""
        return np.array([1.0 if k + 1 in self.slides else math.radians(1.0) for k in range(self.joints)])

    def usual(self, joints: Array) -> Array:
        """Return joints (n, N) as angles; the whole travel of a slide counts as half a turn."""
        scale = np.ones(self.joints)
        for k in self.slides:
            scale[k - 1] = math.pi / (self.table[k - 1, 5] - self.table[k - 1, 4])
        return joints * scale

    def off(self, wrong: Array, lean: Array) -> Arm:
        """Return the arm with errors added to its table.

        `wrong` (N, 4) is added to the table. `lean` (N,) turns the axes that may lean about y.
        """
        table = self.table.copy()
        table[:, :4] += wrong
        return replace(self, table=np.column_stack([table, lean]))

    def frames(self, joints: Array) -> Array:
        """Compute the frames of the base and of every link, (N + 1, n, 4, 4)."""
        frame = np.broadcast_to(np.eye(4), (len(joints), 4, 4))
        out = [frame]
        for k, row in enumerate(self.table):
            alpha, a, theta, d = row[:4]
            lean = row[6] if len(row) > 6 else 0.0
            slid = k + 1 in self.slides
            turn = screw(2, theta + (0.0 if slid else joints[:, k]), d + (joints[:, k] if slid else 0.0))
            twist = screw(0, alpha, a)
            if self.craig:
                twist = screw(0, alpha, 0.0) @ screw(1, lean, 0.0) @ screw(0, 0.0, a)
                frame = frame @ twist @ turn
            else:
                frame = frame @ turn @ twist @ screw(1, lean, 0.0)
            out.append(frame)
        return np.array(out)

    def pulls(self, joints: Array) -> tuple[Array, Array]:
        """Compute the gravity moment about every joint origin, N.mm, and the joint axes.

        Both have shape (n, N, 3).
        """
        frames = self.frames(joints)
        moment = np.zeros((len(joints), self.joints, 3))
        at = frames[1:] if self.craig else frames[:-1]
        for weight in self.weights:
            centre = (frames[weight.link] @ np.array([*weight.centre, 1.0]))[:, :3]
            for k in range(weight.link):
                moment[:, k] += np.cross(centre - at[k][:, :3, 3], weight.mass * DOWN)
        return moment, np.moveaxis(at[:, :, :3, 2], 0, 1)

    def torques(self, joints: Array) -> Array:
        """Compute the gravity torque about every joint, (n, N), N.mm."""
        moment, axis = self.pulls(joints)
        return np.sum(moment * axis, axis=2)


def screw(axis: int, angle: Array | float, along: Array | float) -> Array:
    """Return a turn about x, y or z with a shift along it, (4, 4) or (n, 4, 4)."""
    angle, along = np.broadcast_arrays(angle, along)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    out = np.broadcast_to(np.eye(4), (*angle.shape, 4, 4)).copy()
    out[..., i, i] = out[..., j, j] = np.cos(angle)
    out[..., j, i] = np.sin(angle)
    out[..., i, j] = -out[..., j, i]
    out[..., axis, 3] = along
    return out


def own_arm(
    name: str,
    convention: str,
    rows: Sequence[tuple[float, float, float, float, float, float]],
    parallel: tuple[int, ...],
    weights: tuple[Weight, ...],
    slides: tuple[int, ...] = (),
) -> Arm:
    """Build an arm and the text of its robot file from rows of its table.

    A row holds alpha deg, a mm, theta deg, d mm and both limits. `parallel` lists the axes that are meant to be
    parallel to the one before.
    """
    lines = [f'format = "truepose-robot/1"\nname = "{name}"\nmaker = "nobody"\nconvention = "{convention}"']
    lines.append(f'parallel_axes = {list(parallel)}\nsource = "made up"')
    for k, (alpha, a, theta, d, low, high) in enumerate(rows, start=1):
        unit = "mm" if k in slides else "deg"
        lines.append(f"[[link]]\nalpha_deg = {alpha}\na_mm = {a}\ntheta_deg = {theta}\nd_mm = {d}")
        lines.append(
            f"min_{unit} = {low}\nmax_{unit} = {high}" + ('\njoint = "slides"' if k in slides else "")
        )
    lines += [f"[[loads]]\nlink = {w.link}\nmass_kg = {w.mass}\ncog_mm = {list(w.centre)}" for w in weights]
    table = np.array(rows, dtype=np.float64)
    table[:, (0, 2)] = np.radians(table[:, (0, 2)])
    turning = [k - 1 for k in range(1, len(rows) + 1) if k not in slides]
    table[turning, 4:] = np.radians(table[turning, 4:])
    craig = convention == "mdh"
    return Arm(name, craig, table, leaning(craig, parallel), weights, slides, "\n".join(lines) + "\n")


def leaning(craig: bool, parallel: Sequence[int]) -> tuple[int, ...]:
    """List the links whose axis may lean, from the numbers of parallel axes.

    The link begins with the axis (Craig) or ends with it.
    """
    return tuple(k if craig else k - 1 for k in parallel)


def library_arm(name: str) -> Arm:
    """An arm of the library, from its table."""
    told = tomllib.loads((BUILT_IN / f"{name}.toml").read_text(encoding="utf-8"))
    keys = ("alpha_deg", "a_mm", "theta_deg", "d_mm", "min_deg", "max_deg")
    table = np.array([[link[key] for key in keys] for link in told["link"]])
    table[:, (0, 2, 4, 5)] = np.radians(table[:, (0, 2, 4, 5)])
    weights = tuple(Weight(w["link"], w["mass_kg"], tuple(w["cog_mm"])) for w in told.get("loads", ()))
    craig = told["convention"] == "mdh"
    return Arm(name, craig, table, leaning(craig, told["parallel_axes"]), weights)


TALL = own_arm(
    "tall",
    "mdh",
    [
        (0.0, 0.0, 0.0, 780.0, -170.0, 170.0),
        (-90.0, 320.0, -90.0, 0.0, -60.0, 80.0),
        (0.0, 1150.0, 0.0, 0.0, -120.0, 60.0),
        (-90.0, 200.0, 0.0, 1180.0, -180.0, 180.0),
        (90.0, 0.0, 0.0, 0.0, -115.0, 115.0),
        (-90.0, 0.0, 0.0, 215.0, -180.0, 180.0),
    ],
    (3,),
    (
        Weight(2, 210.0, (520.0, 0.0, 120.0)),
        Weight(3, 160.0, (150.0, 60.0, -40.0)),
        Weight(4, 70.0, (0.0, 0.0, -420.0)),
        Weight(6, 45.0, (70.0, -40.0, 130.0)),
    ),
)
TABLETOP = own_arm(
    "tabletop",
    "dh",
    [
        (-90.0, 30.0, 0.0, 190.0, -160.0, 160.0),
        (0.0, 230.0, -90.0, 0.0, -70.0, 95.0),
        (-90.0, 40.0, 0.0, 0.0, -100.0, 60.0),
        (90.0, 0.0, 0.0, 215.0, -170.0, 170.0),
        (-90.0, 0.0, 0.0, 0.0, -110.0, 110.0),
        (0.0, 0.0, 0.0, 65.0, -180.0, 180.0),
    ],
    (3,),
    (
        Weight(2, 3.1, (-110.0, 0.0, 20.0)),
        Weight(3, 1.9, (0.0, 15.0, 30.0)),
        Weight(5, 1.4, (0.0, 20.0, 10.0)),
        Weight(6, 1.1, (25.0, -15.0, 40.0)),
    ),
)
REDUNDANT = own_arm(
    "redundant",
    "mdh",
    [
        (0.0, 0.0, 0.0, 333.0, -160.0, 160.0),
        (-90.0, 0.0, 0.0, 0.0, -100.0, 100.0),
        (90.0, 0.0, 0.0, 316.0, -160.0, 160.0),
        (90.0, 82.0, 0.0, 0.0, -170.0, -10.0),
        (-90.0, -82.0, 0.0, 384.0, -160.0, 160.0),
        (90.0, 0.0, 0.0, 0.0, 0.0, 210.0),
        (90.0, 88.0, 0.0, 107.0, -160.0, 160.0),
    ],
    (),
    (
        Weight(2, 3.0, (0.0, -40.0, 30.0)),
        Weight(3, 3.2, (30.0, 0.0, -60.0)),
        Weight(5, 2.4, (0.0, 35.0, -110.0)),
        Weight(7, 2.2, (20.0, -30.0, 60.0)),
    ),
)
FLAT = own_arm(
    "flat",
    "mdh",
    [
        (0.0, 0.0, 0.0, 260.0, -125.0, 125.0),
        (0.0, 410.0, 0.0, 0.0, -140.0, 140.0),
        (0.0, 260.0, 0.0, 40.0, -180.0, 0.0),
        (0.0, 0.0, 0.0, 0.0, -180.0, 180.0),
    ],
    (2, 3, 4),
    (Weight(3, 2.0, (0.0, 0.0, 50.0)), Weight(4, 2.5, (15.0, 10.0, 20.0))),
    (3,),
)


def arms() -> tuple[Arm, ...]:
    """Return every arm of these benchmarks."""
    return (*(library_arm(name) for name in LIBRARY), TALL, TABLETOP, REDUNDANT, FLAT)

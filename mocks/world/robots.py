"""The four robots of the simulated cell as plain data: links, limits, loads, ranges.

This is the simulator's own copy, on purpose. A wrong digit in the identifier's robot file must show as a
misfit, and must not hide because both sides read the same file.

Kinematics of the IRB 120 and the LR Mate are from A. Nubiola, thesis ETS Montreal, Annex I (modified DH,
Craig). Those of UR5 and UR10 are from M. Khanesar, S. Piano, D. Branson, ICINCO 2022, and the maker's values
(standard DH). Loads are the masses of the thesis (triangular tool 2.7 kg and 2.6 kg). For the URs they are from
the maker's published table "DH parameters for calculations of kinematics and dynamics" (mass and centre of mass
of every link). Lengths are in mm, angles in deg, masses in kg, compliances in rad/(N.mm).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Link:
    """One row of the DH table. A joint that turns adds to `theta_deg`, one that slides to `d_mm`."""

    alpha_deg: float
    a_mm: float
    theta_deg: float
    d_mm: float
    slides: bool = False


@dataclass(frozen=True)
class Load:
    """A mass that rides on `link` (1-based), its centre `cog_mm` given in that link's frame."""

    link: int
    mass_kg: float
    cog_mm: tuple[float, float, float]


Matrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Counting:
    """The way a controller counts joints: model joint = matrix @ counted + offset.

    Values are in deg, and in mm for sliding joints.
    """

    matrix: Matrix = ()
    offset: tuple[float, ...] = ()

    def to_model(self, counted: Sequence[float]) -> tuple[float, ...]:
        """Return the joints of the model for those of the controller."""
        if not self.matrix:
            return tuple(counted)
        found = np.array(self.matrix) @ np.array(counted) + np.array(self.offset or 0.0)
        return tuple(float(q) for q in found)

    def counted(self, model: Sequence[float]) -> tuple[float, ...]:
        """Return the joints of the controller for those of the model."""
        if not self.matrix:
            return tuple(model)
        found = np.linalg.solve(np.array(self.matrix), np.array(model) - np.array(self.offset or 0.0))
        return tuple(float(q) + 0.0 for q in found)  # no -0.0


@dataclass(frozen=True)
class Robot:
    """A nominal robot.

    Attributes
    ----------
    convention : str
        "mdh" (Rx Tx Rz Tz) or "dh" (Rz Tz Tx Rx).
    limits_deg : tuple of pairs of float
        Joint limits as the controller counts, mm for a sliding joint.
    range_deg : tuple of pairs of float
        Narrower ranges of the model's joints in which poses are drawn (for the IRB 120 those of the thesis, section
        2.5.2), mm for a sliding joint.
    compliance : tuple of float
        c_1..c_N in rad/(N.mm) around which the true compliances are drawn.
    carries_tool : bool
        Whether the last of the loads is the tool.
    twisted : tuple of int
        Links whose axis is meant to be parallel to the next and is not.
    axes : tuple of str
        Names of the joints in labels, if they are not j1, j2, ...
    shown : str
        Name that its controller has for the robot.
    """

    name: str
    convention: str
    links: tuple[Link, ...]
    loads: tuple[Load, ...]
    limits_deg: tuple[tuple[float, float], ...]
    range_deg: tuple[tuple[float, float], ...]
    compliance: tuple[float, ...]
    carries_tool: bool
    twisted: tuple[int, ...]
    counting: Counting = Counting()
    axes: tuple[str, ...] = ()
    shown: str = ""

    def internal(self, joints: Sequence[float]) -> list[float]:
        """Convert joints (N,) from deg or mm to rad or mm."""
        return [q if link.slides else math.radians(q) for q, link in zip(joints, self.links, strict=True)]

    def outside(self, joints: Sequence[float]) -> list[float]:
        """Convert joints (N,) from rad or mm to deg or mm."""
        return [q if link.slides else math.degrees(q) for q, link in zip(joints, self.links, strict=True)]

    @property
    def sliding(self) -> tuple[bool, ...]:
        """Mask of the sliding joints, (N,)."""
        return tuple(link.slides for link in self.links)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints in labels, (N,)."""
        return self.axes or tuple(f"j{k}" for k in range(1, len(self.links) + 1))


# Identified c_2..c_6 of the thesis's IRB 120 (Table 2.6), rad/(N.mm); gravity never loads joint 1.
THESIS_COMPLIANCE = (0.0, 0.032e-6, 0.130e-6, 0.605e-6, 0.419e-6, 0.647e-6)

# The UR10's links weigh three times the IRB 120's on gears of larger size. The thesis's figures times 0.3
# keep its nominal error at the few millimetres seen on real arms; a choice of this simulator.
UR10_COMPLIANCE = tuple(0.3 * c for c in THESIS_COMPLIANCE)

# SMR nests of the thesis's triangular tool, mm in the flange frame.
TRIANGULAR_TARGETS = {
    "T1": (0.0, 0.0, 125.0),
    "T2": (75.0, 93.675, 215.0),
    "T3": (150.0, 0.0, 125.0),
}

THESIS_RANGE = ((-90.0, 90.0), (0.0, 110.0), (-80.0, 70.0), (-150.0, 150.0), (-90.0, 90.0), (-180.0, 180.0))
UR_RANGE = ((-180.0, 180.0), (-150.0, -30.0), (-120.0, 120.0)) + ((-180.0, 180.0),) * 3

IRB120 = Robot(
    name="abb-irb120",
    shown="IRB 120-3/0.6",
    convention="mdh",
    links=(
        Link(0.0, 0.0, 0.0, 290.0),
        Link(-90.0, 0.0, -90.0, 0.0),
        Link(0.0, 270.0, 0.0, 0.0),
        Link(-90.0, 70.0, 0.0, 302.0),
        Link(90.0, 0.0, 0.0, 0.0),
        Link(-90.0, 0.0, 180.0, 72.0),
    ),
    loads=(
        Load(2, 4.2, (140.0, 0.0, 0.0)),
        Load(4, 5.0, (0.0, 0.0, -193.6)),
        Load(6, 2.7, (50.0, 25.0, 100.0)),
    ),
    limits_deg=(
        (-165.0, 165.0),
        (-110.0, 110.0),
        (-110.0, 70.0),
        (-160.0, 160.0),
        (-120.0, 120.0),
        (-400.0, 400.0),
    ),
    range_deg=THESIS_RANGE,
    compliance=THESIS_COMPLIANCE,
    carries_tool=True,
    twisted=(3,),
)

# A Fanuc counts joint 3 from the horizontal and joints 4 to 6 the other way round.
FANUC_COUNTS = (
    (1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (0.0, 1.0, 0.0, 0.0, 0.0, 0.0),
    (0.0, -1.0, -1.0, 0.0, 0.0, 0.0),
    (0.0, 0.0, 0.0, -1.0, 0.0, 0.0),
    (0.0, 0.0, 0.0, 0.0, -1.0, 0.0),
    (0.0, 0.0, 0.0, 0.0, 0.0, -1.0),
)

LRMATE200IC = Robot(
    name="fanuc-lrmate200ic",
    shown="LR Mate 200iC",
    convention="mdh",
    links=(
        Link(0.0, 0.0, 0.0, 330.0),
        Link(-90.0, 75.0, -90.0, 0.0),
        Link(0.0, 300.0, 0.0, 0.0),
        Link(-90.0, 75.0, 0.0, 320.0),
        Link(90.0, 0.0, 0.0, 0.0),
        Link(-90.0, 0.0, 0.0, 80.0),
    ),
    loads=(
        Load(2, 10.0, (150.0, 0.0, 0.0)),
        Load(4, 10.0, (0.0, 0.0, -160.0)),
        Load(6, 2.6, (50.0, 25.0, 100.0)),
    ),
    # As the controller counts them: joint 3 to the horizontal
    limits_deg=(
        (-170.0, 170.0),
        (-60.0, 140.0),
        (-142.0, 230.0),
        (-190.0, 190.0),
        (-120.0, 120.0),
        (-360.0, 360.0),
    ),
    range_deg=THESIS_RANGE,
    compliance=THESIS_COMPLIANCE,
    carries_tool=True,
    twisted=(3,),
    counting=Counting(FANUC_COUNTS),
)

UR5 = Robot(
    name="ur5",
    convention="dh",
    links=(
        Link(90.0, 0.0, 0.0, 89.16),
        Link(0.0, -425.0, 0.0, 0.0),
        Link(0.0, -392.0, 0.0, 0.0),
        Link(90.0, 0.0, 0.0, 109.2),
        Link(-90.0, 0.0, 0.0, 94.7),
        Link(0.0, 0.0, 0.0, 82.3),
    ),
    loads=(
        Load(1, 3.7, (0.0, -25.61, 1.93)),
        Load(2, 8.393, (212.5, 0.0, 113.36)),
        Load(3, 2.33, (150.0, 0.0, 26.5)),
        Load(4, 1.219, (0.0, -1.8, 16.34)),
        Load(5, 1.219, (0.0, 1.8, 16.34)),
        Load(6, 0.1879, (0.0, 0.0, -1.159)),
    ),
    limits_deg=((-360.0, 360.0),) * 6,
    range_deg=UR_RANGE,
    compliance=THESIS_COMPLIANCE,
    carries_tool=False,
    twisted=(2, 3),
)

UR10 = Robot(
    name="ur10",
    convention="dh",
    links=(
        Link(90.0, 0.0, 0.0, 127.3),
        Link(0.0, -612.0, 0.0, 0.0),
        Link(0.0, -572.3, 0.0, 0.0),
        Link(90.0, 0.0, 0.0, 163.941),
        Link(-90.0, 0.0, 0.0, 115.7),
        Link(0.0, 0.0, 0.0, 92.2),
    ),
    loads=(
        Load(1, 7.778, (21.0, 0.0, 27.0)),
        Load(2, 12.93, (380.0, 0.0, 158.0)),
        Load(3, 3.87, (240.0, 0.0, 68.0)),
        Load(4, 1.96, (0.0, 7.0, 18.0)),
        Load(5, 1.96, (0.0, 7.0, 18.0)),
        Load(6, 0.202, (0.0, 0.0, -26.0)),
    ),
    limits_deg=((-360.0, 360.0),) * 6,
    range_deg=UR_RANGE,
    compliance=UR10_COMPLIANCE,
    carries_tool=False,
    twisted=(2, 3),
)

ROBOTS = {robot.name: robot for robot in (IRB120, LRMATE200IC, UR5, UR10)}


def robot_named(name: str) -> Robot:
    """Return the robot called `name`.

    Raises
    ------
    ValueError
        There is no such robot; the message lists the known names.
    """
    if name not in ROBOTS:
        raise ValueError(f"robot {name!r} is not one of {sorted(ROBOTS)}")
    return ROBOTS[name]

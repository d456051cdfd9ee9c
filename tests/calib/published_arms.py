"""Published descriptions of the built-in arms as chains: a second copy of every number.

A chain consists of shifts, turns and axes. A joint is a shift in mm, a turn (roll, pitch, yaw in deg, about fixed
axes) and the axis about which it turns or along which it slides. All are in the frame of the joints before it.
Sources: those of the robot files. Angles and slides are those of the description, which are the controller's except
for `with_j2`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from calib.array import Array

Triple = tuple[float, float, float]
Joint = tuple[Triple, Triple, str]
NO = (0.0, 0.0, 0.0)
AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}


@dataclass(frozen=True)
class Published:
    """Arm according to its published description.

    Attributes
    ----------
    flange
        Shift and turn behind the last joint.
    coupling
        Coupling of the robot file, for angles that the controller counted.
    with_j2
        Share of joint 2 that the description adds to the controller's joint 3.
    slides
        Joints that slide.
    masses
        Mass, kg, and centre of every link, mm, in the frame of its joint.
    """

    joints: tuple[Joint, ...]
    flange: tuple[Triple, Triple]
    coupling: str = "none"
    with_j2: float = 0.0
    slides: tuple[int, ...] = ()
    masses: Sequence[tuple[float, Triple]] = ()

    def frames(self, controller: Array) -> list[Array]:
        """Compute the frames (4, 4) behind each joint, then the flange.

        The controller's angles (N,) are in rad or mm.
        """
        counted = np.array(controller, dtype=np.float64)
        counted[2] += self.with_j2 * counted[1]
        pose, frames = np.eye(4), []
        for k, ((shift, turn, axis), value) in enumerate(zip(self.joints, counted, strict=True), start=1):
            pose = pose @ _motion(shift, turn)
            along = value * np.array(AXES[axis], dtype=np.float64)
            step = np.eye(4)
            if k in self.slides:
                step[:3, 3] = along
            else:
                step[:3, :3] = Rotation.from_rotvec(along).as_matrix()
            pose = pose @ step
            frames.append(pose)
        return [*frames, pose @ _motion(*self.flange)]


def _motion(shift: Triple, turn: Triple) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
    pose[:3, 3] = shift
    return pose


def _straight(axes: str, *shifts: Triple) -> tuple[Joint, ...]:
    """Joints without turns: the axes in a row of words, the shifts one by one."""
    return tuple((shift, NO, axis) for shift, axis in zip(shifts, axes.split(), strict=True))


FORWARD = (NO, (0.0, 90.0, 0.0))  # z of the flange along the x of a level forearm, x down
FANUC_FLANGE = (NO, (180.0, -90.0, 0.0))  # the same z, x up
FANUC_AXES = "z y -y -x -y -x"
KUKA_AXES = "-z y y -x y -x"


def _ur(
    d1: float,
    a2: float,
    a3: float,
    d4: float,
    d5: float,
    d6: float,
    masses: Sequence[tuple[float, Triple]] = (),
) -> Published:
    joints: tuple[Joint, ...] = (
        ((0, 0, d1), NO, "z"),
        (NO, (90, 0, 0), "z"),
        ((a2, 0, 0), NO, "z"),
        ((a3, 0, d4), NO, "z"),
        ((0, -d5, 0), (90, 0, 0), "z"),
        ((0, d6, 0), (90, 180, 180), "z"),
    )
    return Published(joints, (NO, NO), masses=masses)


PUBLISHED: Mapping[str, Published] = {
    "abb-irb1200-5-0.9": Published(
        _straight("z y y x y x", (0, 0, 399.1), NO, (0, 0, 448), (0, 0, 42), (451, 0, 0), (82, 0, 0)), FORWARD
    ),
    "abb-irb1200-7-0.7": Published(
        _straight("z y y x y x", (0, 0, 399.1), NO, (0, 0, 350), (0, 0, 42), (351, 0, 0), (82, 0, 0)), FORWARD
    ),
    "abb-irb1600-6-1.2": Published(
        _straight("z y y x y x", NO, (150, 0, 486.5), (0, 0, 475), (300, 0, 0), (300, 0, 0), (65, 0, 0)),
        FORWARD,
    ),
    "abb-irb1600-10-1.45": Published(
        _straight("z y y x y x", NO, (150, 0, 486.5), (0, 0, 700), (300, 0, 0), (300, 0, 0), (65, 0, 0)),
        FORWARD,
    ),
    "abb-irb2400-12-1.55": Published(
        _straight("z y y x y x", NO, (100, 0, 615), (0, 0, 705), (0, 0, 135), (755, 0, 0), NO),
        ((85, 0, 0), (0, 90, 0)),
        "abb-j23",
        with_j2=-1.0,
    ),
    "abb-irb4600-40-2.55": Published(
        _straight(
            "z y y x y x", (0, 0, 495), (175, 0, 0), (0, 0, 1095), (0, 0, 175), (1270, 0, 0), (135, 0, 0)
        ),
        FORWARD,
    ),
    "abb-irb4600-60-2.05": Published(
        _straight(
            "z y y x y x", (0, 0, 495), (175, 0, 0), (0, 0, 900), (0, 0, 175), (960, 0, 0), (135, 0, 0)
        ),
        FORWARD,
    ),
    "doosan-m1013": Published(
        (
            ((0, 0, 152.5), NO, "z"),
            ((0, 34.5, 0), (0, -90, -90), "z"),
            ((620, 0, 0), (0, 0, 90), "z"),
            ((0, -559, 0), (90, 0, 0), "z"),
            (NO, (-90, 0, 0), "z"),
            ((0, -121, 0), (90, 0, 0), "z"),
        ),
        (NO, NO),
        masses=[
            (7.8, (0.119, 42.8, -6.383)),
            (10.83, (259.73, -0.053, 157.82)),
            (3.68, (-0.015, -6.702, 44.608)),
            (3.82, (0.071, 91.879, -182.52)),
            (2.82, (-0.273, 3.651, 32.088)),
            (1.16, (-0.292, 0.007, -53.9)),
        ],
    ),
    "fanuc-lrmate200ic": Published(
        _straight(FANUC_AXES, (0, 0, 330), (75, 0, 0), (0, 0, 300), (0, 0, 75), (320, 0, 0), (80, 0, 0)),
        FANUC_FLANGE,
        "fanuc-j23",
        with_j2=1.0,
    ),
    "fanuc-m10ia": Published(
        _straight(FANUC_AXES, (0, 0, 450), (150, 0, 0), (0, 0, 600), (0, 0, 200), (640, 0, 0), (100, 0, 0)),
        FANUC_FLANGE,
        "fanuc-j23",
        with_j2=1.0,
    ),
    "fanuc-m20ia": Published(
        _straight(FANUC_AXES, (0, 0, 525), (150, 0, 0), (0, 0, 790), (0, 0, 250), (835, 0, 0), (100, 0, 0)),
        FANUC_FLANGE,
        "fanuc-j23",
        with_j2=1.0,
    ),
    "fanuc-r2000ic-165f": Published(
        _straight(FANUC_AXES, (0, 0, 670), (312, 0, 0), (0, 0, 1075), (0, 0, 225), (1280, 0, 0), (215, 0, 0)),
        FANUC_FLANGE,
        "fanuc-j23",
        with_j2=1.0,
    ),
    "kuka-iiwa7-r800": Published(
        _straight("z y z -y z y z", (0, 0, 340), NO, (0, 0, 400), NO, (0, 0, 400), NO, (0, 0, 126)), (NO, NO)
    ),
    "kuka-kr10-r1100": Published(
        _straight(KUKA_AXES, (0, 0, 400), (25, 0, 0), (560, 0, 0), (0, 0, 35), (515, 0, 0), (80, 0, 0)),
        FORWARD,
        "kuka",
    ),
    "kuka-kr6-r900": Published(
        _straight(KUKA_AXES, (0, 0, 400), (25, 0, 0), (455, 0, 0), (0, 0, 35), (420, 0, 0), (80, 0, 0)),
        FORWARD,
        "kuka",
    ),
    "mecademic-meca500": Published(
        _straight("z y y x y x", (0, 0, 91), (0, 0, 44), (0, 0, 135), (0, 0, 38), (120, 0, 0), (70, 0, 0)),
        FORWARD,
    ),
    "staubli-tx2-60": Published(
        _straight("z y y z y z", (0, 0, 375), NO, (0, 20, 290), NO, (0, 0, 310), (0, 0, 70)), (NO, NO)
    ),
    "staubli-tx2-90": Published(
        _straight("z y y z y z", (0, 0, 478), (50, 0, 0), (0, 50, 425), NO, (0, 0, 425), (0, 0, 100)),
        (NO, NO),
    ),
    "ur10e": _ur(
        180.7,
        -612.7,
        -571.55,
        174.15,
        119.85,
        116.55,
        masses=[
            (7.369, (21, -27, 0)),
            (13.051, (-232.7, 0, 158)),
            (3.989, (-331.55, 0, 68)),
            (2.1, (0, -18, 7)),
            (1.98, (0, 18, -7)),
            (0.615, (0, 0, -26)),
        ],
    ),
    "ur16e": _ur(
        180.7,
        -478.4,
        -360.0,
        174.15,
        119.85,
        116.55,
        masses=[
            (7.369, (0, -30, -16)),
            (10.45, (-176.4, 0, 160)),
            (4.321, (-166, 0, 65)),
            (2.18, (0, -11, -9)),
            (2.033, (0, 12, -18)),
            (0.907, (0, 0, -44)),
        ],
    ),
    "ur20": _ur(236.3, -862.0, -728.7, 201.0, 159.3, 154.3),
    "ur3e": _ur(
        151.85,
        -243.55,
        -213.2,
        131.05,
        85.35,
        92.1,
        masses=[
            (1.98, (0, 0, -20)),
            (3.4445, (-113.55, 0, 115.7)),
            (1.437, (-163.2, 0, 23.8)),
            (0.871, (0, -10, 0)),
            (0.805, (0, 10, 0)),
            (0.261, (0, 0, -20)),
        ],
    ),
    "ur5e": _ur(
        162.5,
        -425.0,
        -392.2,
        133.3,
        99.7,
        99.6,
        masses=[
            (3.761, (0, -1.93, -25.61)),
            (8.058, (-212.5, 0, 113.36)),
            (2.846, (-242.2, 0, 26.5)),
            (1.37, (0, -16.34, -1.8)),
            (1.3, (0, 16.34, -1.8)),
            (0.365, (0, 0, -1.159)),
        ],
    ),
    "yaskawa-gp7": Published(
        _straight("z y -y -x -y -x", (0, 0, 330), (40, 0, 0), (0, 0, 445), (440, 0, 40), NO, NO),
        ((80, 0, 0), (180, -90, 0)),
    ),
    "yaskawa-sg650": Published(
        _straight("z z z z", NO, (350, 0, 0), (300, 0, 140), NO),
        (NO, NO),
        slides=(3,),
    ),
}

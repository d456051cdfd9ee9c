"""Nominal robots of the certified problems, typed from the sources a second time.

Units are degrees, mm, kg. Sources: Nubiola, thesis, Annex I and sections 2.2 and 4 for the ABB IRB 120 and the
Fanuc LR Mate 200iC (both modified DH, d_1 ahead of the base rotations). The UR10 follows the maker's published DH
and dynamics tables (standard DH).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from decimal import Decimal

Row = tuple[str, str, str, str]
Load = tuple[int, str, tuple[str, str, str]]


@dataclass(frozen=True)
class Arm:
    """Table of an arm, as text, so that numbers become decimals without rounding.

    `links` are rows of (alpha, a, theta, d).
    """

    modified: bool
    links: tuple[Row, ...]
    loads: tuple[Load, ...]
    parallel: tuple[int, ...]
    couplings: dict[str, tuple[tuple[int, ...], ...]] = field(default_factory=dict)

    def number(self, kind: str, link: int) -> Decimal:
        """Nominal alpha, a, theta or d of a link, counted from 1."""
        return Decimal(self.links[link - 1][("alpha", "a", "theta", "d").index(kind)])


IRB120 = Arm(
    modified=True,
    links=(
        ("0", "0", "0", "290"),
        ("-90", "0", "-90", "0"),
        ("0", "270", "0", "0"),
        ("-90", "70", "0", "302"),
        ("90", "0", "0", "0"),
        ("-90", "0", "180", "72"),
    ),
    loads=(
        (2, "4.2", ("140", "0", "0")),
        (4, "5", ("0", "0", "-193.6")),
        (6, "2.7", ("50", "25", "100")),
    ),
    parallel=(3,),
)

LR_MATE = Arm(
    modified=True,
    links=(
        ("0", "0", "0", "330"),
        ("-90", "75", "-90", "0"),
        ("0", "300", "0", "0"),
        ("-90", "75", "0", "320"),
        ("90", "0", "0", "0"),
        ("-90", "0", "0", "80"),
    ),
    loads=(
        (2, "10", ("150", "0", "0")),
        (4, "10", ("0", "0", "-160")),
        (6, "2.6", ("50", "25", "100")),
    ),
    parallel=(3,),
    couplings={
        "fanuc-j23": (
            (1, 0, 0, 0, 0, 0),
            (0, 1, 0, 0, 0, 0),
            (0, -1, -1, 0, 0, 0),
            (0, 0, 0, -1, 0, 0),
            (0, 0, 0, 0, -1, 0),
            (0, 0, 0, 0, 0, -1),
        )
    },
)

UR10 = Arm(
    modified=False,
    links=(
        ("90", "0", "0", "127.3"),
        ("0", "-612", "0", "0"),
        ("0", "-572.3", "0", "0"),
        ("90", "0", "0", "163.941"),
        ("-90", "0", "0", "115.7"),
        ("0", "0", "0", "92.2"),
    ),
    loads=(
        (1, "7.778", ("21", "0", "27")),
        (2, "12.93", ("380", "0", "158")),
        (3, "3.87", ("240", "0", "68")),
        (4, "1.96", ("0", "7", "18")),
        (5, "1.96", ("0", "7", "18")),
        (6, "0.202", ("0", "0", "-26")),
    ),
    parallel=(2, 3),
)

ARMS = {"abb-irb120": IRB120, "fanuc-lrmate200ic": LR_MATE, "ur10": UR10}

"""Robot files of machines that are no six turning joints, as their users would write them. The numbers are made up."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from calib.arm.robot import Robot, load_robot

Row = tuple[float, float, float, float, float, float]
"""alpha deg, a mm, theta deg, d mm, lowest and highest of the joint, deg or mm."""

_LOAD = "[[loads]]\nlink = {}\nmass_kg = {}\ncog_mm = [{}, {}, {}]\n"


def _text(
    name: str,
    convention: str,
    rows: Sequence[Row],
    *,
    slides: Sequence[int] = (),
    external: Sequence[int] = (),
    parallel: Sequence[int] = (),
    loads: Sequence[tuple[int, float, float, float, float]] = (),
    more: str = "",
) -> str:
    lines = [
        'format = "truepose-robot/1"',
        f'name = "{name}"',
        'maker = "nobody"',
        f'convention = "{convention}"',
    ]
    lines += [f"parallel_axes = {list(parallel)}", 'source = "made up"']
    for number, (alpha, a, theta, d, low, high) in enumerate(rows, start=1):
        unit = "mm" if number in slides else "deg"
        lines += ["[[link]]", f"alpha_deg = {alpha}", f"a_mm = {a}", f"theta_deg = {theta}", f"d_mm = {d}"]
        lines += [f"min_{unit} = {low}", f"max_{unit} = {high}"]
        lines += ['joint = "slides"'] if number in slides else []
        lines += [f'axis = "e{list(external).index(number) + 1}"'] if number in external else []
    return "\n".join(lines) + "\n" + "".join(_LOAD.format(*load) for load in loads) + more


_ELBOW: list[Row] = [
    (0.0, 0.0, 0.0, 400.0, -170.0, 170.0),
    (-90.0, 150.0, -90.0, 0.0, -90.0, 120.0),
    (0.0, 700.0, 0.0, 0.0, -140.0, 70.0),
    (-90.0, 100.0, 0.0, 700.0, -180.0, 180.0),
    (90.0, 0.0, 0.0, 0.0, -120.0, 120.0),
    (-90.0, 0.0, 0.0, 100.0, -350.0, 350.0),
]
_ELBOW_LOADS = [(2, 60.0, 300.0, 0.0, 50.0), (3, 45.0, 80.0, 30.0, 0.0), (4, 20.0, 0.0, 0.0, -250.0)]


def _scara(name: str, convention: str, lengths: Sequence[float]) -> str:
    """A SCARA whose links have the lengths `a`, mm, by the convention."""
    moves = ((200.0, -130.0, 130.0), (0.0, -145.0, 145.0), (50.0, -200.0, 0.0), (0.0, -350.0, 350.0))
    return _text(
        name,
        convention,
        [(0.0, a, 0.0, d, low, high) for a, (d, low, high) in zip(lengths, moves, strict=True)],
        slides=[3],
        parallel=[2, 3, 4],
        loads=[(3, 2.0, 0.0, 0.0, 50.0), (4, 3.0, 20.0, 0.0, 20.0)],
    )


SCARA = _scara("scara", "mdh", (0.0, 325.0, 275.0, 0.0))
SCARA_DH = _scara("scara-dh", "dh", (325.0, 275.0, 0.0, 0.0))
# The wrist is held level by rods: its tilt is not driven, it follows joints 2 and 3. The controller counts joint 3 from
# the horizontal (a parallelogram drives it), so the angle in the elbow is q3 - q2, and that in the wrist -q3. No
# motor drives the wrist: its limits leave it no room.
PALLETIZER = _text(
    "palletizer",
    "mdh",
    [
        (0.0, 0.0, 0.0, 800.0, -180.0, 180.0),
        (-90.0, 300.0, -90.0, 0.0, -40.0, 90.0),
        (0.0, 1150.0, 90.0, 0.0, -20.0, 110.0),
        (0.0, 1200.0, 0.0, 0.0, -0.005, 0.005),
        (-90.0, 200.0, 0.0, 250.0, -300.0, 300.0),
    ],
    parallel=[3, 4],
    loads=[(2, 150.0, 500.0, 0.0, 0.0), (3, 90.0, 300.0, 0.0, 0.0), (5, 40.0, 0.0, 0.0, 100.0)],
    more=(
        "[joint_matrices.rods]\n"
        "matrix = [[1, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, -1, 1, 0, 0], [0, 0, -1, 1, 0], [0, 0, 0, 0, 1]]\n"
    ),
)
SEVEN = _text(
    "seven",
    "mdh",
    [
        (0.0, 0.0, 0.0, 340.0, -170.0, 170.0),
        (-90.0, 0.0, 0.0, 0.0, -120.0, 120.0),
        (90.0, 0.0, 0.0, 400.0, -170.0, 170.0),
        (90.0, 0.0, 0.0, 0.0, -120.0, 120.0),
        (-90.0, 0.0, 0.0, 400.0, -170.0, 170.0),
        (-90.0, 0.0, 0.0, 0.0, -120.0, 120.0),
        (90.0, 0.0, 0.0, 126.0, -175.0, 175.0),
    ],
    loads=[
        (2, 4.0, 0.0, -60.0, 40.0),
        (3, 3.5, 0.0, 30.0, -80.0),
        (4, 3.0, 0.0, 70.0, 30.0),
        (5, 2.0, 0.0, 20.0, -80.0),
    ],
)
# A rail along x of the arm's foot: alpha of link 1 lays its z along x, the arm stands on the carriage.
TRACK = _text(
    "track",
    "mdh",
    [(90.0, 0.0, 90.0, 0.0, 0.0, 4000.0), (-90.0, 0.0, -90.0, 300.0, -170.0, 170.0), *_ELBOW[1:]],
    slides=[1],
    external=[1],
    parallel=[4],
    loads=[(link + 1, mass, x, y, z) for link, mass, x, y, z in _ELBOW_LOADS],
)
POSITIONER = _text(
    "positioner",
    "mdh",
    [(-90.0, 0.0, 0.0, 0.0, -95.0, 95.0), (90.0, 0.0, 0.0, 150.0, -350.0, 350.0)],
    external=[1, 2],
    loads=[(2, 120.0, 30.0, 20.0, 80.0)],
)
GANTRY = _text(
    "gantry",
    "mdh",
    [
        (-90.0, 0.0, -90.0, 0.0, 0.0, 3000.0),
        (-90.0, 0.0, -90.0, 0.0, 0.0, 2000.0),
        (-90.0, 0.0, 0.0, 0.0, -800.0, 0.0),
    ],
    slides=[1, 2, 3],
)

# A telescope on a turning tower: gravity pulls along its slide, now more, now less.
BOOM = _text(
    "boom",
    "mdh",
    [
        (0.0, 0.0, 0.0, 500.0, -170.0, 170.0),
        (-90.0, 0.0, 0.0, 0.0, -80.0, 80.0),
        (90.0, 0.0, 0.0, 300.0, 0.0, 1500.0),
    ],
    slides=[3],
    loads=[(3, 50.0, 20.0, 0.0, 100.0)],
)

MACHINES = {
    "scara": SCARA,
    "scara-dh": SCARA_DH,
    "palletizer": PALLETIZER,
    "seven": SEVEN,
    "track": TRACK,
    "positioner": POSITIONER,
    "gantry": GANTRY,
    "boom": BOOM,
}


def machine(name: str, folder: Path) -> Robot:
    """The robot of one of `MACHINES`, by way of a file in `folder`."""
    (folder / f"{name}.toml").write_text(MACHINES[name], encoding="utf-8")
    return load_robot(f"{name}.toml", folder)

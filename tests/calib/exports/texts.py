"""Exports as text: separators, units, turns in their many forms, targets, split files.

Joints and points may be in two files.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calib.units import DEG
from tests.calib.exports.case import (
    AXES,
    HEAD,
    OWN,
    TRUTH,
    J,
    N,
    P,
    Q,
    angles,
    case,
    grid,
    named,
    num,
    save,
)


@case("German Excel: semicolons, decimal commas, Latin-1, CRLF, a preamble, names with units")
def excel_german(folder: Path) -> Path:
    names = ["Nr.", *(f"Achse {k} [°]" for k in range(1, 7)), *(f"Pos. {a} [mm]" for a in "XYZ"), "Prüfer"]
    rows = [[str(i + 1), *(num(v, comma=True) for v in (*J[i], *P[i])), "Müller"] for i in range(N)]
    head = ["Messprotokoll Roboterzelle 4", "Datum: 12.03.2025;Prüfer: Müller", ""]
    return save(folder / "messung.csv", [*head, *named(names, rows)], "cp1252", "\r\n")


@case("Tabs, a row of units below the names, UTF-8 with BOM")
def tabs_units(folder: Path) -> Path:
    lines = named([*(f"J{k}" for k in range(1, 7)), "X", "Y", "Z"], grid(J, P), "\t")
    return save(folder / "a.txt", [lines[0], "\t".join(["deg"] * 6 + ["mm"] * 3), *lines[1:]], "utf-8-sig")


@case("Blanks in columns, names in a comment")
def blanks(folder: Path) -> Path:
    rows = [" ".join(f"{v:12.5f}" for v in (*J[i], *P[i])) for i in range(N)]
    return save(folder / "a.dat", ["# j1_deg j2_deg j3_deg j4_deg j5_deg j6_deg x_mm y_mm z_mm", *rows])


@case("Excel's Unicode text: UTF-16, tabs, decimal commas")
def utf16(folder: Path) -> Path:
    names = [*(f"Gelenk {k} (Grad)" for k in range(1, 7)), "x (mm)", "y (mm)", "z (mm)"]
    rows = [[num(v, comma=True) for v in (*J[i], *P[i])] for i in range(N)]
    return save(folder / "a.txt", named(names, rows, "\t"), "utf-16")


@case("UR's names from 0, radians; the tracker in metres")
def ur_radians(folder: Path) -> Path:
    names = [
        "timestamp",
        *(f"target_q_{k}" for k in range(6)),
        *(f"actual_q_{k}" for k in range(6)),
        *(f"{a} [m]" for a in "xyz"),
    ]
    back = J * DEG + 1e-5
    rows = grid(np.arange(N) * 20.0, J * DEG, back, P / 1000.0, decimals=8)
    return save(folder / "rtde.csv", named(names, rows, ","))


@case("No units anywhere: degrees are evident, millimetres follow from the robot")
def no_units(folder: Path) -> Path:
    return save(
        folder / "a.csv", named([*(f"theta{k}" for k in range(1, 7)), "X", "Y", "Z"], grid(J, P), ",")
    )


@case(
    "No units, and no robot to decide by",
    asks=("unit.points", "robot"),
    answers={"robot": "", "unit.points": "mm"},
)
def no_units_no_robot(folder: Path) -> Path:
    return save(
        folder / "a.csv", named([*(f"theta{k}" for k in range(1, 7)), "X", "Y", "Z"], grid(J, P), ",")
    )


@case("Names say deg, numbers are radians")
def deg_that_are_rad(folder: Path) -> Path:
    names = [*(f"Joint {k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]"]
    return save(folder / "a.csv", named(names, grid(J * DEG, P, decimals=8), ";"))


@case("Names say mm, numbers are metres")
def mm_that_are_m(folder: Path) -> Path:
    names = [*(f"Joint {k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]"]
    return save(folder / "a.csv", named(names, grid(J, P / 1000.0, decimals=8), ";"))


@case("Inches", within=2e-3)
def inches(folder: Path) -> Path:
    names = [*(f"Axis{k} [deg]" for k in range(1, 7)), "X (in)", "Y (in)", "Z (in)"]
    return save(folder / "a.csv", named(names, grid(J, P / 25.4), ","))


@case("KUKA: A1 .. A6 beside the controller's X, Y, Z, A, B, C and what the tracker measured")
def kuka(folder: Path) -> Path:
    own = grid(OWN, angles("ZYX") + 3.0)
    names = ["Punkt", *(f"{n} [deg]" for n in AXES), *(f"{a} soll [mm]" for a in "XYZ")]
    names += ["A [deg]", "B [deg]", "C [deg]", *(f"{a}_ist [mm]" for a in "XYZ")]
    rows = [[f"P{i + 1}", *grid(J)[i], *own[i], *grid(P)[i]] for i in range(N)]
    return save(folder / "kuka.csv", named(names, rows))


@case("Nominal, actual and deviation side by side (as of inspection programs)")
def nominal_actual(folder: Path) -> Path:
    names = ["Name", *(f"J{k} (deg)" for k in range(1, 7))]
    names += [f"{kind} {a}" for a in "XYZ" for kind in ("Nom", "Act", "Dev")]
    rows = []
    for i in range(N):
        of = [(OWN[i, k], P[i, k], P[i, k] - OWN[i, k]) for k in range(3)]
        rows.append([f"M{i}", *grid(J)[i], *(f"{v:.4f}" for each in of for v in each)])
    return save(folder / "report.txt", ["// Units: mm", *named(names, rows, "\t")])


@case("rx, ry, rz in degrees: by the robot, Staubli's convention", turned=True)
def euler_staubli(folder: Path) -> Path:
    names = [*(f"J{k}_deg" for k in range(1, 7)), "x_mm", "y_mm", "z_mm", "rx_deg", "ry_deg", "rz_deg"]
    return save(folder / "a.csv", named(names, grid(J, P, angles("XYZ")), ","))


@case("rx, ry, rz in radians: by the robot, a rotation vector", turned=True)
def euler_vector(folder: Path) -> Path:
    vector = Rotation.from_quat(Q, scalar_first=True).as_rotvec()
    names = [
        *(f"J{k} [deg]" for k in range(1, 7)),
        "x [m]",
        "y [m]",
        "z [m]",
        "rx [rad]",
        "ry [rad]",
        "rz [rad]",
    ]
    return save(folder / "a.csv", named(names, grid(J, P / 1000.0, vector, decimals=8), ","))


@case("rx, ry, rz about fixed axes: by the robot, which two names are for", turned=True)
def rotations_fixed(folder: Path) -> Path:
    names = [*HEAD, *(f"{a} [deg]" for a in ("rx", "ry", "rz"))]
    return save(folder / "a.csv", named(names, grid(J, P, angles("xyz"))))


@case("No names: six joints and a point")
def nameless(folder: Path) -> Path:
    return save(folder / "a.txt", [" ".join(row) for row in grid(J, P)])


@case("No names: a count, a pose with its quaternion in metres, six joints in radians", turned=True)
def nameless_poses(folder: Path) -> Path:
    rows = grid(np.arange(N), P / 1000.0, Q, J * DEG, decimals=9)
    return save(folder / "a.csv", [",".join([row[0].split(".")[0], *row[1:]]) for row in rows])


@case("No names: joints in one file, points of SpatialAnalyzer in the other, remarks behind some")
def nameless_points(folder: Path) -> Sequence[Path]:
    lines = [f"A, Robot, Pose{i + 1}, {', '.join(row)}" for i, row in enumerate(grid(P))]
    lines = [line + (" // first 1 2 3" if i < 2 else "") for i, line in enumerate(lines)]
    return [joint_list(folder), save(folder / "points.txt", ["// SpatialAnalyzer", "// Units: mm", *lines])]


@case("Names of groups: arm1 .. arm6, probe1 .. probe3")
def groups(folder: Path) -> Path:
    names = [*(f"arm{k}" for k in range(1, 7)), *(f"probe{k}" for k in range(1, 4))]
    return save(folder / "a.csv", named(names, grid(J, P)))


def poses() -> np.ndarray:
    """Return the measured poses as matrices, row by row, (N, 16)."""
    out = np.tile(np.eye(4), (N, 1, 1))
    out[:, :3, :3] = Rotation.from_quat(Q, scalar_first=True).as_matrix()
    out[:, :3, 3] = P
    return out.reshape(N, 16)


@case("Matrices 4 x 4: T11 .. T44", turned=True)
def matrix(folder: Path) -> Path:
    names = [*AXES, *(f"T{row}{column}" for row in range(1, 5) for column in range(1, 5))]
    return save(folder / "a.csv", named(names, grid(J, poses(), decimals=9)))


@case("Matrices 4 x 4 written in columns, counted from 0", turned=True)
def matrix_columns(folder: Path) -> Path:
    turned = poses().reshape(N, 4, 4).transpose(0, 2, 1).reshape(N, 16)
    names = [*AXES, *(f"m_{row}_{column}" for row in range(4) for column in range(4))]
    return save(folder / "a.csv", named(names, grid(J, turned, decimals=9)))


@case("Matrices of twelve numbers without names, before the joints", turned=True)
def matrix_nameless(folder: Path) -> Path:
    return save(folder / "a.txt", ["\t".join(row) for row in grid(poses()[:, :12], J, decimals=9)])


@case(
    "Matrices of four lines each, joints in another file by order",
    asks=("match", "2.unit.points"),
    answers={"match": "order"},
    turned=True,
)
def matrix_lines(folder: Path) -> Sequence[Path]:
    lines = []
    for i, pose in enumerate(poses().reshape(N, 4, 4)):
        lines += [f"Pose {i + 1}", *(" ".join(f"{value:.9f}" for value in row) for row in pose), ""]
    return [joint_list(folder), save(folder / "poses.txt", lines)]


@case("Matrices in one cell", turned=True)
def matrix_in_a_cell(folder: Path) -> Path:
    cells = [str(pose.reshape(4, 4).round(9).tolist()) for pose in poses()]
    return save(folder / "a.csv", named([*AXES, "pose"], [[*grid(J)[i], cells[i]] for i in range(N)]))


@case("Cells in brackets: j:{2.63,..} p:{..}")
def brackets(folder: Path) -> Path:
    lines = [f"{i};j:{{{','.join(grid(J)[i])}}} p:{{{','.join(grid(P)[i])}}}" for i in range(N)]
    return save(folder / "a.log", ["run 7 of cell 4", *lines, "end after 24 poses"])


@case("KUKA's braces: {A1 2.63, A2 ..}, and X=..")
def braces(folder: Path) -> Path:
    def pairs(names: Sequence[str], cells: Sequence[str], mark: str) -> str:
        return ", ".join(f"{name}{mark}{cell}" for name, cell in zip(names, cells, strict=True))

    lines = [f"{{{pairs(AXES, grid(J)[i], ' ')}}} {pairs('XYZ', grid(P)[i], '=')}" for i in range(N)]
    return save(folder / "a.txt", lines)


@case("Points of SpatialAnalyzer with a remark behind each, blanks between the cells")
def spatial_analyzer_remarks(folder: Path) -> Sequence[Path]:
    head = ["// SpatialAnalyzer 2023.1", "// Units: Millimeters", "//", "// Name X Y Z"]
    lines = [f"Pose{i + 1} {' '.join(row)} // rms 0.01 0.02 0.01" for i, row in enumerate(grid(P))]
    return [joint_list(folder), save(folder / "points.txt", [*head, *lines])]


@case("Fanuc's W, P, R", turned=True)
def euler_fanuc(folder: Path) -> Path:
    names = [
        *(f"J{k} [deg]" for k in range(1, 7)),
        *(f"{a} [mm]" for a in "XYZ"),
        "W [deg]",
        "P [deg]",
        "R [deg]",
    ]
    return save(folder / "a.csv", named(names, grid(J, P, angles("xyz")), ","))


@case("KUKA's A, B, C, measured", turned=True)
def euler_kuka(folder: Path) -> Path:
    names = [
        *(f"{n} [deg]" for n in AXES),
        *(f"{a} meas [mm]" for a in "XYZ"),
        *(f"{a} meas [deg]" for a in "ABC"),
    ]
    return save(folder / "a.csv", named(names, grid(J, P, angles("ZYX")), ","))


@case("A, B, C that are not KUKA's", refuses="orientations that miss")
def euler_not_kuka(folder: Path) -> Path:
    names = [
        *(f"J{k} [deg]" for k in range(1, 7)),
        *(f"{a} [mm]" for a in "XYZ"),
        *(f"{a} [deg]" for a in "ABC"),
    ]
    return save(folder / "a.csv", named(names, grid(J, P, angles("xyz")), ","))


@case("Two lines of names: a group over x, y, z", targets=2)
def names_in_two_lines(folder: Path) -> Path:
    over = "Pose" + ";" * 7 + "T1;;;T2;;"
    rows = [[str(i), *each] for i, each in enumerate(grid(J, TRUTH.points[:, :2].reshape(N, 6)))]
    return save(folder / "a.csv", [over, *named(["Nr", *HEAD, *HEAD[6:]], rows)])


@case("A station in the preamble, a row of words for a lost point; joints in another file", lost_rows=(5,))
def lost_in_list(folder: Path) -> Sequence[Path]:
    rows = [[f"Pose{i + 1}", *each] for i, each in enumerate(grid(P))]
    rows[5] = ["Pose6", "lost", "lost", "lost"]
    head = ["Station;1000.0;2000.0;1500.0", ""]
    return [joint_list(folder), save(folder / "p.csv", [*head, *named(["Name", *HEAD[6:]], rows)])]


@case("A quaternion with the scalar last, by name", turned=True)
def quaternion_last(folder: Path) -> Path:
    names = [*(f"J{k} [deg]" for k in range(1, 7)), *(f"{a} [mm]" for a in "XYZ"), "qx", "qy", "qz", "qw"]
    return save(folder / "a.csv", named(names, grid(J, P, Q[:, [1, 2, 3, 0]]), ","))


@case("q1 .. q4 without saying which is the scalar: decided by the robot", turned=True)
def quaternion_numbered(folder: Path) -> Path:
    names = [*(f"J{k} [deg]" for k in range(1, 7)), *(f"{a} [mm]" for a in "XYZ"), "q1", "q2", "q3", "q4"]
    return save(folder / "a.csv", named(names, grid(J, P, Q), ","))


@case("Three targets side by side, one row a pose", targets=3)
def targets_wide(folder: Path) -> Path:
    names = [
        "Pose",
        *(f"J{k} [deg]" for k in range(1, 7)),
        *(f"T{t}_{a} [mm]" for t in (1, 2, 3) for a in "xyz"),
    ]
    rows = [[str(i), *each] for i, each in enumerate(grid(J, TRUTH.points.reshape(N, 9)))]
    return save(folder / "a.csv", named(names, rows))


@case("Three targets below each other, with their names", targets=3)
def targets_long(folder: Path) -> Path:
    names = [*(f"J{k} [deg]" for k in range(1, 7)), "Target", *(f"{a} [mm]" for a in "XYZ")]
    rows = [[*grid(J)[i], f"T{t + 1}", *grid(TRUTH.points[:, t])[i]] for i in range(N) for t in range(3)]
    return save(folder / "a.csv", named(names, rows))


def joint_list(folder: Path, name: str = "Pose{}", numbers: Sequence[int] = range(1, N + 1)) -> Path:
    rows = [[name.format(numbers[i]), *grid(J)[i]] for i in range(N)]
    return save(folder / "joints.csv", named(["Name", *(f"J{k} [deg]" for k in range(1, 7))], rows))


@case("Joints by pose; points of SpatialAnalyzer by name, in another order, three targets", targets=3)
def spatial_analyzer(folder: Path) -> Sequence[Path]:
    lines = ["// SpatialAnalyzer 2023.1", "// Frame: World, Units: Millimeters", "// Point Name, X, Y, Z"]
    lines += [
        f"A::Robot::Pose{i + 1}_T{t + 1}, {', '.join(grid(TRUTH.points[:, t])[i])}"
        for t in range(3)
        for i in reversed(range(N))
    ]
    return [joint_list(folder), save(folder / "points.txt", [*lines, "A::Nest::N1, 0.0, 0.0, 0.0"])]


@case(
    "Points with mere numbers for names: whether they count rows is asked",
    asks=("match",),
    answers={"match": "name"},
)
def numbers_as_names(folder: Path) -> Sequence[Path]:
    rows = [[str(i + 1), *grid(P)[i]] for i in reversed(range(N))]
    return [
        joint_list(folder, "{}"),
        save(folder / "leica.csv", named(["Point ID", "X [mm]", "Y [mm]", "Z [mm]"], rows, ",")),
    ]


@case(
    "Points without names: matched by order only if you say so", asks=("match",), answers={"match": "order"}
)
def by_order(folder: Path) -> Sequence[Path]:
    return [joint_list(folder), save(folder / "p.txt", named(["X [mm]", "Y [mm]", "Z [mm]"], grid(P), "\t"))]


@case(
    "By order, and one point too many",
    answers={"match": "order"},
    asks=("match",),
    refuses="cannot belong together in order",
)
def by_order_too_many(folder: Path) -> Sequence[Path]:
    rows = [*grid(P), grid(P)[-1]]
    return [joint_list(folder), save(folder / "p.txt", named(["X [mm]", "Y [mm]", "Z [mm]"], rows, "\t"))]


@case("Joints and points by time", asks=("match",), answers={"match": "time", "within_s": "3"})
def by_time(folder: Path) -> Sequence[Path]:
    def stamp(seconds: float) -> str:
        return f"2025-03-12 {9 + int(seconds) // 3600:02d}:{int(seconds) // 60 % 60:02d}:{seconds % 60:06.3f}"

    one = named(
        ["Time", *(f"J{k} [deg]" for k in range(1, 7))], [[stamp(20.0 * i), *grid(J)[i]] for i in range(N)]
    )
    two = named(
        ["Timestamp", "X [mm]", "Y [mm]", "Z [mm]"], [[stamp(20.0 * i + 1.7), *grid(P)[i]] for i in range(N)]
    )
    return [save(folder / "robot.csv", one), save(folder / "tracker.csv", two)]

"""Import of the UR10 measurements that Fraunhofer IPA published (Leica tracker with T-Mac).

Two layouts of the same numbers: as published (semicolons, decimal commas, joints named after the links of the
ROS description) and cleaned (commas, units in the names). Joints are the planned values; the pose of the T-Mac
is in the tracker's frame, Euler angles XYZ intrinsic, deg. Where on the flange the T-Mac sits is unknown, so the
data set frees the tool. Source: Landgraf et al., IEEE CASE 2021, repository ipa-robot-accuracy (MIT licence).
"""

from __future__ import annotations

import re
from datetime import datetime
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calib.convert.table import ConvertedTable
from calib.errors import DataError
from calib.text.columns import rows_of
from calib.text.text_file import read_text
from calib.text.toml_table import FARTHEST_MM

_PUBLISHED = {
    "timestamp": "Timestamp",
    "joints": (
        "shoulder_pan_joint",
        "shoulder_lift_joint",
        "elbow_joint",
        "wrist_1_joint",
        "wrist_2_joint",
        "wrist_3_joint",
    ),
    "temperature": "measurement_temperature",
    "point": ("measurement_x", "measurement_y", "measurement_z"),
    "euler": ("measurement_rx", "measurement_ry", "measurement_rz"),
}
_CLEANED = {
    "timestamp": "timestamp",
    "joints": tuple(f"q{k}_rad" for k in range(1, 7)),
    "temperature": "temp_C",
    "point": ("x_mm", "y_mm", "z_mm"),
    "euler": ("rx_deg_XYZintrinsic", "ry_deg_XYZintrinsic", "rz_deg_XYZintrinsic"),
}

_HEADER = """format = "truepose-dataset/1"
robot = "ur10"
instrument = "leica-tmac"
world = "free"
joint_coupling = "none"
gravity_base = [0.0, 0.0, -9.81]

[model]
fit = ["base", "geometry", "parallel_twist", "compliance", "tool"]

[noise]                          # from repeated readings: 0.006 to 0.012 mm per axis
kind = "isotropic"
sigma_mm = 0.010

[tool_targets]                   # unknown; the fit finds it
TMAC = [0.0, 0.0, 0.0]
"""


def read(path: Path) -> ConvertedTable:
    """Read a file in either layout.

    Raises
    ------
    DataError
        The file is invalid; the error names line and column.
    """
    text = read_text(path)
    delimiter = ";" if ";" in text.partition("\n")[0] else ","
    lines = rows_of(text, path, delimiter)
    names = [name.strip() for name in lines[0][1]] if lines else []
    layout = next((known for known in (_PUBLISHED, _CLEANED) if known["timestamp"] in names), None)
    wanted = (
        []
        if layout is None
        else [layout["temperature"], *layout["joints"], *layout["point"], *layout["euler"]]
    )
    missing = [name for name in wanted if name not in names]
    if layout is None or missing:
        raise DataError(
            f"lacks the column {missing[0]!r}." if missing else "is not one of the published UR10 files.",
            do="Give original_series_*.csv or series_*.csv of the ipa-robot-accuracy data.",
            file=path,
            line=1,
        )
    rows = [(number, line) for number, line in lines[1:] if line]
    if not rows:
        raise DataError("has a header row but no readings.", do="Give the whole file.", file=path)

    def numbers(columns: tuple[str, ...]) -> np.ndarray:
        out = np.empty((len(rows), len(columns)))
        places = [names.index(column) for column in columns]
        for i, (number, line) in enumerate(rows):
            for k, place in enumerate(places):
                try:
                    out[i, k] = float(line[place].replace(",", "."))
                except (ValueError, IndexError):
                    out[i, k] = np.nan
                if not abs(out[i, k]) <= FARTHEST_MM:
                    raise DataError(
                        f"column '{columns[k]}' is not a possible number.",
                        do="Correct that line.",
                        file=path,
                        line=number,
                    )
        return out

    quaternion = Rotation.from_euler("XYZ", numbers(layout["euler"]), degrees=True).as_quat(scalar_first=True)
    joints = np.degrees(numbers(layout["joints"]))
    point = numbers(layout["point"])
    columns: dict[str, list[str]] = {"reading_id": [str(i + 1) for i in range(len(rows))]}
    place = names.index(layout["timestamp"])
    columns["t_s"] = _seconds([line[place] if place < len(line) else "" for _, line in rows])
    for k in range(6):
        columns[f"j{k + 1}_deg"] = [f"{value:.6f}" for value in joints[:, k]]
    columns["tool_target"] = ["TMAC"] * len(rows)
    for k, axis in enumerate("xyz"):
        columns[f"{axis}_mm"] = [f"{value:.6f}" for value in point[:, k]]
    for k, part in enumerate("wxyz"):
        columns[f"rot_{part}"] = [f"{value:.9f}" for value in quaternion[:, k]]
    columns["t_air_c"] = [f"{value:.4f}" for value in numbers((layout["temperature"],))[:, 0]]
    return ConvertedTable(columns, _HEADER)


def _seconds(stamps: list[str]) -> list[str]:
    """Compute seconds since the first time stamp.

    They are empty if the source rounded its stamps to the month.
    """
    if (
        not all(re.fullmatch(r"20[0-9]{12}", stamp) for stamp in stamps)
        or len(set(stamps)) < len(stamps) // 2
    ):
        return [""] * len(stamps)
    try:
        times = [datetime.strptime(stamp, "%Y%m%d%H%M%S").timestamp() for stamp in stamps]
    except ValueError:  # digits that are no date
        return [""] * len(stamps)
    return [f"{time - times[0]:.0f}" for time in times]

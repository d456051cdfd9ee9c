"""The `[robot]` table of a cell file: the robot, its driver, its speed and its limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from acquisition.cell.obstacles import Obstacle, read_keep_out
from acquisition.errors import as_config_error
from calib.arm import Robot, built_in_robots, load_robot, own_robot_table, robot_from
from calib.data import ABSOLUTE_ACCURACY
from calib.text import TomlTable
from drivers import Option, RobotDriver, TextOption, robot_driver
from drivers.errors import ConfigError

SPEED_CAP_MM_S, SPEED_CAP_DEG_S = 500.0, 20.0  # Nubiola, thesis 2.5: faster moves warm and shake the arm


@dataclass(frozen=True)
class RobotSection:
    """The robot of the cell and how fast and how far it may go.

    Joints are counted in deg, or in mm if they slide, also if a name ends in `_deg`.

    Attributes
    ----------
    coupling
        Joint matrix of the robot, or `none`.
    home_deg
        A posture over which every pose can be reached; None if the cell file has none.
    options
        Options that only the driver uses.
    file
        The parsed robot file of a robot that is not in the library.
    absolute_accuracy
        Whether the controller corrects with its maker's own calibration: "on", "off" or "unknown".
    """

    model: Robot
    coupling: str
    driver: str
    url: str
    speed_mm_s: float
    speed_deg_s: float
    limits_deg: tuple[tuple[float, float], ...]
    table_z_mm: float
    keep_out: tuple[Obstacle, ...]
    home_deg: tuple[float, ...] | None
    repeatability_deg: float
    repeatability_mm: float
    options: Mapping[str, float | str] = field(default_factory=dict)
    file: Mapping[str, Any] | None = None
    absolute_accuracy: str = "unknown"

    @property
    def declared(self) -> RobotDriver:
        """The declaration of the driver.

        Raises
        ------
        ConfigError
            The driver is unknown.
        """
        return robot_driver(self.driver)

    def model_angles(self, joints_deg: ArrayLike) -> NDArray[np.float64]:
        """Convert joints (n, N) of the controller, deg or mm, to those of the model, rad or mm."""
        counted = np.asarray(joints_deg, dtype=np.float64) * self.model.joint_units
        return self.model.model_angles(counted, self.coupling)

    def counted(self, joints: ArrayLike) -> NDArray[np.float64]:
        """Convert joints (n, N) of the model, rad or mm, to those of the controller, deg or mm."""
        counted = self.model.controller_angles(np.asarray(joints, dtype=np.float64), self.coupling)
        return counted / self.model.joint_units

    @property
    def limits(self) -> NDArray[np.float64]:
        """Limits of the joints in the controller's count, shape (N, 2), rad or mm."""
        return np.array(self.limits_deg) * self.model.joint_units[:, None]

    def named(self, k: int) -> str:
        """Return the joint with index k, from 0, as text: 'joint 3', 'axis e1'."""
        axis = self.model.axes[k]
        return f"joint {axis[1:]}" if axis.startswith("j") else f"axis {axis}"

    def said(self, joints_deg: Sequence[float] | NDArray[np.float64], decimals: int | None = None) -> str:
        """Return joints of the controller as text.

        If no joint slides: '90, 0, -45 deg'. Otherwise each joint has its unit.
        """
        numbers = [f"{q:g}" if decimals is None else f"{q:.{decimals}f}" for q in joints_deg]
        if not self.model.slides:
            return f"{', '.join(numbers)} deg"
        each = zip(self.model.axes, numbers, self.model.units, strict=True)
        return ", ".join(f"{axis} {number} {unit}" for axis, number, unit in each)


def read_robot(table: TomlTable, beside: Path | None) -> RobotSection:
    driver = table.text("driver")
    declared = None
    with suppress(ConfigError):  # an unknown driver is named when its device is opened
        declared = robot_driver(driver)
    options = () if declared is None else declared.options
    table.only(
        (
            *("model", "joint_coupling", "driver", "url", "speed_mm_s", "speed_deg_s", "limits_deg"),
            *("table_z_mm", "keep_out", "home_deg", "repeatability_deg", "repeatability_mm", "file"),
            "absolute_accuracy",
            *(option.key for option in options),
        )
    )
    model = table.text("model")
    with as_config_error(f"{table.file}, key 'robot.model': "):
        file = table.values.get("file") or own_robot_table(model, beside)
        robot = load_robot(model) if file is None else robot_from(file, Path(model))
    if robot.name in built_in_robots() and robot.name != model:
        raise table.refuse(
            "model",
            f"is the file of a robot with the name of one of the library, '{robot.name}'.",
            "Give it another name.",
        )
    driver = table.text("driver")
    _refuse_undriven(table, robot, driver)
    own = [
        tuple(pair)
        for pair in (np.column_stack([robot.lower, robot.upper]) / robot.joint_units[:, None]).tolist()
    ]
    rows = table.rows("limits_deg", 2, default=own)
    if len(rows) != robot.joints:
        raise table.refuse(
            "limits_deg", f"has {len(rows)} pairs for {robot.joints} joints.", "Give one for each."
        )
    for i, ((low, high), (least, most)) in enumerate(zip(rows, own, strict=True), start=1):
        if not least - 1e-9 <= low < high <= most + 1e-9:
            raise table.refuse(
                "limits_deg",
                f"joint {i} [{low:g}, {high:g}] is not within the robot's [{least:g}, {most:g}].",
                "Limits of a cell only make those of the robot narrower.",
            )
    # A robot file with one joint matrix states the count of its controller.
    usual = next(iter(robot.joint_matrices)) if len(robot.joint_matrices) == 1 else "none"
    return RobotSection(
        model=robot,
        coupling=table.text("joint_coupling", usual, allowed=("none", *robot.joint_matrices)),
        driver=driver,
        url=read_url(table, by_hand=declared is not None and declared.by_hand),
        speed_mm_s=table.number("speed_mm_s", SPEED_CAP_MM_S, low=1.0, high=SPEED_CAP_MM_S),
        speed_deg_s=table.number("speed_deg_s", SPEED_CAP_DEG_S, low=0.1, high=SPEED_CAP_DEG_S),
        limits_deg=tuple((low, high) for low, high in rows),
        table_z_mm=table.number("table_z_mm", 0.0),
        keep_out=tuple(read_keep_out(table)),
        home_deg=_home(table, rows),
        repeatability_deg=table.number("repeatability_deg", 0.0008, low=0.0),
        repeatability_mm=table.number("repeatability_mm", 0.003, low=0.0),
        absolute_accuracy=table.word("absolute_accuracy", ABSOLUTE_ACCURACY, "unknown"),
        options=read_options(table, options),
        file=file,
    )


def _refuse_undriven(table: TomlTable, robot: Robot, driver: str) -> None:
    """Refuse a robot with joints that its driver does not drive.

    Otherwise mm could be sent to a joint that expects degrees. A person can drive any joint.
    """
    try:
        declared = robot_driver(driver)
    except ConfigError:
        return  # the code that needs the driver reports it
    if declared.by_hand:
        return
    slides = [axis for axis, kind in zip(robot.axes, robot.kinds, strict=True) if kind == "slides"]
    do = (
        "Name the driver of a robot that is driven by hand ('truepose docs howto/without-a-driver'); or drive it by "
        "its own controller, write joints and readings into a data set (NAME.csv, NAME.toml) and identify from that; "
        "or give the robot file without that axis where it stands still."
    )
    if slides:
        raise table.refuse(
            "model",
            f"'{robot.name}' has joints that slide ({', '.join(slides)}), and the driver '{driver}' moves none.",
            do,
        )
    if robot.joints != declared.joints:
        raise table.refuse(
            "model",
            f"'{robot.name}' has {robot.joints} joints, and the driver '{driver}' moves {declared.joints}.",
            do,
        )


def read_url(table: TomlTable, *, by_hand: bool) -> str:
    """Read the address of a device; a manual one has none."""
    return table.text("url", "") if by_hand else table.text("url")


def read_options(table: TomlTable, options: Sequence[Option | TextOption]) -> dict[str, float | str]:
    """Read the options of a driver from its table of the cell file; required ones must be there."""
    return {
        option.key: table.text(option.key, allowed=option.allowed or None)
        if isinstance(option, TextOption)
        else table.number(option.key, low=option.low, high=option.high)
        for option in options
        if option.key in table.values or (isinstance(option, Option) and option.needed)
    }


def _home(table: TomlTable, limits_deg: Sequence[Sequence[float]]) -> tuple[float, ...] | None:
    home = table.numbers("home_deg")
    if home is None:
        return None
    if len(home) != len(limits_deg):
        raise table.refuse(
            "home_deg", f"has {len(home)} joints, the robot {len(limits_deg)}.", "Give one angle for each."
        )
    for i, (q, (low, high)) in enumerate(zip(home, limits_deg, strict=True), start=1):
        if not low <= q <= high:
            raise table.refuse(
                "home_deg",
                f"joint {i} at {q:g} is outside limits_deg [{low:g}, {high:g}].",
                "Correct one of the two.",
            )
    return home

"""The `[robot]` table of a cell file: the robot, its driver, its speed and its limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    Field,
    PlainValidator,
    Strict,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)

from acquisition.cell.device_section import DeviceSection, for_driver
from acquisition.cell.obstacles import Box
from acquisition.file_table import List, Pair, Place, Text, as_read, refused, told
from calib.arm import Robot, built_in_robots, load_robot, own_robot_table, robot_from
from calib.errors import DataError
from calib.text import turns_writing
from drivers import ROBOTS, RobotDriver, robot_driver
from drivers.errors import ConfigError

SPEED_CAP_MM_S, SPEED_CAP_DEG_S = 500.0, 20.0  # Nubiola, thesis 2.5: faster moves warm and shake the arm


def _is_robot(robot: Any) -> Robot:
    if isinstance(robot, str):
        as_read(robot)
    if not isinstance(robot, Robot):
        raise ValueError("no text")
    return robot


def _own_limits(robot: Robot) -> tuple[tuple[float, float], ...]:
    """Return the limits of the joints of a robot, in deg, or in mm if they slide."""
    limits = np.column_stack([robot.lower, robot.upper]) / robot.joint_units[:, None]
    return tuple((low, high) for low, high in limits.tolist())


class RobotSection(DeviceSection):
    """The robot of the cell and how fast and how far it may go.

    Joints are counted in deg, or in mm if they slide, also if a name ends in `_deg`.
    """

    drivers = ROBOTS

    driver: Annotated[Text, told(f"Name of the driver: {', '.join(ROBOTS)}.", next(iter(ROBOTS)))]
    model: Annotated[
        Robot,
        PlainValidator(_is_robot),
        WithJsonSchema({"type": "string", "minLength": 1}),
        told("Name of a built-in robot, or path of a robot file.", "abb-irb120"),
    ]
    joint_coupling: Annotated[
        Text | None,
        told(
            "Name of the joint matrix of the controller; left out: the robot file's, or `none`.", "fanuc-j23"
        ),
    ] = None
    speed_mm_s: Annotated[float, told("Speed of the tool, mm/s.", 250.0, ge=1.0, le=SPEED_CAP_MM_S)] = (
        SPEED_CAP_MM_S
    )
    speed_deg_s: Annotated[float, told("Speed of the joints, deg/s.", 9.0, ge=0.1, le=SPEED_CAP_DEG_S)] = (
        SPEED_CAP_DEG_S
    )
    absolute_accuracy: Annotated[
        Literal["on", "off", "unknown"],
        told("Whether the controller corrects by its maker's calibration.", "off"),
    ] = "unknown"
    limits_deg: Annotated[
        tuple[Pair, ...],
        Strict(False),
        Field(default_factory=lambda given: _own_limits(given["model"])),
        told(
            "Limits of each joint within the robot's, deg, or mm if it slides; left out: the robot's.",
            [[-90.0, 90.0]],
        ),
    ]
    table_z_mm: Annotated[float, told("Height of the table; the robot stays above it, mm.", 20.0)] = 0.0
    keep_out: Annotated[
        tuple[Annotated[tuple[Place, Place], Strict(False)], ...],
        Strict(False),
        told(
            "Boxes that the robot must not enter, without names: the lower and the upper corner of each, mm.",
            [[[-900.0, 300.0, 0.0], [900.0, 400.0, 900.0]]],
            do="Give a list of boxes, each of two corners, the lower one first.",
        ),
    ] = ()
    home_deg: Annotated[
        List[float] | None,
        told(
            "Posture over which the robot moves where the straight move is not clear, deg, or mm if a joint slides; "
            "left out: one high above the table.",
            [0.0, 20.0, 0.0, 0.0, 60.0, 0.0],
        ),
    ] = None
    repeatability_deg: Annotated[float, told("Repeatability of turning joints, deg.", 0.001, ge=0.0)] = 0.0008
    repeatability_mm: Annotated[float, told("Repeatability of sliding joints, mm.", 0.005, ge=0.0)] = 0.003
    file: Annotated[
        dict[str, Any] | None,
        told("Written in a record: the content of the robot file `model`, as a table.", None),
    ] = None

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> type[Self]:
        if cls.of_driver is None and isinstance(name := values.get("driver"), str):
            with suppress(ConfigError):  # an unknown driver is named when its device is opened
                return for_driver(cls, robot_driver(name))
        return cls

    @model_validator(mode="before")
    @classmethod
    def _load(cls, values: Any, info: ValidationInfo) -> Any:
        """Replace the name of the robot by the robot, and add the file of one that is not in the library."""
        name, given = (values.get("model"), values.get("file")) if isinstance(values, Mapping) else ("", None)
        if not isinstance(name, str) or not name or turns_writing(name):
            return values
        folder = (info.context or {}).get("folder")
        try:
            file = given if given and isinstance(given, Mapping) else own_robot_table(name, folder)
            robot = load_robot(name) if file is None else robot_from(file, Path(name))
        except DataError as error:
            raise refused("model", str(error).removesuffix(f" {error.do}"), error.do) from error
        if robot.name in built_in_robots() and robot.name != name:
            what = f"is the file of a robot with the name of one of the library, '{robot.name}'."
            raise refused("model", what, "Give it another name.")
        return {**values, "model": robot, **({"file": file} if file and not given else {})}

    @model_validator(mode="after")
    def _fits_the_robot(self) -> Self:
        robot = self.model
        self._refuse_undriven()
        ways = ("none", *robot.joint_matrices)
        if self.joint_coupling not in (None, *ways):
            what, do = f"is {self.joint_coupling!r}.", f"Use {' or '.join(repr(way) for way in ways)}."
            raise refused("joint_coupling", what, do)
        if (pairs := len(self.limits_deg)) != robot.joints:
            raise refused("limits_deg", f"has {pairs} pairs for {robot.joints} joints.", "Give one for each.")
        own = zip(self.limits_deg, _own_limits(robot), strict=True)
        for i, ((low, high), (least, most)) in enumerate(own, start=1):
            if not least - 1e-9 <= low < high <= most + 1e-9:
                what = f"joint {i} [{low:g}, {high:g}] is not within the robot's [{least:g}, {most:g}]."
                raise refused("limits_deg", what, "Limits of a cell only make those of the robot narrower.")
        for i, (low, high) in enumerate(self.keep_out, start=1):
            if not np.less(low, high).all():
                raise refused("keep_out", f"box {i} is no box.", "Give two corners, the lower one first.")
        if self.home_deg is not None and len(self.home_deg) != robot.joints:
            what = f"has {len(self.home_deg)} joints, the robot {robot.joints}."
            raise refused("home_deg", what, "Give one angle for each.")
        for i, (q, (low, high)) in enumerate(
            zip(self.home_deg or (), self.limits_deg, strict=False), start=1
        ):
            if not low <= q <= high:
                what = f"joint {i} at {q:g} is outside limits_deg [{low:g}, {high:g}]."
                raise refused("home_deg", what, "Correct one of the two.")
        return self

    def _refuse_undriven(self) -> None:
        """Refuse a robot with joints that its driver does not drive.

        Otherwise mm could be sent to a joint that expects degrees. A person can drive any joint.
        """
        try:
            declared = self.declared
        except ConfigError:
            return  # the code that needs the driver reports it
        if declared.by_hand:
            return
        robot, driver = self.model, self.driver
        slides = [axis for axis, kind in zip(robot.axes, robot.kinds, strict=True) if kind == "slides"]
        do = (
            "Name the driver of a robot that is driven by hand ('truepose docs howto/without-a-driver'); or drive it "
            "by its own controller, write joints and readings into a data set (NAME.csv, NAME.toml) and identify from "
            "that; or give the robot file without that axis where it stands still."
        )
        if slides:
            what = f"'{robot.name}' has joints that slide ({', '.join(slides)}), and the driver '{driver}' moves none."
            raise refused("model", what, do)
        if robot.joints != declared.joints:
            what = f"'{robot.name}' has {robot.joints} joints, and the driver '{driver}' moves {declared.joints}."
            raise refused("model", what, do)

    @property
    def declared(self) -> RobotDriver:
        """The declaration of the driver.

        Raises
        ------
        ConfigError
            The driver is unknown.
        """
        return robot_driver(self.driver)

    @property
    def coupling(self) -> str:
        """The joint matrix of the robot, or `none`; a robot file with only one states the count of its controller."""
        ways = list(self.model.joint_matrices)
        return self.joint_coupling or (ways[0] if len(ways) == 1 else "none")

    @property
    def boxes(self) -> tuple[Box, ...]:
        """The boxes that the robot must not enter."""
        return tuple(
            Box(name=f"keep-out box {i}", low_mm=low, high_mm=high)
            for i, (low, high) in enumerate(self.keep_out, start=1)
        )

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

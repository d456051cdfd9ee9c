"""The cell file `cell.toml` (`truepose-cell/1`): which robot, which instrument, where, and what must not be hit.

Lengths mm, angles deg, speeds mm/s and deg/s; joints deg, and mm where they slide. Everything is checked here, by file
and key, so that the rest of the program can believe a `Cell`.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import ArrayLike, NDArray

from acquisition.cell.arm import TOOL_RADIUS_MM, Arm
from acquisition.cell.clearance import Clearance
from acquisition.cell.obstacles import Obstacle, Table, read_fixtures, read_keep_out
from acquisition.cell.position_uncertainty import stated
from acquisition.errors import as_config_error
from calib.arm import Load, Robot, built_in_robots, load_robot, own_robot_table, robot_from
from calib.text import TomlTable, Vector, parse_toml, read_toml
from drivers import InstrumentDriver, Option, RobotDriver, TextOption, instrument_driver, robot_driver
from drivers.errors import ConfigError

FORMAT = "truepose-cell/1"
SPEED_CAP_MM_S, SPEED_CAP_DEG_S = 500.0, 20.0  # Nubiola, thesis 2.5: faster moves warm and shake the arm


@dataclass(frozen=True)
class NoiseFigures:
    """Declared noise of an instrument, 1 sigma: points mm and ppm of the distance, turns mrad, lengths mm."""

    range_mm: float = 0.010
    range_ppm: float = 2.0
    transverse_mm: float = 0.010
    transverse_ppm: float = 6.0
    rotation_mrad: float = 0.0  # 0: turns are recorded and not weighed
    length_mm: float = 0.0005


@dataclass(frozen=True)
class RobotSection:
    """The robot of the cell and how fast and how far it may go. `coupling`: its joint matrix, or `none`.

    Joints are counted in deg, and in mm where they slide, also where a name ends in `_deg`.

    home_deg: a posture over which every pose can be reached, where the cell file has one; options: what only its
    driver uses; file: the parsed robot file of a robot that is not in the library.
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

    @property
    def declared(self) -> RobotDriver:
        """The declaration of its driver. Raises ConfigError for an unknown one."""
        return robot_driver(self.driver)

    def model_angles(self, joints_deg: ArrayLike) -> NDArray[np.float64]:
        """(n, N) joints of the kinematic model, rad or mm, where the controller counts (n, N) deg or mm."""
        counted = np.asarray(joints_deg, dtype=np.float64) * self.model.joint_units
        return self.model.model_angles(counted, self.coupling)

    def counted(self, joints: ArrayLike) -> NDArray[np.float64]:
        """(n, N) deg or mm: what the controller counts at joints (n, N) of the model, rad or mm."""
        counted = self.model.controller_angles(np.asarray(joints, dtype=np.float64), self.coupling)
        return counted / self.model.joint_units

    @property
    def limits(self) -> NDArray[np.float64]:
        """(N, 2) limits of the joints as the controller counts them, rad or mm."""
        return np.array(self.limits_deg) * self.model.joint_units[:, None]

    def named(self, k: int) -> str:
        """The joint with index k, from 0, in words: 'joint 3', 'axis e1'."""
        axis = self.model.axes[k]
        return f"joint {axis[1:]}" if axis.startswith("j") else f"axis {axis}"

    def said(self, joints_deg: Sequence[float] | NDArray[np.float64], decimals: int | None = None) -> str:
        """Joints in words, as the controller counts them: '90, 0, -45 deg', or each with its unit where some slide."""
        numbers = [f"{q:g}" if decimals is None else f"{q:.{decimals}f}" for q in joints_deg]
        if not self.model.slides:
            return f"{', '.join(numbers)} deg"
        each = zip(self.model.axes, numbers, self.model.units, strict=True)
        return ", ".join(f"{axis} {number} {unit}" for axis, number, unit in each)


@dataclass(frozen=True)
class InstrumentSection:
    """The instrument of the cell. `one_smr`: a person moves the only SMR from nest to nest.

    expected_within_mm: a target seen farther from where the nominal robot has it is not taken for it; options: what
    only its driver uses.
    """

    name: str
    driver: str
    url: str
    station_mm: Vector
    noise: NoiseFigures
    one_smr: bool
    expected_within_mm: float
    options: Mapping[str, float | str]

    @property
    def declared(self) -> InstrumentDriver:
        """The declaration of its driver."""
        return instrument_driver(self.driver)

    @property
    def nominal_mm(self) -> float:
        """Length of a ballbar with its extension bars."""
        return float(self.options["nominal_mm"])


@dataclass(frozen=True)
class ToolSection:
    """Targets on the tool, flange frame; mass and centre None: as in the robot file.

    radius_mm: of the capsules from the flange to the targets; u_mm: standard uncertainty of the targets per axis,
    of those where it is stated.
    """

    targets: Mapping[str, Vector]
    normals: Mapping[str, Vector]
    radius_mm: float
    mass_kg: float | None
    cog_mm: Vector | None
    u_mm: Mapping[str, float]


@dataclass(frozen=True)
class Cell:
    """A cell: robot, instrument, tool, nests and obstacles. `source` is the text of its file, kept in the record.

    nests_u_mm: standard uncertainty of the nests per axis, of those where it is stated. time_scale and rehearsed,
    whether prompts confirm themselves, only count simulated.
    """

    name: str
    robot: RobotSection
    instrument: InstrumentSection
    nests: Mapping[str, Vector]
    nests_u_mm: Mapping[str, float]
    tool: ToolSection
    fixtures: tuple[Obstacle, ...]
    time_scale: float
    rehearsed: bool
    source: str = field(repr=False)

    @cached_property
    def clearance(self) -> Clearance:
        """The obstacles of arm and tool: the table, keep-out boxes and fixtures."""
        robot, tool = self.robot, self.tool
        arm = Arm.of(robot.model, robot.coupling, tool.targets, tool.radius_mm)
        return Clearance.of(arm, (Table(robot.table_z_mm), *robot.keep_out, *self.fixtures))

    @property
    def unstated(self) -> tuple[str, ...]:
        """The balls of a ballbar's cell of whose positions its file does not state how well they are known."""
        known = {**self.nests_u_mm, **self.tool.u_mm}
        balls = (*self.nests, *self.tool.targets) if self.instrument.declared.measures_lengths else ()
        return tuple(name for name in balls if name not in known)

    @property
    def loads(self) -> tuple[Load, ...]:
        """Masses that load the joints: the robot's own, with its tool replaced by the cell's."""
        if self.tool.mass_kg is None or self.tool.cog_mm is None:
            return self.robot.model.loads
        last = self.robot.model.joints
        own = tuple(load for load in self.robot.model.loads if load.link != last)
        return (*own, Load(last, self.tool.mass_kg, self.tool.cog_mm))


@as_config_error()
def read_cell(path: Path) -> Cell:
    """Read `cell.toml`. Raises ConfigError naming file and key."""
    text, table = read_toml(path)
    return cell_from(table, str(path), beside=path.parent, source=text)


@as_config_error()
def cell_from(table: Mapping[str, Any], file: str, *, beside: Path | None = None, source: str = "") -> Cell:
    """A cell from a parsed table. `file` is named in refusals; `beside`: where a robot file is looked for."""
    top = TomlTable(table, file)
    top.text("format", allowed=(FORMAT,))
    top.only(("format", "name", "robot", "instrument", "world", "tool", "fixture", "simulation"))
    world = top.table("world")
    world.only(("nests", "u_mm", "nests_u_mm"))
    nests = world.vectors("nests")
    if len(nests) < 3:
        raise top.refuse("world.nests", f"names {len(nests)} nests.", "The world frame needs three.")
    origin, second, third = (np.array(nest) for nest in list(nests.values())[:3])
    if np.linalg.norm(np.cross(second - origin, third - origin)) < 100.0**2:
        raise top.refuse(
            "world.nests", "do not span a frame.", "Put them at least 100 mm apart, not in a row."
        )
    tool = _tool(top.table("tool"), nests)
    simulation = top.table("simulation")
    for place in simulation.vectors("misplaced_mm"):
        if place not in nests and place not in tool.targets:
            raise simulation.refuse(
                "misplaced_mm", f"names {place}, which is neither nest nor target.", "Correct the name."
            )
    robot = _robot(top.table("robot"), beside)
    return Cell(
        name=top.text("name"),
        robot=robot,
        instrument=_instrument(top.table("instrument")),
        nests=nests,
        nests_u_mm=stated(world, "nests_u_mm", nests),
        tool=tool,
        fixtures=tuple(read_fixtures(top)),
        time_scale=simulation.number("time_scale", 1.0, low=1e-3, high=1e6),
        rehearsed=simulation.text("operator", "person", ("person", "confirms")) == "confirms",
        source=_whole(source, table, robot.file),
    )


def _whole(source: str, table: Mapping[str, Any], file: Mapping[str, Any] | None) -> str:
    """The text of the cell file with the robot file that it names: a record is read where that file is not."""
    if file is None or "file" in table["robot"]:
        return source or tomli_w.dumps(table)
    if source:  # behind the text, which keeps its comments, where TOML allows that: it adds nothing to robot = { ... }
        whole = f"{source.rstrip()}\n\n{tomli_w.dumps({'robot': {'file': file}})}"
        with suppress(tomllib.TOMLDecodeError):
            tomllib.loads(whole)
            return whole
    return tomli_w.dumps({**table, "robot": {**table["robot"], "file": file}})


@as_config_error()
def cell_of_record(source: str, where: str) -> Cell:
    """The cell of a record, from the text stored there. Raises ConfigError."""
    return cell_from(parse_toml(source, where), where, beside=Path(where).parent, source=source)


def _robot(table: TomlTable, beside: Path | None) -> RobotSection:
    driver = table.text("driver")
    declared = None
    with suppress(ConfigError):  # an unknown driver is named when its device is opened
        declared = robot_driver(driver)
    options = () if declared is None else declared.options
    table.only(
        (
            *("model", "joint_coupling", "driver", "url", "speed_mm_s", "speed_deg_s", "limits_deg"),
            *("table_z_mm", "keep_out", "home_deg", "repeatability_deg", "repeatability_mm", "file"),
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
    # A robot file with one joint matrix says how its controller counts.
    usual = next(iter(robot.joint_matrices)) if len(robot.joint_matrices) == 1 else "none"
    return RobotSection(
        model=robot,
        coupling=table.text("joint_coupling", usual, allowed=("none", *robot.joint_matrices)),
        driver=driver,
        url=_url(table, by_hand=declared is not None and declared.by_hand),
        speed_mm_s=table.number("speed_mm_s", SPEED_CAP_MM_S, low=1.0, high=SPEED_CAP_MM_S),
        speed_deg_s=table.number("speed_deg_s", SPEED_CAP_DEG_S, low=0.1, high=SPEED_CAP_DEG_S),
        limits_deg=tuple((low, high) for low, high in rows),
        table_z_mm=table.number("table_z_mm", 0.0),
        keep_out=tuple(read_keep_out(table)),
        home_deg=_home(table, rows),
        repeatability_deg=table.number("repeatability_deg", 0.0008, low=0.0),
        repeatability_mm=table.number("repeatability_mm", 0.003, low=0.0),
        options=_options(table, options),
        file=file,
    )


def _refuse_undriven(table: TomlTable, robot: Robot, driver: str) -> None:
    """Refuse a robot with joints that its driver does not drive: mm must never be sent where degrees are meant.

    A person drives any.
    """
    try:
        declared = robot_driver(driver)
    except ConfigError:
        return  # whoever needs the driver says so
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


def _url(table: TomlTable, *, by_hand: bool) -> str:
    """The address of a device; a manual one has none."""
    return table.text("url", "") if by_hand else table.text("url")


def _options(table: TomlTable, options: Sequence[Option | TextOption]) -> dict[str, float | str]:
    """The options of a driver in its table of the cell file; those that it needs are demanded."""
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


def _instrument(table: TomlTable) -> InstrumentSection:
    driver, noise = table.text("driver"), NoiseFigures()
    try:
        declared = instrument_driver(driver)
    except ConfigError as error:
        raise table.refuse("driver", f"{error.message}.", "Name one of them.") from error
    if declared.measures_lengths:
        figures, others = ("length_mm",), ()
        station = (0.0, 0.0, 0.0)
    else:
        figures = ("range_mm", "range_ppm", "transverse_mm", "transverse_ppm", "rotation_mrad")
        others = ("station_mm", "one_smr", "expected_within_mm")
        station = table.vector("station_mm")
    table.only(("driver", "url", *figures, *others, *(option.key for option in declared.options)))
    return InstrumentSection(
        name=declared.instrument,
        driver=driver,
        url=_url(table, by_hand=declared.by_hand),
        station_mm=station,
        noise=NoiseFigures(**{name: table.number(name, getattr(noise, name), low=0.0) for name in figures}),
        one_smr=table.flag("one_smr", False),
        expected_within_mm=table.number("expected_within_mm", 50.0, low=1.0, high=10_000.0),
        options=_options(table, declared.options),
    )


def _tool(table: TomlTable, nests: Mapping[str, Vector]) -> ToolSection:
    table.only(("targets", "normals", "radius_mm", "mass_kg", "cog_mm", "u_mm", "targets_u_mm"))
    targets = table.vectors("targets")
    if not targets:
        raise table.refuse("targets", "is missing.", "Name the targets on the tool, e.g. T1 = [0, 0, 125].")
    for name in (*targets, *nests):
        if not (name.isidentifier() and name.isascii()):
            raise table.refuse("targets", f"{name!r} is not a name.", "Use letters and digits.")
    if both := set(targets) & set(nests):
        raise table.refuse("targets", f"{min(both)} is the name of a nest as well.", "Rename one.")
    normals = table.vectors("normals")
    for name in normals:
        if name not in targets:
            raise table.refuse("normals", f"names {name}, which is no target.", "Correct the name.")
        if not any(normals[name]):
            raise table.refuse("normals", f"of {name} is no direction.", "Give where the target looks.")
    if ("mass_kg" in table.values) != ("cog_mm" in table.values):
        raise table.refuse("mass_kg", "and cog_mm belong together.", "Give both or none.")
    weighed = "mass_kg" in table.values
    return ToolSection(
        targets=targets,
        normals=normals,
        radius_mm=table.number("radius_mm", TOOL_RADIUS_MM, low=0.1, high=1000.0),
        mass_kg=table.number("mass_kg", low=1e-6) if weighed else None,
        cog_mm=table.vector("cog_mm") if weighed else None,
        u_mm=stated(table, "targets_u_mm", targets),
    )

"""The cell file `cell.toml` (`truepose-cell/1`): which robot, which instrument, where, and what must not be hit.

Lengths mm, angles deg, speeds mm/s and deg/s; joints deg, and mm where they slide. Everything is checked here, by file
and key, so that the rest of the program can believe a `Cell`.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from acquisition.cell.arm import TOOL_RADIUS_MM, Arm
from acquisition.cell.clearance import Clearance
from acquisition.cell.obstacles import Obstacle, Table, read_fixtures
from acquisition.cell.position_uncertainty import stated
from acquisition.cell.robot_section import RobotSection, read_options, read_robot, read_url
from acquisition.errors import as_config_error
from calib.arm import Load
from calib.text import TomlTable, Vector, parse_toml, read_toml
from drivers import InstrumentDriver, instrument_driver
from drivers.errors import ConfigError

FORMAT = "truepose-cell/1"


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
    robot = read_robot(top.table("robot"), beside)
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
        url=read_url(table, by_hand=declared.by_hand),
        station_mm=station,
        noise=NoiseFigures(**{name: table.number(name, getattr(noise, name), low=0.0) for name in figures}),
        one_smr=table.flag("one_smr", False),
        expected_within_mm=table.number("expected_within_mm", 50.0, low=1.0, high=10_000.0),
        options=read_options(table, declared.options),
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

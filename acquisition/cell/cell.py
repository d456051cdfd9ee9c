"""The cell file `cell.toml` (`truepose-cell/1`): robot, instrument, places, obstacles.

Lengths are in mm, angles in deg, speeds in mm/s and deg/s; joints in deg, or in mm if they slide. All checks are made
here and name file and key, so that the rest of the program can rely on a `Cell`.

**Has the instrument moved?** Three nests are measured twice and judged according to the noise of the readings. Each
nest moved by d_i between the two; a reading has the instrument's declared covariance S_i, and seating the SMR again
adds u^2 I. If nothing moved,

    T = sum_i d_i^T [2 (S_i + u^2 I)]^-1 d_i

is chi-squared with 3 degrees of freedom per nest. Beyond its `FALSE_ALARM` quantile the instrument has a new
station and the world frame is built again. Otherwise the old frame stays, so that noise alone does not move it.
Source: the usual test for a change with known covariance (Johnson & Wichern, ch. 5).

**Lengths of a ballbar.** A bar has its body and any of its extension bars, each at most once. A QC20-W of 100 mm with
bars of 50, 150 and 300 mm reads 100, 150, 250, 300 ... 600 mm, plus or minus its stroke. It needs 150 mm along the tool
triangle, 300 mm along the base triangle and the legs. Source: Nubiola, thesis, section 4.2.

**Fixtures** that carry a ball of the base, its cup or its post, are where the ball is. Lengths in mm.

**Identity of a device.** The maker and model that a device reports are compared with the cell file. Makers write one
model in many spellings ("IRB 120-3/0.6", "LR Mate 200iC"). The name from the robot file must occur in the report of
the controller, with any signs between its letters, and must end there: an IRB 1200 is no IRB 120. A protocol that
reports no model proves nothing, and is not treated as a mismatch. A user's own robot file may have any name; then only
the maker counts.

**Uncertainty** of nests, cups and tool targets is one standard deviation per axis, mm:

    [world]                                   [tool]
    u_mm = 0.3                                u_mm = 0.05
    nests_u_mm = { B2 = 0.02 }                targets_u_mm = { T3 = 0.01 }

A data set of distances uses such positions with their uncertainty, never as exact. If it is not stated, a cup counts as
taught by a robot as delivered, and a tool target as turned or milled according to a drawing. Measured points determine
the tool and their frame themselves; there a tool target is freed if the cell file states its uncertainty.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import tomli_w
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, PrivateAttr, Strict, model_validator
from scipy.special import chdtri

from acquisition.cell.arm import TOOL_RADIUS_MM, CellArm
from acquisition.cell.clearance import Clearance
from acquisition.cell.device_section import InstrumentSection, NoiseFigures
from acquisition.cell.obstacles import Array, Box, Fixture, FloorObstacle, Obstacle, Post
from acquisition.cell.robot_section import RobotSection
from acquisition.errors import as_config_error
from acquisition.file_table import (
    Place,
    Table,
    Text,
    Written,
    no_default,
    read_table,
    refuse_unknown,
    refused,
    told,
)
from calib.arm import Load, built_in_robots
from calib.data import LEAST, Noise
from calib.text import Vector, parse_toml, read_toml
from drivers import INSTRUMENTS
from drivers.errors import ConfigError
from drivers.interfaces import Identity

FORMAT = "truepose-cell/1"

SEAT_MM = 0.005  # centring and seat of an SMR in its nest; makers state 2.5 to 12 um for the centring

FALSE_ALARM = 1e-3

_STRAY = 3.0  # standard deviations by which the distance of two balls may differ from the cell file

CARRIES_MM = 30.0  # a fixture that comes this near to the centre of a ball carries it

TAUGHT_MM = 1.0

"""A cup touched by an uncalibrated robot. Nubiola, thesis, Table 4.3: 1.355 mm on the average, 1.029 mm of scatter."""

MADE_MM = 0.2

"""A ball on a tool made by drawing: ISO 2768-1 medium allows 0.3 mm from 120 to 400 mm, as a rectangle 0.17 mm."""

_MOST_MM = 1000.0


def _plausible(u_mm: float) -> float:
    if 0.0 < u_mm < LEAST:
        raise refused("", f"is {u_mm!r}: too small to be true.", "Use 0 for exact.")
    return u_mm


Uncertainty = Annotated[float, Field(ge=0.0, le=_MOST_MM), AfterValidator(_plausible)]
_DO = f"Give a number from 0 to {_MOST_MM:g}."


class WorldSection(Table):
    """The frame of the world: its nests."""

    nests: Annotated[
        dict[str, Place],
        told(
            "Three named points or more, mm: the first is the origin, the second on the x axis.",
            {"N1": [0.0, 0.0, 0.0], "N2": [600.0, 0.0, 0.0], "N3": [0.0, 600.0, 0.0]},
        ),
    ] = {}  # noqa: RUF012 pydantic copies it
    u_mm: Annotated[
        Uncertainty | None,
        told("Standard uncertainty of all nests per axis, mm; 0: exact; left out: not stated.", 0.3, do=_DO),
    ] = None
    nests_u_mm: Annotated[
        dict[str, Uncertainty],
        told("By name, for nests whose uncertainty differs from `u_mm`, mm.", {"B2": 0.02}, do=_DO),
    ] = {}  # noqa: RUF012

    @model_validator(mode="after")
    def _spans_a_frame(self) -> Self:
        if len(self.nests) >= 3:
            origin, second, third = np.array(list(self.nests.values())[:3])
            if np.linalg.norm(np.cross(second - origin, third - origin)) < 100.0**2:
                do = "Put them at least 100 mm apart, not in a row."
                raise refused("nests", "do not span a frame.", do)
        refuse_unknown("nests_u_mm", self.nests_u_mm, self.nests)
        return self


_NAME_THEM = "Name the targets on the tool, e.g. T1 = [0, 0, 125]."


class ToolSection(Table):
    """Targets on the tool, in the flange frame."""

    targets: Annotated[
        dict[str, Place],
        told("Named points, mm.", {"T1": [0.0, 0.0, 125.0]}, missing=_NAME_THEM),
    ]
    normals: Annotated[
        dict[str, Place],
        told("Where a target faces; left out: visible from everywhere.", {"T1": [0.0, 0.0, 1.0]}),
    ] = {}  # noqa: RUF012
    radius_mm: Annotated[
        float, told("Radius of the capsules from the flange to the targets, mm.", 25.0, ge=0.1, le=1000.0)
    ] = TOOL_RADIUS_MM
    mass_kg: Annotated[
        float | None,
        told("Mass of the tool, kg, together with `cog_mm`; left out: the robot file's load.", 2.7, ge=1e-6),
    ] = None
    cog_mm: Annotated[Place | None, told("Centre of gravity of the tool, mm.", [50.0, 25.0, 100.0])] = None
    u_mm: Annotated[
        Uncertainty | None,
        told("Standard uncertainty of targets per axis, mm; 0: exact; left out: not stated.", 0.05, do=_DO),
    ] = None
    targets_u_mm: Annotated[
        dict[str, Uncertainty],
        told("By name, for targets whose uncertainty differs from `u_mm`, mm.", {"T3": 0.01}, do=_DO),
    ] = {}  # noqa: RUF012

    @model_validator(mode="after")
    def _names_targets(self) -> Self:
        if not self.targets:
            raise refused("targets", "is missing.", _NAME_THEM)
        for name, normal in self.normals.items():
            if name not in self.targets:
                raise refused("normals", f"names {name}, which is no target.", "Correct the name.")
            if not any(normal):
                raise refused("normals", f"of {name} is no direction.", "Give where the target looks.")
        if (self.mass_kg is None) != (self.cog_mm is None):
            raise refused("mass_kg", "and cog_mm belong together.", "Give both or none.")
        refuse_unknown("targets_u_mm", self.targets_u_mm, self.targets)
        return self

    @property
    def stated_mm(self) -> Mapping[str, float]:
        """The standard uncertainty of the targets per axis, if it is stated."""
        return _stated(self.u_mm, self.targets) | self.targets_u_mm


def _stated(u_mm: float | None, names: Iterable[str]) -> dict[str, float]:
    return {} if u_mm is None else dict.fromkeys(names, u_mm)


class SimulationSection(Table):
    """What a simulated cell is like: read only with `--simulate`."""

    seed: Annotated[int, told("Seed from which the simulated robot is drawn.", 7, ge=0, le=2**53)] = 1
    time_scale: Annotated[float, told("Simulated seconds per second.", 200.0, ge=1e-3, le=1e6)] = 1.0
    operator: Annotated[
        Literal["person", "confirms"], told("`confirms`: prompts confirm themselves.", "confirms")
    ] = "person"
    misplaced_mm: Annotated[
        dict[str, Place],
        told(
            "True errors of nests and targets, mm; left out: drawn from `u_mm` and the seed.",
            {"B2": [0.3, 0.0, 0.0]},
        ),
    ] = {}  # noqa: RUF012
    effects: Annotated[
        tuple[Text, ...],
        Strict(False),
        told(
            'Labels of hidden effects, or `["none"]`; left out: by the seed.',
            ["backlash:j4"],
            do="Give a list of labels.",
        ),
    ] = ()
    effect_size: Annotated[float, told("Size of an effect over the noise.", 5.0, ge=0.0, le=1e6)] = 3.0
    readings: Annotated[int, told("Readings to which drifts are scaled.", 310, ge=1, le=1_000_000)] = 300
    seconds_per_reading: Annotated[float, told("Time of one of them, s.", 30.0, ge=0.0, le=1e6)] = 20.0
    clock_offset_s: Annotated[float, told("Largest offset of devices' clocks, s.", 2.0, ge=0.0, le=1e9)] = 0.0
    clock_rate_ppm: Annotated[float, told("Largest error of their rate, ppm.", 50.0, ge=0.0, le=1e6)] = 0.0
    serial: Annotated[
        Written,
        told(
            "Serial number of a simulated ABB or UR controller; left out: the same in every cell.", "120-501"
        ),
    ] = ""
    dialect: Annotated[
        Written,
        told("Dialect or software of a simulated device, as `truepose mock --dialect`.", "polyscope-x"),
    ] = ""


class Cell(Table):
    """A cell: the content of `cell.toml`. Robot, instrument, tool, nests and obstacles."""

    format: Annotated[Literal["truepose-cell/1"], told("The format of the file.", FORMAT)]
    name: Annotated[Text, told("Name of the cell.", "cell 7")]
    robot: Annotated[RobotSection, told("The robot.", {})]
    instrument: Annotated[InstrumentSection, told("The instrument.", {})]
    world: Annotated[WorldSection, told("The frame of the world.", {})]
    tool: Annotated[ToolSection, told("The tool, in the flange frame.", {})]
    fixture: Annotated[tuple[Fixture, ...], Strict(False), told("Obstacles: each a box or a post.", [])] = ()
    simulation: Annotated[
        SimulationSection,
        told("Read only with `--simulate`.", {"seed": 7}, json_schema_extra=no_default),
    ] = SimulationSection()
    _source: str = PrivateAttr("")

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        nests, targets = self.world.nests, self.tool.targets
        fewest = 1 if self.instrument.declared.measures_lengths else 3  # distances need no frame
        if len(nests) < fewest:
            raise refused("world.nests", f"names {len(nests)} nests.", "The world frame needs three.")
        for name in (*targets, *nests):
            if not (name.isidentifier() and name.isascii()):
                key = "tool.targets" if name in targets else "world.nests"
                raise refused(key, f"{name!r} is not a name.", "Use letters and digits.")
        if both := targets.keys() & nests.keys():
            raise refused("tool.targets", f"{min(both)} is the name of a nest as well.", "Rename one.")
        for place in self.simulation.misplaced_mm:
            if place not in nests and place not in targets:
                what = f"names {place}, which is neither nest nor target."
                raise refused("simulation.misplaced_mm", what, "Correct the name.")
        names = set[str]()
        for each in self.fixture:
            if each.name in names:
                raise refused("fixture", f"has the name {each.name!r} twice.", "Give every fixture its own.")
            names.add(each.name)
        return self

    @property
    def nests(self) -> Mapping[str, Vector]:
        return self.world.nests

    @property
    def nests_u_mm(self) -> Mapping[str, float]:
        """The standard uncertainty of the nests per axis, if it is stated."""
        return _stated(self.world.u_mm, self.world.nests) | self.world.nests_u_mm

    @property
    def fixtures(self) -> tuple[Obstacle, ...]:
        return self.fixture

    @property
    def time_scale(self) -> float:
        """Speed of a simulated cell; not used for a real one."""
        return self.simulation.time_scale

    @property
    def rehearsed(self) -> bool:
        """Whether prompts confirm themselves; not used for a real cell."""
        return self.simulation.operator == "confirms"

    @property
    def source(self) -> str:
        """The text of the file, kept in the record."""
        return self._source

    @cached_property
    def clearance(self) -> Clearance:
        """The obstacles of arm and tool: the table, keep-out boxes and fixtures."""
        robot, tool = self.robot, self.tool
        arm = CellArm.of(robot.model, robot.coupling, tool.targets, tool.radius_mm)
        return Clearance.of(arm, (FloorObstacle(robot.table_z_mm), *robot.boxes, *self.fixture))

    @property
    def unstated(self) -> tuple[str, ...]:
        """The balls whose position uncertainty the file does not state, if the cell has a ballbar."""
        known = {**self.nests_u_mm, **self.tool.stated_mm}
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
    """Read `cell.toml`.

    Raises
    ------
    ConfigError
        The file cannot be used; the message names file and key.
    """
    text, table = read_toml(path)
    return cell_from(table, str(path), beside=path.parent, source=text)


@as_config_error()
def cell_from(table: Mapping[str, Any], file: str, *, beside: Path | None = None, source: str = "") -> Cell:
    """Create a cell from a parsed table.

    Parameters
    ----------
    table
        The parsed table.
    file
        Name of the file in error messages.
    beside
        Folder of the robot file.
    source
        Text that the record keeps. Default: the table as TOML.
    """
    cell = read_table(Cell, table, file, beside)
    cell._source = _whole(source, table, cell.robot.file)
    return cell


def _whole(source: str, table: Mapping[str, Any], file: Mapping[str, Any] | None) -> str:
    """Return the text of the cell file together with the robot file that it names.

    A record must be readable without that file.
    """
    if file is None or "file" in table["robot"]:
        return source or tomli_w.dumps(table)
    if source:  # appended, which keeps comments, if TOML allows that: it adds no key to robot = { ... }
        whole = f"{source.rstrip()}\n\n{tomli_w.dumps({'robot': {'file': file}})}"
        with suppress(tomllib.TOMLDecodeError):
            tomllib.loads(whole)
            return whole
    return tomli_w.dumps({**table, "robot": {**table["robot"], "file": file}})


@as_config_error()
def cell_of_record(source: str, where: str) -> Cell:
    """Return the cell of a record from the text stored there.

    Raises
    ------
    ConfigError
        The text cannot be used.
    """
    return cell_from(parse_toml(source, where), where, beside=Path(where).parent, source=source)


def moved_by(
    before_mm: Mapping[str, Sequence[float]], now_mm: Mapping[str, Sequence[float]], noise: NoiseFigures
) -> tuple[float, float] | None:
    """Test whether the nests or the instrument have moved between two measurements.

    Both measurements have the same names and are in the instrument's frame. A drift counts as a move.

    Returns
    -------
    tuple of float, or None
        The largest displacement of a nest, mm, and T in units of its limit; None within the noise.
    """
    names = list(before_mm)
    before = np.array([before_mm[name] for name in names], dtype=np.float64)
    moved = np.array([now_mm[name] for name in names], dtype=np.float64) - before
    each = covariance_of(before, noise)
    distance = float(np.einsum("ni,nij,nj->", moved, np.linalg.inv(2.0 * each), moved))
    limit = float(chdtri(3 * len(names), FALSE_ALARM))
    return (float(np.linalg.norm(moved, axis=1).max()), distance / limit) if distance > limit else None


def covariance_of(points: NDArray[np.float64], noise: NoiseFigures) -> NDArray[np.float64]:
    """Compute the covariance (n, 3, 3), mm2, of nests (n, 3) in the instrument's frame.

    Each nest is read once, after the SMR was seated again.
    """
    tracker = Noise(
        "tracker",
        range_mm=noise.range_mm,
        range_ppm=noise.range_ppm,
        transverse_mm=noise.transverse_mm,
        transverse_ppm=noise.transverse_ppm,
    )
    return tracker.of_points(points, np.full_like(points, np.nan)) + SEAT_MM**2 * np.eye(3)


@dataclass(frozen=True)
class Bar:
    """A ballbar as a person has built it, lengths mm."""

    body_mm: float
    extensions_mm: tuple[float, ...]

    @property
    def length_mm(self) -> float:
        """The length from ball to ball in the middle of the stroke."""
        return self.body_mm + sum(self.extensions_mm)

    def in_words(self) -> str:
        """Return the instruction to a person how to build the bar."""
        if not self.extensions_mm:
            return f"the ballbar of {self.length_mm:g} mm, without extension bars"
        bars = " and ".join(f"{each:g}" for each in self.extensions_mm)
        many = "bars" if len(self.extensions_mm) > 1 else "bar"
        return (
            f"the ballbar of {self.length_mm:g} mm: {self.body_mm:g} mm and the extension {many} of {bars} mm"
        )


def bars_of(cell: Cell) -> tuple[Bar, ...]:
    """Return every bar that can be built in this cell.

    The one of the legs comes first, then the others by the number of extensions.
    """
    declared, legs = cell.instrument.declared, cell.instrument.nominal_mm
    kit = [
        Bar(declared.body_mm, some)
        for count in range(len(declared.extensions_mm) + 1)
        for some in combinations(declared.extensions_mm, count)
    ]
    for_legs = next((bar for bar in kit if bar.length_mm == legs), Bar(legs, ()))
    return (for_legs, *(bar for bar in kit if bar != for_legs))


def apart_mm(cell: Cell, one: str, other: str) -> float:
    """Return the distance of two balls of the base, or two of the tool, in the cell file, mm."""
    places = cell.nests if one in cell.nests else cell.tool.targets
    return float(np.linalg.norm(np.subtract(places[one], places[other])))


def bar_between(cell: Cell, one: str, other: str) -> Bar | None:
    """Return the bar that fits between two balls of one body, or None if none fits.

    The uncertainty of the balls in the cell file is taken into account.
    """
    apart = apart_mm(cell, one, other)
    known, assumed = {**cell.nests_u_mm, **cell.tool.stated_mm}, TAUGHT_MM if one in cell.nests else MADE_MM
    stray = float(np.hypot(known.get(one, assumed), known.get(other, assumed)))
    reach = (cell.instrument.declared.stroke_mm or 0.0) + _STRAY * stray
    best = min(bars_of(cell), key=lambda bar: abs(bar.length_mm - apart))
    return best if abs(best.length_mm - apart) <= reach else None


def bar_for(cell: Cell, target: str, base_target: str) -> Bar:
    """Return the bar for a planned reading: a leg, or two balls of one body."""
    leg = (target in cell.nests) != (base_target in cell.nests)
    between = None if leg else bar_between(cell, target, base_target)
    return bars_of(cell)[0] if between is None else between


def carries(fixture: Obstacle, balls: Array) -> bool:
    """Check whether a fixture carries one of the balls (n, 3)."""
    points = np.repeat(balls[:, None], 2, axis=1)
    return bool((np.linalg.norm(fixture.towards(points), axis=1) < CARRIES_MM).any())


def moved(fixture: Obstacle, pose: Array) -> Obstacle:
    """Return a fixture after the motion (4, 4).

    A box becomes the upright box about its moved corners.
    """
    if isinstance(fixture, Post):
        start, end = taken(np.array([fixture.from_mm, fixture.to_mm]), pose)
        return fixture.model_copy(update={"from_mm": point(start), "to_mm": point(end)})
    if isinstance(fixture, Box):
        corners = np.array(np.meshgrid(*zip(fixture.low_mm, fixture.high_mm, strict=True))).reshape(3, -1).T
        there = taken(corners, pose)
        ends = {"low_mm": point(there.min(axis=0)), "high_mm": point(there.max(axis=0))}
        return fixture.model_copy(update=ends)
    return fixture


def with_places(cell: Cell, nests_mm: Mapping[str, Vector], fixtures: Iterable[Obstacle]) -> Cell:
    """Return the cell with some of its nests elsewhere, and with these fixtures."""
    world = cell.world.model_copy(update={"nests": {**cell.nests, **nests_mm}})
    return cell.model_copy(update={"world": world, "fixture": tuple(fixtures)})


def with_nests(cell: Cell, nests_mm: Mapping[str, Vector]) -> Cell:
    """Return the cell with some of its nests moved, each with the fixtures that carry it."""
    fixtures = list(cell.fixtures)
    for name, place in nests_mm.items():
        pose = np.eye(4)
        pose[:3, 3] = np.subtract(place, cell.nests[name])
        ball = np.array([cell.nests[name]])
        fixtures = [
            moved(now, pose) if carries(was, ball) else now
            for was, now in zip(cell.fixtures, fixtures, strict=True)
        ]
    return with_places(cell, nests_mm, fixtures)


def taken(points: Array, pose: Array) -> Array:
    """Return points (n, 3) after the motion (4, 4)."""
    return points @ pose[:3, :3].T + pose[:3, 3]


def point(place: Array) -> Vector:
    """Return a place (3,) as a cell stores it, rounded to a tenth of a micrometre."""
    x, y, z = (round(float(c), 4) for c in place)
    return x, y, z


class OtherDevice(ConfigError):
    """The device at the address is not the one that the cell file names."""

    code = 6102
    advice = "Correct model, driver or url in the cell file, or connect the device that it names."


@dataclass(frozen=True)
class Match:
    """A comparison of a device with the cell file.

    `agrees` is None if the device does not report enough; `text` states the values that were compared.
    """

    agrees: bool | None
    text: str


def match_robot(cell: Cell, who: Identity) -> Match:
    """Compare maker and model that the controller reports with `[robot] model`."""
    robot = cell.robot.model
    if cell.robot.declared.by_hand:
        return Match(None, f"{robot.name} by the cell file; nobody but its type plate says so")
    if _plain(who.maker) != _plain(robot.maker):
        return Match(False, f"{who.maker} answers, the cell file names {robot.name} of {robot.maker}")
    if not who.model:
        return Match(None, f"{robot.name} by the cell file; this dialect does not report the model")
    if is_model(robot.name, robot.maker, who.model):
        return Match(True, f"{who.model}: that is {robot.name}")
    if robot.name not in built_in_robots():
        return Match(None, f"{who.model} answers; {robot.name} is a robot file of your own")
    return Match(False, f"{who.model} answers, the cell file names {robot.name}")


def match_instrument(cell: Cell, who: Identity) -> Match:
    """Compare the maker that the instrument or its bridge reports with that of the driver."""
    driver = cell.instrument.driver
    wanted, reported = cell.instrument.declared.maker, _plain(who.maker)
    if cell.instrument.declared.by_hand:
        return Match(None, "read by a person: nobody but its type plate says what it is")
    if _plain(wanted) in reported:
        return Match(True, f"{who.maker}, for which the driver '{driver}' is made")
    if any(_plain(each.maker) in reported for each in INSTRUMENTS.values() if each.maker):
        return Match(False, f"{who.maker} {who.model} answers, the driver '{driver}' is for {wanted}")
    return Match(None, f"the maker is reported as {who.maker!r}, the driver '{driver}' is for {wanted}")


def check_identity(cell: Cell, role: str, who: Identity) -> None:
    """Refuse another device before anything moves; `role` is robot or instrument.

    Raises
    ------
    OtherDevice
        Maker or model contradict the cell file.
    """
    match = match_robot(cell, who) if role == "robot" else match_instrument(cell, who)
    if match.agrees is False:
        raise OtherDevice(match.text, device=role, command="identify")


def is_model(name: str, maker: str, model: str) -> bool:
    """Check whether the `model` that a controller reports means the robot `name`.

    The name may have its maker in front.
    """
    letters = _plain(name).removeprefix(_plain(maker))
    pattern = r"[\W_]*".join(letters)
    return re.search(rf"(?<![a-z0-9]){pattern}(?![a-z0-9])", model.casefold()) is not None


def _plain(text: str) -> str:
    return re.sub(r"[\W_]+", "", text.casefold())


def unstated_in_words(names: Sequence[str]) -> str:
    """Return a sentence on balls whose position uncertainty the cell file does not state."""
    return (
        f"The cell file does not state how well {', '.join(names)} are known: {TAUGHT_MM:g} mm is assumed of a cup, "
        f"{MADE_MM:g} mm of a ball on the tool. State u_mm under [world] and [tool] before the campaign begins."
    )

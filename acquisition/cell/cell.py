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
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray
from scipy.special import chdtri

from acquisition.cell.arm import TOOL_RADIUS_MM, CellArm
from acquisition.cell.clearance import Clearance
from acquisition.cell.obstacles import Array, Box, FloorObstacle, Obstacle, Post, read_fixtures
from acquisition.cell.robot_section import RobotSection, read_options, read_robot, read_url
from acquisition.errors import as_config_error
from calib.arm import Load, built_in_robots
from calib.data import LEAST, Noise
from calib.text import TomlTable, Vector, parse_toml, read_toml
from drivers import INSTRUMENTS, InstrumentDriver, instrument_driver
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


@dataclass(frozen=True)
class NoiseFigures:
    """Declared noise of an instrument, 1 sigma.

    Points in mm and in ppm of the distance, rotations in mrad, lengths in mm.
    """

    range_mm: float = 0.010
    range_ppm: float = 2.0
    transverse_mm: float = 0.010
    transverse_ppm: float = 6.0
    rotation_mrad: float = 0.0  # 0: orientations are recorded and have no weight
    length_mm: float = 0.0005


@dataclass(frozen=True)
class InstrumentSection:
    """The instrument of the cell.

    Attributes
    ----------
    one_smr
        Whether a person moves the only SMR from nest to nest.
    expected_within_mm
        Largest distance from the nominal place at which a reading counts as its target.
    options
        Options that only the driver uses.
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
    """Targets on the tool, in the flange frame.

    Attributes
    ----------
    mass_kg, cog_mm
        Mass and centre of gravity; None for the values of the robot file.
    radius_mm
        Radius of the capsules from the flange to the targets.
    u_mm
        Standard uncertainty of the targets per axis, if it is stated.
    """

    targets: Mapping[str, Vector]
    normals: Mapping[str, Vector]
    radius_mm: float
    mass_kg: float | None
    cog_mm: Vector | None
    u_mm: Mapping[str, float]


@dataclass(frozen=True)
class Cell:
    """A cell: robot, instrument, tool, nests and obstacles.

    Attributes
    ----------
    nests_u_mm
        Standard uncertainty of the nests per axis, if it is stated.
    time_scale
        Speed of a simulated cell; not used for a real one.
    rehearsed
        Whether prompts confirm themselves; not used for a real cell.
    source
        Text of the cell file, kept in the record.
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
        arm = CellArm.of(robot.model, robot.coupling, tool.targets, tool.radius_mm)
        return Clearance.of(arm, (FloorObstacle(robot.table_z_mm), *robot.keep_out, *self.fixtures))

    @property
    def unstated(self) -> tuple[str, ...]:
        """The balls whose position uncertainty the file does not state, if the cell has a ballbar."""
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
    known, assumed = {**cell.nests_u_mm, **cell.tool.u_mm}, TAUGHT_MM if one in cell.nests else MADE_MM
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
        return replace(fixture, from_mm=point(start), to_mm=point(end))
    if isinstance(fixture, Box):
        corners = np.array(np.meshgrid(*zip(fixture.low_mm, fixture.high_mm, strict=True))).reshape(3, -1).T
        there = taken(corners, pose)
        return replace(fixture, low_mm=point(there.min(axis=0)), high_mm=point(there.max(axis=0)))
    return fixture


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
    return replace(cell, nests={**cell.nests, **nests_mm}, fixtures=tuple(fixtures))


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


def stated(table: TomlTable, key: str, names: Collection[str]) -> dict[str, float]:
    """Return the uncertainties that a table states, in mm by name.

    The table has `u_mm` for all of them, or an entry for each under `key`. Zero means exact.

    Raises
    ------
    ConfigError
        A number is not plausible, or a name is not one of `names`.
    """
    own = table.table(key)
    own.only(names)
    common = dict.fromkeys(names, _number(table, "u_mm")) if "u_mm" in table.values else {}
    return common | {name: _number(own, name) for name in own.values}


def _number(table: TomlTable, key: str) -> float:
    u_mm = table.number(key, low=0.0, high=_MOST_MM)
    if 0.0 < u_mm < LEAST:
        raise table.refuse(key, f"is {u_mm!r}: too small to be true.", "Use 0 for exact.")
    return u_mm

"""Header of a data set, `NAME.toml`: robot, instrument, world, noise, targets.

Impossible values are refused. The header also states when the readings were taken, and by whom. The
module names the groups of base-model parameters in `[model] fit`, and the levels.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal

from calib.arm.robot import Load, Robot, built_in_robots, load_robot, parse_loads, robot_from
from calib.data.noise import Kind, Noise
from calib.errors import DataError
from calib.text.toml_table import TomlTable, Vector, read_toml
from calib.units import DEG

KEYS = {"began", "ended", "operators", "campaigns"}

GROUPS = (
    "base",
    "geometry",
    "parallel_twist",
    "compliance",
    "tool",
    "joint_offsets",
    "encoder_scale",
    "length_zero",
)

DEFAULT_GROUPS = ("base", "geometry", "parallel_twist", "compliance")

LEVELS = {
    1: ("base", "joint_offsets", "encoder_scale"),
    2: ("base", "geometry", "parallel_twist"),
    3: DEFAULT_GROUPS,
}
"""Levels of calibration: 1 joints, 2 geometry, 3 what is not geometry too. Source: Roth, Mooring and Ravani 1987."""


@dataclass(frozen=True)
class MeasurementOccasion:
    """Occasion of a measurement: its time and its operators.

    Attributes
    ----------
    began, ended : str
        Time of the first and the last reading, "2026-03-02 09:15 UTC".
    operators : tuple of str
        Those who gave the commands and answered the prompts, in the order in which they came.
    campaigns : int
        Number of records from which the readings come.
    """

    began: str
    ended: str
    operators: tuple[str, ...]
    campaigns: int = 1


def occasion_of(table: TomlTable) -> MeasurementOccasion | None:
    """Read the table `[measured]` of a header; return None if there is none.

    Raises
    ------
    DataError
        A value is wrong; the error names the key.
    """
    if "measured" not in table.values:
        return None
    measured = table.table("measured")
    operators = measured.values.get("operators", [])
    if not isinstance(operators, list) or not all(isinstance(name, str) for name in operators):
        raise measured.refuse("operators", f"is {operators!r}.", 'Give a list of names, ["anna", "bert"].')
    campaigns = measured.whole("campaigns", 1, low=1)
    return MeasurementOccasion(measured.text("began"), measured.text("ended"), tuple(operators), campaigns)


FORMAT = "truepose-dataset/1"
LEAST = 1e-9
"""No uncertainty, in the unit of its key, is smaller: what is would be a zero to the arithmetic."""

_KEYS = {
    *(
        "format",
        "robot",
        "robot_file",
        "instrument",
        "world",
        "joint_coupling",
        "gravity_base",
        "model",
        "noise",
        "tool_targets",
    ),
    *(
        "base_targets",
        "base_targets_u_mm",
        "nests",
        "tool_targets_u_mm",
        "u_mm_assumed",
        "loads",
        "series",
        "holdout",
        "beyond_limits",
        "simulated",
        "absolute_accuracy",
        "device",
        "unprotected",
        "measured",
        "readings",
        "not_taken",
        "joints",
        "measured_at_origin",
    ),
}

_MODEL_KEYS = {"fit", "level", "hold", "priors", "one_tool"}

_NOISE_KEYS = {
    *("kind", "sigma_mm", "station_mm", "range_mm", "range_ppm", "transverse_mm", "transverse_ppm"),
    *("rotation_mrad", "length_mm", "repeatability_deg", "repeatability_mm"),
}

_IDS, _MOST_READINGS = re.compile(r"([0-9]{1,9})(?:-([0-9]{1,9}))?"), 1_000_000
_NEAR = 0.7  # likeness, of 1, from which an unknown key is a misspelt one
World = Literal["free", "nominal"]
ABSOLUTE_ACCURACY = ("on", "off", "unknown")
"""Whether the controller corrects targets by its maker's own calibration."""


@dataclass(frozen=True)
class Header:
    """Header of a data set, valid for every row; lengths in mm, angles in rad."""

    robot: Robot
    instrument: str
    world: World
    coupling: str
    gravity: Vector
    groups: tuple[str, ...]
    noise: Noise
    targets: Mapping[str, Vector]
    series_targets: Mapping[str, Mapping[str, Vector]]
    loads: tuple[Load, ...]
    holdout: str
    base_targets: Mapping[str, Vector] = field(default_factory=dict)
    free_base_targets: tuple[str, ...] = ()  # names, or "*" for every one that is not in base_targets
    # standard uncertainty per axis by name; what is not named is exact, or freed without a prior
    base_targets_u_mm: Mapping[str, float] = field(default_factory=dict)
    tool_targets_u_mm: Mapping[str, float] = field(default_factory=dict)
    u_mm_assumed: tuple[str, ...] = ()  # names whose uncertainty was not stated
    nests: Mapping[str, Vector] = field(default_factory=dict)  # on which the world frame is set up, mm
    one_tool: bool = False  # whether all series measured the same tool
    hold: tuple[str, ...] = ()  # parameters held at their nominal values
    # Parameter or group -> std in the parameter's unit
    priors: Mapping[str, float] = field(default_factory=dict)
    simulated: bool = False  # whether a simulated robot was measured by a simulated instrument
    absolute_accuracy: str = (
        "unknown"  # whether the controller corrected by its maker's calibration: on, off, unknown
    )
    read_back: bool = False  # whether the joints are those that the controller read back, not those commanded
    at_origin: bool = False  # whether a point at exactly 0, 0, 0 was measured there
    beyond_limits: bool = False  # whether joints may lie beyond the limits of the robot file
    devices: tuple[Mapping[str, str], ...] = ()  # robots and instruments of the readings, and their series
    unprotected: str = ""  # what the wires of robot and instrument could not see while this was measured
    occasion: MeasurementOccasion | None = None  # when this was measured and by whom
    readings: tuple[str, ...] = ()  # ids of all its readings, where whoever wrote the file knew them
    not_taken: int = 0  # readings of the campaign that were to come when the file was written
    unknown_keys: tuple[str, ...] = ()
    text: str = field(default="", repr=False)  # as the file has it, for the hash of the data

    def knows_base_target(self, name: str) -> bool:
        """Test whether distances may end at a base target of this name."""
        return name in self.base_targets or name in self.free_base_targets or "*" in self.free_base_targets

    @property
    def declared_loads(self) -> tuple[Load, ...]:
        """The loads without the estimates of the robot file."""
        estimates = self.robot.loads if self.robot.loads_estimated else ()
        return tuple(load for load in self.loads if load not in estimates)

    @property
    def loads_estimated(self) -> bool:
        """Whether the robot file's estimates are among the loads."""
        return len(self.declared_loads) < len(self.loads)

    @property
    def frees_length_zero(self) -> bool:
        """Whether lengths count from an unknown zero."""
        return "length_zero" in self.groups

    def targets_of(self, series: str) -> dict[str, Vector]:
        """Nominal tool targets of a series, flange frame, mm."""
        return {**self.targets, **self.series_targets.get(series, {})}


def read_header(path: Path) -> Header:
    """Read `NAME.toml`.

    Raises
    ------
    DataError
        The file is missing or a value is wrong; the error names the key and the remedy.
    """
    if not path.is_file():
        raise DataError(
            "is missing: a data set is NAME.csv and NAME.toml.",
            do="Write the header (robot, noise, tool targets); 'truepose docs first-hour' shows one.",
            file=path,
        )
    text, values = read_toml(path)
    return header_of(values, path, text)


def header_of(values: Mapping[str, Any], path: Path, text: str) -> Header:
    """Build the header from a TOML table; `text` is the table as the file `path` has it.

    Raises
    ------
    DataError
        A value is wrong; the error names the key and the remedy.
    """
    table = TomlTable(values, path)
    if "format" in values:
        table.text("format", allowed=(FORMAT,))
    unknown = _unknown(table)  # before anything is missed: a mistyped key is why
    table.text("format", allowed=(FORMAT,))
    try:
        robot = _robot(table, path)
    except DataError as error:
        if error.file is not None:
            raise
        raise DataError(error.what, do=error.do, file=path, key=error.key) from error
    couplings = ("none", *robot.joint_matrices)
    series = table.table("series")
    loads = parse_loads(values.get("loads", []), robot.joints, path)
    targets = table.vectors("tool_targets")
    series_targets = {name: series.table(name).vectors("tool_targets") for name in series.values}
    return Header(
        robot=robot,
        instrument=table.text("instrument", "") or "unknown",
        world=table.word("world", ("free", "nominal"), "free"),
        coupling=table.text("joint_coupling", "none", couplings),
        gravity=_gravity(table),
        groups=_groups(table.table("model")),
        noise=_noise(table.table("noise")),
        targets=targets,
        series_targets=series_targets,
        tool_targets_u_mm=_uncertainties(
            table, "tool_targets_u_mm", {*targets, *(name for own in series_targets.values() for name in own)}
        ),
        loads=loads or robot.loads,
        holdout=str(table.table("holdout").values.get("kind", "as measured")),
        **_base_targets(table),
        u_mm_assumed=_names(table, "u_mm_assumed"),
        nests=table.vectors("nests"),
        one_tool=_one_tool(table.table("model"), series_targets),
        hold=_names(table.table("model"), "hold"),
        priors=_priors(table.table("model").table("priors")),
        simulated=table.flag("simulated"),
        absolute_accuracy=table.word("absolute_accuracy", ABSOLUTE_ACCURACY, "unknown"),
        read_back=table.text("joints", "commanded", ("commanded", "read-back")) == "read-back",
        at_origin=table.flag("measured_at_origin"),
        beyond_limits=table.flag("beyond_limits"),
        devices=_devices(table),
        unprotected=table.text("unprotected", ""),
        occasion=occasion_of(table),
        readings=_readings(table),
        not_taken=table.whole("not_taken", 0, low=0),
        unknown_keys=unknown,
        text=text,
    )


def _one_tool(model: TomlTable, series_targets: Mapping[str, Mapping[str, Vector]]) -> bool:
    one = model.flag("one_tool")
    if one and (own := [name for name, targets in series_targets.items() if targets]):
        raise model.refuse(
            "one_tool",
            f"says that all series have one tool, and the series '{own[0]}' has tool targets of its own.",
            "Leave one of the two out.",
        )
    return one


def _readings(table: TomlTable) -> tuple[str, ...]:
    """Expand the ids of "5-28, 35-58"."""
    out: list[str] = []
    for part in filter(None, table.text("readings", "").split(",")):
        found = _IDS.fullmatch(part.strip())
        first, last = (int(found[1]), int(found[2] or found[1])) if found else (0, -1)
        if not 0 <= last - first < _MOST_READINGS - len(out):
            raise table.refuse("readings", f"has '{part.strip()[:40]}'.", 'Give ids as in "5-28, 35-58".')
        out += map(str, range(first, last + 1))
    return tuple(out)


def _gravity(table: TomlTable) -> Vector:
    gravity = table.vector("gravity_base", (0.0, 0.0, -9.81))
    size = math.hypot(*gravity)
    if size != 0.0 and not 9.7 < size < 9.9:
        raise table.refuse(
            "gravity_base",
            f"has the length {size:g}.",
            "Give it in m/s2: it is 9.81 long, whatever its direction.",
        )
    return gravity


def _base_targets(table: TomlTable) -> dict[str, Any]:
    free: tuple[str, ...] = ("*",)
    known: dict[str, Vector] = {}
    if table.values.get("base_targets") != "free":
        given = table.table("base_targets")
        free = tuple(name for name, value in given.values.items() if value == "free")
        known = {name: given.vector(name) for name in given.values if name not in free}
    u_mm = _uncertainties(table, "base_targets_u_mm", known)
    return {"base_targets": known, "free_base_targets": free, "base_targets_u_mm": u_mm}


def _uncertainties(table: TomlTable, key: str, names: Collection[str]) -> dict[str, float]:
    """Read standard uncertainties above zero, mm per axis, by name.

    They are one number for all of `names`, or a table by name.
    """
    if not isinstance(table.values.get(key), dict):
        u_mm = _uncertainty(table, key)
        return dict.fromkeys(names, u_mm) if u_mm > 0.0 else {}
    given = table.table(key)
    for name in given.values:
        if name not in names:
            near = get_close_matches(name, names, n=1, cutoff=_NEAR)
            do = f"Did you mean '{near[0]}'? Correct it." if near else "Use names that have a position."
            raise given.refuse(name, "has an uncertainty and no position.", do)
    return {name: u_mm for name in given.values if (u_mm := _uncertainty(given, name)) > 0.0}


def _uncertainty(table: TomlTable, key: str) -> float:
    u_mm = table.number(key, 0.0, low=0.0)
    if 0.0 < u_mm < LEAST:
        raise table.refuse(key, f"is {u_mm!r}: too small to be true.", "Use 0 for exact.")
    return u_mm


def _names(table: TomlTable, key: str) -> tuple[str, ...]:
    names = table.values.get(key, [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise table.refuse(key, f"is {names!r}.", 'Give a list of names, ["d2", "beta3"].')
    return tuple(names)


def _robot(table: TomlTable, path: Path) -> Robot:
    """Load the robot of the header: by its name, or from a robot file within the header.

    The name is that of a built-in robot or of a robot file.
    """
    if table.values.get("robot_file") is None:
        return load_robot(table.text("robot"), path.parent)
    robot = robot_from(table.table("robot_file").values, path)
    if robot.name != table.text("robot"):
        raise table.refuse(
            "robot_file", f"is that of '{robot.name}'.", f'Give both the same name: robot = "{robot.name}".'
        )
    if robot.name in built_in_robots():
        raise table.refuse(
            "robot_file", f"has the name of a robot of the library, '{robot.name}'.", "Give it another name."
        )
    return robot


def _priors(table: TomlTable) -> dict[str, float]:
    priors = {name: table.number(name, low=0.0) for name in table.values}
    for name, value in priors.items():
        if value < LEAST:
            raise table.refuse(
                name, f"is {value:g}.", f"Name it under [model] hold to keep it as it is: hold = [{name!r}]."
            )
    return priors


def _unknown(table: TomlTable) -> tuple[str, ...]:
    """List the unknown keys of a header.

    Raises
    ------
    DataError
        A key looks like a misspelt known one.
    """
    places = [(table, _KEYS), (table.table("model"), _MODEL_KEYS), (table.table("noise"), _NOISE_KEYS)]
    places.append((table.table("measured"), KEYS))
    series = table.table("series")
    places += [(series.table(name), {"tool_targets"}) for name in series.values]
    out = []
    for place, known in places:
        for key in place.values:
            if key not in known:
                if near := get_close_matches(key, known, n=1, cutoff=_NEAR):
                    raise place.refuse(key, "is not known.", f"Did you mean '{near[0]}'? Correct it.")
                out.append(place.prefix + key)
    return tuple(out)


def _devices(table: TomlTable) -> tuple[Mapping[str, str], ...]:
    devices = table.values.get("device", [])
    if not isinstance(devices, list) or not all(isinstance(each, dict) for each in devices):
        raise table.refuse("device", f"is {devices!r}.", "Make every device a table, [[device]].")
    for number, each in enumerate(devices, start=1):
        for key, value in each.items():
            if not isinstance(value, str):
                raise table.refuse(f"device[{number}].{key}", f"is {value!r}.", "Give text, in quotes.")
    return tuple(devices)


def _groups(table: TomlTable) -> tuple[str, ...]:
    if "level" in table.values:
        level = table.values["level"]
        if "fit" in table.values:
            raise table.refuse("level", "is given beside 'fit'.", "Give one of the two.")
        if type(level) is not int or level not in LEVELS:
            raise table.refuse("level", f"is {level!r}.", "Use 1, 2 or 3.")
        return LEVELS[level]
    groups = table.values.get("fit", list(DEFAULT_GROUPS))
    if not isinstance(groups, list) or not groups:
        raise table.refuse("fit", f"is {groups!r}.", f"Give a list of: {', '.join(GROUPS)}.")
    for group in groups:
        if group not in GROUPS:
            raise table.refuse("fit", f"names {group!r}.", f"Use: {', '.join(GROUPS)}.")
    if len(set(groups)) != len(groups):
        raise table.refuse("fit", "names a group twice.", "Name each group once.")
    return tuple(groups)


def read_noise(path: Path) -> Noise:
    """Read the table `[noise]` of a header.

    Raises
    ------
    DataError
        A value is wrong; the error names file and key.
    """
    _, values = read_toml(path)
    return _noise(TomlTable(values, path).table("noise"))


def _noise(table: TomlTable) -> Noise:
    kind: Kind = table.word("kind", ("tracker", "isotropic", "per-row"))
    tracker = kind == "tracker"
    noise = Noise(
        kind=kind,
        sigma_mm=table.number("sigma_mm", low=0.0) if kind == "isotropic" else 0.0,
        station_mm=table.vector("station_mm") if tracker else (0.0, 0.0, 0.0),
        range_mm=table.number("range_mm", low=0.0) if tracker else 0.0,
        range_ppm=table.number("range_ppm", 0.0, low=0.0),
        transverse_mm=table.number("transverse_mm", low=0.0) if tracker else 0.0,
        transverse_ppm=table.number("transverse_ppm", 0.0, low=0.0),
        repeatability=table.number("repeatability_deg", 0.0, low=0.0) * DEG,
        rotation=table.number("rotation_mrad", 0.0, low=0.0) * 1e-3,
        length_mm=table.number("length_mm", 0.0, low=0.0),
        repeatability_mm=table.number("repeatability_mm", 0.0, low=0.0),
    )
    for key, value in table.values.items():
        if key in _NOISE_KEYS and isinstance(value, float) and 0.0 < value < LEAST:
            raise table.refuse(key, f"is {value!r}: too small to be true.", "Give one standard deviation.")
    zero = (kind == "isotropic" and noise.sigma_mm == 0.0) or (
        tracker
        and (noise.range_mm + noise.range_ppm == 0.0 or noise.transverse_mm + noise.transverse_ppm == 0.0)
    )
    if zero:
        raise table.refuse(
            "kind", "declares a noise of zero.", "Give the instrument's noise, 1 sigma per axis."
        )
    return noise

"""Simple reader of the parts of a `cell.toml` (truepose-cell/1) that a simulator needs."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

NESTS = {"N1": (0.0, 0.0, 0.0), "N2": (600.0, 0.0, 0.0), "N3": (0.0, 600.0, 0.0)}
STATION_MM = (2400.0, -900.0, 350.0)


@dataclass(frozen=True)
class CellFile:
    """Description of one cell.

    If `effects` is empty, one is drawn from the seed. If it contains `none`, there are no effects.
    """

    robot: str = "abb-irb120"
    robot_file: dict[str, Any] | None = None  # the parsed file of a robot that is not in the library
    joint_coupling: str | None = None  # as which the controller counts; None: as the robot has it
    limits_deg: tuple[tuple[float, ...], ...] | None = None
    station_mm: tuple[float, ...] = STATION_MM
    nests: dict[str, tuple[float, ...]] = field(default_factory=lambda: dict(NESTS))
    targets: dict[str, tuple[float, ...]] | None = None
    normals: dict[str, tuple[float, ...]] = field(default_factory=dict)  # where targets look, flange frame
    robot_driver: str = "abb"
    second_channel: bool = False  # the address of the robot names one
    instrument_driver: str = "faro"
    tool_mass_kg: float | None = None
    tool_cog_mm: tuple[float, ...] | None = None
    u_mm: dict[str, float] = field(default_factory=dict)  # stated of nests and targets, 1 sigma per axis
    misplaced_mm: dict[str, tuple[float, ...]] = field(
        default_factory=dict
    )  # errors of these places; others are drawn
    seed: int = 1
    time_scale: float = 1.0
    effects: tuple[str, ...] = ()
    ballbar_mm: float = 300.0
    effect_size: float = 3.0  # RMS of the effect's displacement per axis over the noise
    readings: int = 300  # length of the campaign that steps and drifts are scaled to
    seconds_per_reading: float = 20.0
    clock_offset_s: float = (
        0.0  # how far the clock of a device may be off, to either side: drawn from the seed
    )
    clock_rate_ppm: float = 0.0
    dialect: str = ""  # of a device (`mocks.dialects`); empty: the usual one of each
    serial: str = ""  # that the controller of an ABB or UR reports; empty: the same in every cell
    resolution_deg: float = 0.01  # of a pendant that a person reads
    within_deg: float | None = None  # how far from a posture that person may stop
    pulses_per_deg: tuple[float, ...] = ()  # of a Yaskawa controller; empty: the simulator's own
    max_deg_s: tuple[float, ...] = ()

    @property
    def devices(self) -> tuple[str, ...]:
        """The devices that its drivers need."""
        second = (f"{self.robot_driver}-rws",) if self.second_channel else ()
        return self.robot_driver, *second, self.instrument_driver


def read_cell(path: Path) -> CellFile:
    """Read a cell file.

    Raises
    ------
    ValueError
        The file is wrong; the message names the key.
    OSError
        The file cannot be read.
    """
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    if table.get("format") != "truepose-cell/1":
        raise ValueError(f"{path}: format is {table.get('format')!r}, needed 'truepose-cell/1'")
    robot, tool, simulation = table.get("robot", {}), table.get("tool", {}), table.get("simulation", {})
    values: dict[str, Any] = {
        "robot": robot.get("model"),
        "robot_file": robot.get("file"),
        "joint_coupling": robot.get("joint_coupling"),
        "limits_deg": robot.get("limits_deg"),
        "station_mm": table.get("instrument", {}).get("station_mm"),
        "nests": table.get("world", {}).get("nests"),
        "targets": tool.get("targets"),
        "normals": tool.get("normals"),
        "u_mm": _stated(table.get("world", {}), "nests") | _stated(tool, "targets"),
        "misplaced_mm": simulation.get("misplaced_mm"),
        "ballbar_mm": table.get("instrument", {}).get("nominal_mm"),
        "resolution_deg": robot.get("resolution_deg"),
        "within_deg": robot.get("within_deg"),
        "pulses_per_deg": robot.get("pulses_per_deg"),
        "max_deg_s": robot.get("max_deg_s"),
        "robot_driver": robot.get("driver"),
        "second_channel": "rws" in parse_qs(urlsplit(str(robot.get("url", ""))).query),
        "instrument_driver": table.get("instrument", {}).get("driver"),
        "tool_mass_kg": tool.get("mass_kg"),
        "tool_cog_mm": tool.get("cog_mm"),
        **{
            key: simulation.get(key)
            for key in (
                *("seed", "time_scale", "effect_size", "readings", "seconds_per_reading"),
                *("clock_offset_s", "clock_rate_ppm", "serial", "dialect"),
            )
        },
        "effects": tuple(simulation.get("effects", ())),
    }
    return CellFile(**{key: value for key, value in values.items() if value is not None})


def _stated(table: dict[str, Any], names: str) -> dict[str, float]:
    """Return the stated uncertainty of each entry of a table by its name.

    An entry without its own value has the value that is stated for all.
    """
    known: dict[str, float] = dict.fromkeys(table.get(names, {}), float(table.get("u_mm", 0.0)))
    return known | table.get(f"{names}_u_mm", {})

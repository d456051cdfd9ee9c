"""A rehearsal of the loop in the simulated demo cell.

The cell has an ABB IRB 120 and a FARO ION with three SMRs. Cell and campaign file are written to the folder of the
results, so that `truepose campaign run` can repeat the first half by hand. Lengths mm, angles deg, times s.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from acquisition.campaign.campaign import Campaign, read_campaign
from acquisition.campaign.plan import DECIMALS
from acquisition.campaign.poses import draw_poses
from acquisition.cell.cell import Cell, read_cell
from acquisition.cell.devices import Devices, open_devices
from acquisition.loop.loop import Targets
from acquisition.run.run import checked_plan
from calib.arm import Robot
from calib.text import replace_file
from drivers.link import WireLog, WireSink

TIME_SCALE = 100.0  # a session of some 40 min in 24 s
SECONDS_PER_READING = 7.5  # duration of a reading on the simulated cell, with its share of moves and pauses
CALIBRATION, VALIDATION = 60, 40
NARROW = 0.35
"""Share of the joint ranges of a narrow start: there effects look alike that a wide one distinguishes."""
_NARROW_STREAM = 78
_APPROACH_DEG = -5.0
_ROOM_MM = 180.0  # above the table: an approach from any side may lower the arm by this

CELL: dict[str, Any] = {
    "format": "truepose-cell/1",
    "name": "demo-irb120-faro",
    "robot": {
        "model": "abb-irb120",
        "driver": "abb",
        "url": "tcp://192.168.125.1:5000",
        "speed_mm_s": 500.0,
        "speed_deg_s": 20.0,
        # Nubiola 2.5.2
        "limits_deg": [[-90, 90], [0, 110], [-80, 70], [-150, 150], [-90, 90], [-180, 180]],
        "table_z_mm": 20.0,
    },
    "instrument": {
        "driver": "faro",
        "url": "tcp://127.0.0.1:5701",
        "station_mm": [2400.0, -900.0, 350.0],
    },
    "world": {"nests": {"N1": [0.0, 0.0, 0.0], "N2": [600.0, 0.0, 0.0], "N3": [0.0, 600.0, 0.0]}},
    "tool": {
        "targets": {"T1": [0.0, 0.0, 125.0], "T2": [75.0, 93.675, 215.0], "T3": [150.0, 0.0, 125.0]},
        "mass_kg": 2.7,
        "cog_mm": [50.0, 25.0, 100.0],
    },
}
_DRIVERS = CELL["robot"]["driver"], CELL["instrument"]["driver"]


def campaign_table(seed: int, calibration: int = CALIBRATION, validation: int = VALIDATION) -> dict[str, Any]:
    """Return the table of the campaign.

    Its calibration and validation poses are in random order and approached from both sides.
    """
    blocks = [("calibration", calibration), ("validation", validation)]
    return {
        "format": "truepose-campaign/1",
        "seed": seed,
        "order": "shuffled",
        "approach": {"offset_deg": _APPROACH_DEG, "sides": "both"},
        "settle_s": 4.0,
        "samples": 100,
        "retries": 2,
        "warm_up_s": 0.0,  # the simulated arm is warm
        "reference_every": 25,
        "block": [{"kind": "poses", "set": name, "count": n, "select": "random"} for name, n in blocks],
    }


def narrow_block(cell: Cell, seed: int, count: int) -> dict[str, Any]:
    """Create a block of `count` calibration poses in the middle of the joint ranges.

    Raises
    ------
    ConfigError
        Too few such poses are clear.
    """
    low, high = np.array(cell.robot.limits_deg).T
    middle, half = 0.5 * (low + high), 0.5 * NARROW * (high - low)
    limits = tuple(zip((middle - half).tolist(), (middle + half).tolist(), strict=True))
    narrow = {"limits_deg": limits, "table_z_mm": cell.robot.table_z_mm + _ROOM_MM}
    cell = cell.model_copy(update={"robot": cell.robot.model_copy(update=narrow)})
    rng = np.random.default_rng([seed, _NARROW_STREAM])
    drawn = draw_poses(cell, count, rng, _APPROACH_DEG, both=False, decimals=DECIMALS)
    poses = [list(pose.joints_deg) for pose in drawn]
    return {"kind": "poses", "set": "calibration", "select": "list", "joints_deg": poses}


def write_files(
    out: Path,
    seed: int,
    effect: str | None,
    time_scale: float,
    *,
    calibration: int = CALIBRATION,
    validation: int = VALIDATION,
    seconds_per_reading: float = SECONDS_PER_READING,
    narrow: bool = False,
) -> tuple[Cell, Campaign]:
    """Write OUT/cell.toml and OUT/campaign.toml and read them back.

    Parameters
    ----------
    seconds_per_reading
        Multiplied by the number of readings, it is the length of the session over which the simulator's drifts grow and
        its air temperature varies, s.
    narrow
        Whether the calibration poses keep to the middle of the joint ranges.

    Raises
    ------
    ConfigError, UnsafePlan
        The cell cannot take the poses.
    OSError
        A file cannot be written.
    """
    out.mkdir(parents=True, exist_ok=True)
    campaign_file, cell_file = out / "campaign.toml", out / "cell.toml"
    table = campaign_table(seed, calibration, validation)
    simulation = {
        "seed": seed,
        "time_scale": time_scale,
        "effects": [] if effect is None else [effect],
        "seconds_per_reading": seconds_per_reading,
    }
    replace_file(cell_file, tomli_w.dumps(CELL | {"simulation": simulation}))
    if narrow:
        table["block"][0] = narrow_block(read_cell(cell_file), seed, calibration)
    replace_file(campaign_file, tomli_w.dumps(table))
    campaign = read_campaign(campaign_file)
    readings = sum(len(visit.targets) for visit in checked_plan(read_cell(cell_file), campaign))
    # Steps and drifts of the simulated session get their size over campaign 1.
    replace_file(cell_file, tomli_w.dumps(CELL | {"simulation": simulation | {"readings": readings}}))
    return read_cell(cell_file), campaign


class _ByDevice:
    """A wire log for each device."""

    def __init__(self, logs: Mapping[str, WireSink]) -> None:
        self._logs = logs

    def record(self, device: str, direction: str, data: bytes) -> None:
        for name, log in self._logs.items():
            if device.startswith(name):
                log.record(device, direction, data)


@contextmanager
def wire_logs(out: Path) -> Iterator[WireSink]:
    """Log all traffic in OUT/wire_ROBOT.log and OUT/wire_INSTRUMENT.log."""
    with ExitStack() as stack:
        logs = {
            name: WireLog(stack.enter_context((out / f"wire_{name}.log").open("w", encoding="utf-8")))
            for name in _DRIVERS
        }
        yield _ByDevice(logs)


def open_wired(cell: Cell, ports: Mapping[str, int], wire: WireSink) -> Devices:
    """Open the devices of the demo's cell at the simulators' ports.

    Raises
    ------
    ConfigError
        A driver refuses its options.
    """
    robot, instrument = (f"tcp://127.0.0.1:{ports[name]}" for name in _DRIVERS)
    return open_devices(cell, robot_url=robot, instrument_url=instrument, wire=wire)


def targets_csv(targets: Targets, robot: Robot) -> str:
    """Return target and corrected joints of the verified poses as CSV.

    They are counted as by the controller, in deg or mm.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    wanted = [f"wanted{column.removeprefix('j')}" for column in robot.joint_columns]
    writer.writerow(["target_id", *wanted, *robot.joint_columns])
    for i, (wanted, sent) in enumerate(zip(targets.wanted, targets.corrected, strict=True), start=1):
        writer.writerow([i, *(f"{q:.4f}" for q in (*wanted, *sent))])
    return text.getvalue()

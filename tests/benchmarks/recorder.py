"""`python -m tests.benchmarks.recorder [SECONDS]`: load of one core by the recorder.

It records 500 and 1,000 samples per second with drivers, recorder and record together, over real sockets. The
simulated cell is a separate process and runs 4 times as fast as real devices, which makes 4 x 125 and 4 x 250
samples per real second. The load is printed, not judged by a test. Run it on an idle machine: a simulator that is
more than a quarter of a second late leaves samples out.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from acquisition import Event, Run, campaign_from, read_cell
from acquisition.cell import cell_from
from calib.text import parse_toml
from drivers import RehearsalOperator
from service.simulated_cell import simulated_cell

EXAMPLE = Path(__file__).parents[2] / "examples" / "ur5_leica" / "path_cell.toml"
TIME_SCALE = 4.0
MIDDLE = (40.0, -105.0, 100.0, -85.0, -90.0, 0.0)


def main(seconds: float) -> None:
    """Record for `seconds` of real time, with the robot resting between two moves."""
    text = read_cell(EXAMPLE).source.replace("time_scale = 8.0", f"time_scale = {TIME_SCALE}")
    cell = cell_from(parse_toml(text, str(EXAMPLE)), str(EXAMPLE), source=text)
    waypoints = [list(MIDDLE), [45.0, *MIDDLE[1:]], list(MIDDLE)]
    block = {"kind": "path", "select": "list", "targets": ["T1"], "joints_deg": waypoints}
    block |= {"rest_s": seconds * TIME_SCALE / len(waypoints), "instrument_hz": 250.0}
    campaign = campaign_from({"format": "truepose-campaign/1", "block": [block]}, "campaign.toml")
    marks: list[tuple[float, float, dict[str, int], dict[str, int]]] = []

    def note(event: Event) -> None:
        if event.kind == "waypoint":
            if event.data["waypoint"] == 1:
                marks.clear()
            marks.append((time.process_time(), time.monotonic(), event.data["samples"], event.data["lost"]))
        elif event.kind == "attempt_failed":
            print(f"again: {event.data['error']['message']}")

    with (
        TemporaryDirectory() as folder,
        Run.create(Path(folder), cell, campaign, simulated=True) as run,
        simulated_cell(cell) as simulated,
    ):
        run.execute(
            simulated.open(cell, RehearsalOperator()),
            on_event=note,
        )
    (cpu_0, wall_0, first, _), (cpu_1, wall_1, last, lost) = marks[0], marks[-1]
    wall = wall_1 - wall_0
    rates = ", ".join(f"{role} {(last[role] - first[role]) / wall:,.0f}/s" for role in last)
    print(f"{wall:.0f} s on the wall: {rates}; lost {lost}; {(cpu_1 - cpu_0) / wall:.1%} of one core")
    print(
        f"load {os.getloadavg()[1]:.1f} on {os.cpu_count()} cores; what the simulator sends too late counts as lost"
    )


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0)

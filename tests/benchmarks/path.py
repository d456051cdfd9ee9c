"""`python -m tests.benchmarks path`: rehearse the whole path of `examples/ur5_leica`.

It has 38 waypoints in about 670 s. The path is exported and aligned by the commands of the example's README, and
its clocks are compared with those of the simulated devices. The program takes a minute or two.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from mocks.cell import Cell
from mocks.cell_file import read_cell
from service.cli import main
from tests.benchmarks.clock import line

EXAMPLE = Path(__file__).parents[2] / "examples" / "ur5_leica"
OFFSET_S, RATE, WAYPOINTS = 1e-3, 2e-6, 38


def run() -> bool:
    """Print lost samples, errors of offset and rate, and the stationary intervals."""
    with tempfile.TemporaryDirectory() as folder:
        record, out, told = (Path(folder) / name for name in ("record", "path.csv", "told.json"))
        files = [str(EXAMPLE / name) for name in ("path_cell.toml", "path_campaign.toml")]
        done = main(["campaign", "run", *files, "--record", str(record), "--simulate"])
        done |= main(["campaign", "export", str(record), str(out), "--streams", "--json", str(told)])
        (path,) = json.loads(told.read_text("utf-8"))["paths"]
        command = ["align", path["robot"], path["tracker"], str(Path(folder) / "standstills.csv")]
        tool = ("55", "0", "169.5")
        done |= main([*command, "--robot", "ur5", "--tool", *tool, "--holdout", "0", "--json", str(told)])
        found = json.loads(told.read_text("utf-8"))
    clocks = found["clocks"]
    offset, rate = true_clocks(EXAMPLE / "path_cell.toml", clocks["at_tracker_s"])
    off, fast = clocks["offset_s"] - offset, 1e-6 * clocks["rate_ppm"] - rate
    print(f"    samples {path['samples']}, lost {path['lost']}")
    reached = [done == 0, abs(off) <= OFFSET_S, abs(fast) <= RATE, found["waypoints"] == WAYPOINTS]
    stated = f"{1e3 * clocks['u_offset_s']:.3f} ms, {clocks['u_rate_ppm']:.3f} ppm"
    line(
        f"clock offset against the truth (stated, 1 sigma: {stated})",
        f"{1e3 * off:+.4f} ms",
        "1 ms",
        reached[1],
    )
    line("clock rate against the truth", f"{1e6 * fast:+.3f} ppm", "2 ppm", reached[2])
    line("waypoints at which it stood still", str(found["waypoints"]), str(WAYPOINTS), reached[3])
    return all(reached)


def true_clocks(cell: Path, tracker_s: float) -> tuple[float, float]:
    """Return offset, s, and rate of the true robot's clock against the tracker's.

    The offset is that at an instant of the tracker's clock.
    """
    simulated = Cell(read_cell(cell), devices=("ur", "leica"))
    robot, tracker = simulated.ur_clock, simulated.leica.bridge.clock
    share = (1.0 + robot.rate) / (1.0 + tracker.rate)
    return robot.offset_s + share * (tracker_s - tracker.offset_s) - tracker_s, share - 1.0

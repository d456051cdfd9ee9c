"""`python -m tests.benchmarks [NAME [COUNT]]`: results that the program must reach.

`real_data` takes names of data sets instead of a count, and `--enter`.

Without a name all but the demos and the peers run. Every result is a ratio within one run, or a count over seeded
campaigns, so that it means the same on any machine. Exit code 1 if one is missed.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: one thread against one thread

from tests.benchmarks import (
    adaptive,
    adaptive_ballbar,
    align,
    ballbar,
    campaign,
    clearance,
    coverage,
    demo,
    diagnosis,
    fleet_diagnose,
    fleet_kills,
    fleet_store,
    floor,
    freedoms,
    hexapod,
    identification,
    inverse,
    kinematics,
    machines,
    misread,
    nests,
    outbox,
    overhead,
    pairs,
    parsers,
    path,
    peers,
    priors,
    ready,
    real_data,
    regress,
    report,
    robot_check,
    selection,
    status,
    stop,
    strangers,
    upkeep,
    watch,
    watch_baselines,
    watch_plans,
)

BENCHMARKS: dict[str, tuple[Callable[..., bool], int | None]] = {
    "adaptive": (adaptive.run, 20),
    "adaptive_ballbar": (adaptive_ballbar.run, 10),
    "kinematics": (kinematics.run, None),
    "identification": (identification.run, None),
    "selection": (selection.run, None),
    "pairs": (pairs.run, None),
    "inverse": (inverse.run, None),
    "freedoms": (freedoms.run, None),
    "hexapod": (hexapod.run, None),
    "clearance": (clearance.run, None),
    "overhead": (overhead.run, None),
    "align": (align.run, 20),
    "stop": (stop.run, 20),
    "status": (status.run, None),
    "ready": (ready.run, None),
    "report": (report.run, None),
    "parsers": (parsers.run, None),
    "floor": (floor.run, 50),
    "regress": (regress.run, 40),
    "coverage": (coverage.run, 300),
    "diagnosis": (diagnosis.run, 100),
    "strangers": (strangers.run, 1),
    "machines": (machines.run, 3),
    "misread": (misread.run, 3),
    "robot_check": (robot_check.run, 2),
    "nests": (nests.run, 20),
    "ballbar": (ballbar.run, 20),
    "watch": (watch.run, 100),
    "fleet_diagnose": (fleet_diagnose.run, 64),
    "fleet_kills": (fleet_kills.run, 2000),
    "fleet_store": (fleet_store.run, 100_000),
    "outbox": (outbox.run, 10_000),
    "watch_baselines": (watch_baselines.run, 25),
    "watch_plans": (watch_plans.run, 500),
    "upkeep": (upkeep.run, 10),
    "priors": (priors.run, 20),
    "campaign": (campaign.run, 200),
    "demo": (demo.run, 20),
    "path": (path.run, None),
    "peers": (peers.run, None),
    "real_data": (real_data.run, None),
}
"""Name -> function, and the number of campaigns that it takes, where it takes one."""

APART = ("campaign", "demo", "fleet_kills", "outbox", "path", "peers", "real_data", "report")
"""Run by name only: kills, demos and the path take minutes, peers are installed first, the real data lie elsewhere."""


def main() -> int:
    """Run the requested benchmarks; return 0 if every result is reached."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description="Ratios and counts")
    parser.add_argument("name", nargs="?", choices=tuple(BENCHMARKS))
    parser.add_argument(
        "count", nargs="*", help="campaigns (each benchmark has its own default). real_data: sets"
    )
    parser.add_argument("--enter", action="store_true", help="real_data: keep the figures of this run")
    options = parser.parse_args()
    if options.name == "real_data":
        return 0 if real_data.run(options.count, enter=options.enter) else 1
    names = [n for n in BENCHMARKS if n not in APART] if options.name is None else [options.name]
    reached = True
    for name in names:
        run, usual = BENCHMARKS[name]
        reached &= run() if usual is None else run(int(options.count[0]) if options.count else usual)
    return 0 if reached else 1


if __name__ == "__main__":
    sys.exit(main())

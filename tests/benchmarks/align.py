"""Benchmark of the alignment of robot and tracker clocks, on simulated recordings.

The recordings follow the paper's set-up: 38 waypoints in 600 s, 75,000 samples of the robot, 6,000 of the tracker.
The time from the two files to the data set is measured as well. The same is repeated for arms that bend and that
have worn gears, also with slow motion between 8 waypoints only.
"""

from __future__ import annotations

import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from calib import load_robot
from calib.motion import Aligned, JointStream, PointStream, align
from service.results.files.alignment import aligned_of
from service.results.files.alignment_request import AlignmentRequest
from tests.benchmarks.clock import line
from tests.calib.bending import gears
from tests.calib.moving import TOOL, Moving, simulate, write_robot, write_tracker

OFFSET_S, RATE, JUMP_S = 1e-3, 2e-6, 0.010
SECONDS = 2.0  # of processor time
_JUMP_AT_S = (60.0, 540.0)
_COVERED = 0.85  # of 95 % intervals: three of twenty may miss by chance
_ARMS: dict[str, dict[str, Any]] = {
    "stiff arm": {},
    "arm that bends": {"gears_of": gears},
    "arm that bends, with worn gears": {"gears_of": partial(gears, waves_rad=2e-4, play_rad=1e-4)},
}
_PATHS: dict[str, dict[str, Any]] = {
    "38 waypoints in 600 s": {},
    "12 waypoints in 120 s": {"legs": 12, "duration": 120.0},
    "8 waypoints in 300 s": {"legs": 8, "duration": 300.0, "rest": 5.0},
}


def run(count: int) -> bool:
    """Print errors of offset and rate, jumps found and invented, and the time."""
    plain, jumped = [], []
    for seed in range(1, count + 1):
        at = float(np.random.default_rng(seed).uniform(*_JUMP_AT_S))
        plain.append(_errors(simulate(seed)))
        jumped.append(_errors(simulate(seed, jump=(at, JUMP_S))))
    offset, rate, step, in_u, steps, _ = (np.array(column) for column in zip(*plain, strict=True))
    reached = [float(np.abs(offset).max()) <= OFFSET_S, float(np.abs(rate).max()) <= RATE, not steps.any()]
    line(
        f"clock offset over {count} recordings, largest error (RMS {1e3 * _rms(offset):.4f} ms)",
        f"{1e3 * np.abs(offset).max():.4f} ms",
        f"<= {1e3 * OFFSET_S:g} ms",
        reached[0],
    )
    line(
        f"clock rate, largest error (RMS {1e6 * _rms(rate):.3f} ppm)",
        f"{1e6 * np.abs(rate).max():.3f} ppm",
        f"<= {1e6 * RATE:g} ppm",
        reached[1],
    )
    line("jumps invented where there are none", str(int(steps.sum())), "0", reached[2])
    line(
        "offset's error over its standard error, RMS",
        f"{_rms(in_u):.2f}",
        "0.5 to 2",
        0.5 <= _rms(in_u) <= 2.0,
    )
    _, _, step, _, steps, _ = (np.array(column) for column in zip(*jumped, strict=True))
    found = int((steps & (np.abs(step - JUMP_S) < 1e-3)).sum())
    line("planted jumps of 10 ms found to 1 ms", f"{found} of {count}", f"{count} of {count}", found == count)
    arms = [_of_arms(count, path, arm) for path in _PATHS for arm in _ARMS]
    seconds = _time()
    quick = seconds < SECONDS
    line("from two files to standstills, processor time", f"{seconds:.2f} s", f"< {SECONDS:g} s", quick)
    return all(reached) and found == count and 0.5 <= _rms(in_u) <= 2.0 and all(arms) and quick


def _of_arms(count: int, path: str, arm: str) -> bool:
    """Judge clock errors, false jumps and coverage of the 95 % interval, for one arm and path."""
    found = [_errors(simulate(seed, **_PATHS[path], **_ARMS[arm])) for seed in range(1, count + 1)]
    offset, rate, _, in_u, steps, rate_in_u = (np.array(column) for column in zip(*found, strict=True))
    covered, rates_covered = (float(np.mean(np.abs(each) < 1.96)) for each in (in_u, rate_in_u))
    good = not steps.any() and covered >= _COVERED and float(np.abs(offset).max()) <= OFFSET_S
    line(
        f"{path}, {arm}: offset at most {1e3 * np.abs(offset).max():.3f} ms, rate {1e6 * np.abs(rate).max():.2f} ppm; "
        f"rate in its 95 % interval {rates_covered:.0%}; jumps invented {int(steps.sum())}; offset in its interval",
        f"{covered:.0%}",
        "95 %, no jump, 1 ms",
        good,
    )
    return good


def _errors(moving: Moving) -> tuple[float, float, float, float, bool, float]:
    """Return the errors of the fitted clocks.

    The first items are the errors of offset and rate, the step, and the offset's error in standard errors. Then
    follow whether a step is detected, fitted or named, and the rate's error in standard errors.
    """
    found: Aligned = align(
        load_robot("ur5"),
        JointStream(moving.robot_time, moving.joints),
        PointStream(moving.tracker_time, moving.points),
        TOOL,
    )
    clocks = found.clocks
    offset, rate = clocks.offset - moving.offset, clocks.rate - moving.rate
    return (
        offset,
        rate,
        clocks.step,
        offset / found.u_offset,
        bool(np.isfinite(clocks.step_at)) or any("step by another" in text for text in found.warnings),
        rate / found.u_rate,
    )


def _time() -> float:
    with tempfile.TemporaryDirectory() as folder:
        moving = simulate(1)
        robot = write_robot(Path(folder) / "robot.csv", moving)
        tracker = write_tracker(Path(folder) / "tracker.csv", moving)
        begin = time.process_time()
        aligned_of(robot, tracker, AlignmentRequest(tool=TOOL, robot="ur5"))
        return time.process_time() - begin


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))

"""Benchmark of campaigns: nothing lost after kills, and the overhead of the sequencer.

Kills: campaigns of 300 poses run on a simulated cell over real sockets, and programs are killed at random moments.
There are `count` kills in all, `KILLS_EACH` per campaign. No acknowledged reading may be lost or doubled, every
shot must be known by its attempt, and every campaign must reach its end.

Overhead: 10,000 poses on devices that cost nothing, with the record on the disk of the temporary folder (every pose
is three syncs of it). Time within the devices is not counted. Limits: 5 ms of processor time per pose, memory flat,
and a record of 9,900 readings resumed within 2 s and exported within 3 s. The elapsed time, which waits for the
disk and for other load of the machine, is printed: the best `BLOCK` poses in a row, all of them, and three bare
commits.
"""

from __future__ import annotations

import os
import random
import sqlite3
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from acquisition import Devices, Event, Run, export
from calib.array import Array
from drivers import JointReading, PointReading
from tests.acquisition.fakes import Bench, FakeArm, FakeMeter, JumpingClock, a_campaign, a_cell
from tests.benchmarks.clock import line
from tests.end_to_end.killing import kill_and_resume
from tests.end_to_end.simulated import campaign_file, cell_file

POSES, KILLS_EACH, READINGS_A_LIFE = 300, 40, 40
MANY, LEFT, BLOCK = 10_000, 100, 300
MS, MIB, RESUME_S, EXPORT_S = 5.0, 8.0, 2.0, 3.0


def run(count: int = 200) -> bool:
    """Print the figures; True when all are reached."""
    reached = overhead()
    return kills(count) and reached


# -- kills ------------------------------------------------------------------------------------------------


def kills(count: int) -> bool:
    """Run campaign after campaign until `count` programs were killed."""
    killed = told = lost = twice = unknown = repeated = unfinished = 0
    while killed < count:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            cell_file(folder, time_scale=1000.0)
            campaign_file(folder, calibration=POSES - 20, validation=20, warm_up_s=0.0, samples=20)
            wanted = min(KILLS_EACH, count - killed)
            tally = kill_and_resume(folder, wanted, READINGS_A_LIFE, random.Random(killed))
        killed += tally.killed
        told += len(tally.acknowledged)
        lost, twice, unknown = lost + tally.lost, twice + tally.twice, unknown + tally.unknown
        repeated += tally.shots - tally.good
        unfinished += not (tally.ending.startswith("succeeded") and tally.sound and tally.left == 0)
        print(f"  {killed:>4} killed, {told} readings acknowledged, {repeated} shots in flight", flush=True)
    line(f"acknowledged readings lost, of {told}, by {killed} kills", str(lost), "0", lost == 0)
    line("readings twice", str(twice), "0", twice == 0)
    line(f"shots that no attempt knows of (in flight: {repeated})", str(unknown), "0", unknown == 0)
    line("campaigns not at their end, or damaged", str(unfinished), "0", unfinished == 0)
    return lost == twice == unknown == unfinished == 0


# -- overhead ---------------------------------------------------------------------------------------------


def _now() -> Array:
    """Seconds on the wall, and of the processor."""
    return np.array([time.perf_counter(), time.process_time()])


class _Timer:
    """Seconds within the devices, as `_now` counts them."""

    def __init__(self) -> None:
        self.seconds = np.zeros(2)

    @contextmanager
    def running(self) -> Iterator[None]:
        begin = _now()
        try:
            yield
        finally:
            self.seconds += _now() - begin


class _Arm(FakeArm):
    def __init__(self, bench: Bench, timer: _Timer) -> None:
        super().__init__(bench)
        self._timer = timer

    def move_to(self, joints_deg: Sequence[float]) -> JointReading:
        with self._timer.running():
            return super().move_to(joints_deg)


class _Meter(FakeMeter):
    """Forgets what it did, so that only the sequencer's memory grows."""

    def __init__(self, bench: Bench, timer: _Timer) -> None:
        super().__init__(bench)
        self._timer = timer

    def measure(self, target: str, **options: Any) -> PointReading:
        with self._timer.running():
            self.bench.log.clear()
            self.bench.shots.clear()
            return super().measure(target, **options)


def overhead() -> bool:
    """One long campaign, paused shortly before its end, resumed, exported."""
    bench, timer = Bench(a_cell()), _Timer()
    devices = Devices(_Arm(bench, timer), _Meter(bench, timer))
    campaign = a_campaign(block=[{"set": "calibration", "count": MANY, "targets": ["T1"]}])
    clock = JumpingClock()
    memory: list[float] = []
    blocks: list[Array] = []
    with tempfile.TemporaryDirectory() as name:
        record = Path(name) / "record"
        commits_ms = 3 * _commit_ms(Path(name))
        with closing(Run.create(record, bench.cell, campaign, simulated=True)) as long:
            done = 0

            def heard(event: Event) -> None:
                nonlocal done
                if event.kind != "reading" or event.data["set"] == "nest":
                    return
                done += 1
                if done % BLOCK == 0:
                    blocks.append(_now() - timer.seconds)
                    memory.append(_resident_mib())
                if done == MANY - LEFT:
                    long.pause()

            long.execute(devices, clock, heard)
        each_ms = np.diff(blocks, axis=0) / BLOCK * 1e3
        wall_ms, cpu_ms = each_ms.mean(axis=0)
        resume_s = _resume(record, devices, clock)
        begin = time.perf_counter()
        export(record, Path(name) / "data.csv")
        export_s = time.perf_counter() - begin
    grown = memory[-1] - memory[1]
    wall = f"{each_ms[:, 0].min():.2f} to {wall_ms:.2f} ms on the wall, three bare commits {commits_ms:.2f}"
    print(f"  {done} poses: {wall}", flush=True)
    line("overhead a pose, processor time", f"{cpu_ms:.2f} ms", f"< {MS:g}", cpu_ms < MS)
    line(f"memory from pose {2 * BLOCK} to the end", f"{grown:+.1f} MiB", f"< {MIB:g}", grown < MIB)
    line("resume to the first motion", f"{resume_s:.2f} s", f"< {RESUME_S:g}", resume_s < RESUME_S)
    line("export", f"{export_s:.2f} s", f"< {EXPORT_S:g}", export_s < EXPORT_S)
    return bool(cpu_ms < MS and grown < MIB and resume_s < RESUME_S and export_s < EXPORT_S)


def _resume(record: Path, devices: Devices, clock: JumpingClock) -> float:
    """Seconds from opening the record to its first arrival; then it is measured to its end."""
    first: list[float] = []

    def heard(event: Event) -> None:
        if event.kind == "arrived" and not first:
            first.append(time.perf_counter())

    begin = time.perf_counter()
    with closing(Run.open(record)) as run:
        run.resume(by="benchmark")
        outcome = run.execute(devices, clock, heard)
        assert (outcome.state.value, run.status().done) == ("succeeded", MANY)
    return first[0] - begin


def _commit_ms(folder: Path) -> float:
    """Mean time of a durable commit of one row on this disk, now."""
    with closing(sqlite3.connect(folder / "bare.sqlite3", isolation_level=None)) as db:
        db.executescript("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; CREATE TABLE t (x TEXT)")
        begin = time.perf_counter()
        for _ in range(300):
            db.execute("INSERT INTO t VALUES (?)", ("x" * 300,))
        return (time.perf_counter() - begin) / 300 * 1e3


def _resident_mib() -> float:
    """Memory in use now (Linux)."""
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


if __name__ == "__main__":
    sys.exit(0 if run(int(sys.argv[1]) if len(sys.argv) > 1 else 200) else 1)

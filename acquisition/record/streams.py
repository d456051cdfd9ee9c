"""The streams of a record: samples of robot and instrument along a path, in sealed chunks.

Each chunk is one durable transaction: a crash loses the samples after the last of them, less than a second, and the
record marks the end of each stream. `export_streams` writes the two files that `truepose align` reads.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomli_w
from numpy.typing import NDArray

from acquisition.cell.cell import Cell, cell_of_record
from acquisition.errors import RecordError
from acquisition.record.export import noise_table
from acquisition.record.store import RecordStore
from calib.text import replace_file

_HEAD = 4  # numbers of a sample before its values
_LAST_ATTEMPTS = """
SELECT pose.id, pose.name, pose.target, attempt.id AS attempt, attempt.status FROM pose
JOIN attempt ON attempt.pose = pose.id AND attempt.id = (
  SELECT id FROM attempt AS a WHERE a.pose = pose.id AND a.id IN (SELECT attempt FROM chunk)
  ORDER BY a.status = 'good' DESC, a.id DESC LIMIT 1)
WHERE pose.waypoints IS NOT NULL AND pose.replaced_by IS NULL ORDER BY pose.id
"""


@dataclass(frozen=True, slots=True)
class Arrived:
    """A sample of a stream in its stored form.

    `device_t_s` is its device's clock, `arrived_t_s` the campaign time, s; `lost` samples are missing before it.
    """

    device_t_s: float
    arrived_t_s: float
    lost: int
    doubted: bool
    values: tuple[float, ...]


@dataclass(frozen=True)
class RecordedStream:
    """A stream of m samples.

    `device_t_s` and `arrived_t_s` are in s; `lost` and `doubted` are those of each sample, all (m,). `values` (m, k)
    are in deg or mm.
    """

    device_t_s: NDArray[np.float64]
    arrived_t_s: NDArray[np.float64]
    lost: NDArray[np.int64]
    doubted: NDArray[np.bool_]
    values: NDArray[np.float64]


@dataclass(frozen=True)
class ExportedPath:
    """The two files of one path.

    `complete` states whether the robot reached its last waypoint; `target` is the target that was followed.
    """

    name: str
    target: str
    robot: Path
    tracker: Path
    samples: dict[str, int]
    lost: dict[str, int]
    complete: bool


def append(store: RecordStore, attempt: int, parts: Sequence[tuple[str, int, Sequence[Arrived]]]) -> None:
    """Write chunks of an attempt, all in one transaction that is durable when this returns.

    Each part is (role, number of its first sample, samples).

    Raises
    ------
    StorageError
        The record cannot be written.
    """
    with store.changing() as db:
        for role, first, samples in parts:
            rows = [(s.device_t_s, s.arrived_t_s, s.lost, s.doubted, *s.values) for s in samples]
            (chunk,) = db.execute(
                "INSERT INTO chunk (attempt, role, first, samples, lost, from_t_s, until_t_s, arrived_t_s, data) "
                "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?) RETURNING id",
                (
                    *(attempt, role, first, len(samples), sum(s.lost for s in samples)),
                    *(samples[0].device_t_s, samples[-1].device_t_s, samples[-1].arrived_t_s),
                    np.array(rows, dtype="<f8").tobytes(),
                ),
            ).fetchone()
            store.seals.row(db, "chunk", chunk)


def read_stream(store: RecordStore, attempt: int, role: str) -> RecordedStream:
    """Return the stream of one role in an attempt, up to its last sample.

    Raises
    ------
    RecordError
        There are no samples.
    """
    rows = store.database.query(
        "SELECT samples, data FROM chunk WHERE attempt = ? AND role = ? ORDER BY first", (attempt, role)
    )
    if not rows:
        raise RecordError(f"{store.database.path}: attempt {attempt} holds no samples of the {role}")
    table = np.vstack([np.frombuffer(row["data"], dtype="<f8").reshape(row["samples"], -1) for row in rows])
    return RecordedStream(
        table[:, 0], table[:, 1], table[:, 2].astype(np.int64), table[:, 3] > 0.0, table[:, _HEAD:]
    )


def export_streams(
    record_dir: Path, out: Path, permit: Callable[[Sequence[Path]], object] = lambda files: None
) -> tuple[Cell, list[ExportedPath]]:
    """Write the streams of the paths of a record.

    The files are OUT_robot.csv, OUT_tracker.csv and its noise, OUT_tracker.toml; they are numbered if the record has
    several paths. For a path that was never completed, the last attempt is exported up to its last sample. A doubted
    sample of the robot is left out and leaves a gap; one of the tracker has its status. `permit` is called with all
    files before any is written, and may raise.

    Raises
    ------
    RecordError
        The record has no streams.
    StorageError
        The record cannot be read.
    OSError
        A file cannot be written.
    """
    with RecordStore.reading(record_dir) as store:
        cell = cell_of_record(store.campaign["cell"], str(store.database.path))
        attempts = store.database.query(_LAST_ATTEMPTS)
        if not attempts:
            raise RecordError(
                f"{record_dir}: holds no streams",
                what_to_do="Measure a campaign with a block of kind = 'path'; without --streams its readings are "
                "exported.",
            )
        done, texts = [], dict[Path, str]()
        for number, row in enumerate(attempts, start=1):
            stem = out.with_suffix("")
            if len(attempts) > 1:
                stem = stem.with_name(f"{stem.name}_{number}")
            robot, tracker = (read_stream(store, row["attempt"], role) for role in ("robot", "instrument"))
            files = [stem.with_name(f"{stem.name}_{what}.csv") for what in ("robot", "tracker")]
            simulated = bool(store.campaign["simulated"])
            texts |= {files[0]: _robot_text(robot, simulated), files[1]: _tracker_text(tracker, simulated)}
            header = {"noise": noise_table(cell, (0.0, 0.0, 0.0))}  # points are in the instrument's frame
            texts[files[1].with_suffix(".toml")] = tomli_w.dumps(header)
            both = {"robot": robot, "instrument": tracker}
            done.append(
                ExportedPath(
                    row["name"],
                    row["target"],
                    *files,
                    samples={role: len(each.device_t_s) for role, each in both.items()},
                    lost={role: int(each.lost.sum()) for role, each in both.items()},
                    complete=row["status"] == "good",
                )
            )
    permit(list(texts))
    for file, text in texts.items():
        replace_file(file, text)
    return cell, done


def _robot_text(stream: RecordedStream, simulated: bool) -> str:
    names = [f"j{k}_deg" for k in range(1, stream.values.shape[1] + 1)]
    kept = ~stream.doubted
    rows = zip(
        stream.device_t_s[kept],
        stream.values[kept],
        stream.arrived_t_s[kept],
        stream.lost[kept],
        strict=True,
    )
    return _text(
        ["t_s", *names, "arrived_t_s", "lost_before"],
        ((f"{t:.6f}", *(f"{q:.6f}" for q in joints), f"{at:.4f}", lost) for t, joints, at, lost in rows),
        simulated,
    )


def _tracker_text(stream: RecordedStream, simulated: bool) -> str:
    rows = zip(stream.device_t_s, stream.values, stream.doubted, stream.arrived_t_s, stream.lost, strict=True)
    return _text(
        ["t_s", "x_mm", "y_mm", "z_mm", "status", "arrived_t_s", "lost_before"],
        (
            (f"{t:.6f}", *(f"{x:.6f}" for x in point), "doubted" if doubted else "ok", f"{at:.4f}", lost)
            for t, point, doubted, at, lost in rows
        ),
        simulated,
    )


def _text(names: Sequence[str], rows: Iterable[Sequence[object]], simulated: bool) -> str:
    """Format names and rows as CSV, with a column `simulated` of ones for simulators."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    label = (1,) if simulated else ()
    writer.writerow([*names, *(["simulated"] if simulated else [])])
    writer.writerows([*row, *label] for row in rows)
    return text.getvalue()

"""History of a robot's watches, one JSON object per line (`truepose-watch-history/1`).

Lines are appended. A line contains the residuals whitened by noise, so that the mean over watches needs no old data
sets. It also contains the hashes of the readings, of the baseline and of the poses: only lines of the same baseline and
poses are averaged. A data set that is already in the history is not written again.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.array import Array
from calib.data.dataset import Dataset
from calib.errors import DataError
from calib.saved import CalibratedModel
from calib.text import read_text, replace_file
from calib.text.json_text import parse_json
from calib.watch.judge import WatchVerdict
from calib.watch.whitened_readings import WhitenedReadings

FORMAT = "truepose-watch-history/1"
_TEXTS = ("data_sha256", "baseline_sha256", "poses_sha256", "verdict")
_LARGEST = 1e12  # limit of a residual, in standard deviations


@dataclass(frozen=True)
class WatchHistory:
    """Lines of a history file, oldest first."""

    lines: tuple[dict[str, Any], ...]

    def before(self, seen: WhitenedReadings, dataset: Dataset, baseline: str) -> tuple[list[Array], int]:
        """Collect the residuals of earlier watches that can be averaged with this one.

        If this data set was judged already, the search stops at its line.

        Returns
        -------
        found : list of array of shape (q,)
            Residuals of the watches of the same baseline and poses, oldest first.
        left_out : int
            Number of lines that do not match.
        """
        marks = (baseline, poses_hash(seen))
        found, left_out = [], 0
        for line in self.lines:
            if line["data_sha256"] == dataset.sha256:
                break
            residual = np.array(line["residual"], dtype=np.float64)
            if (
                line["baseline_sha256"],
                line["poses_sha256"],
            ) == marks and residual.shape == seen.residual.shape:
                found.append(residual)
            else:
                left_out += 1
        return found, left_out

    def holds(self, dataset: Dataset) -> bool:
        """Check if a data set was judged before."""
        return any(line["data_sha256"] == dataset.sha256 for line in self.lines)


def read_history(path: Path) -> WatchHistory:
    """Read a history file; a file that does not exist is an empty history.

    Raises
    ------
    DataError
        A line is not a watch; the message names the line.
    """
    if not path.exists():
        return WatchHistory(())
    lines = []
    for number, text in enumerate(read_text(path).split("\n"), start=1):
        if not text.strip():
            continue
        try:
            line = parse_json(text, path)
        except DataError as error:
            raise _broken(path, number) from error
        if not _whole(line):
            raise _broken(path, number)
        lines.append(line)
    return WatchHistory(tuple(lines))


def _whole(line: Any) -> bool:
    """Check that a line is a watch: texts under their keys, and finite residuals (q,)."""
    if not isinstance(line, dict) or line.get("format") != FORMAT:
        return False
    residual = line.get("residual")
    return (
        all(isinstance(line.get(key), str) for key in _TEXTS)
        and isinstance(residual, list)
        and all(type(x) in (int, float) and abs(x) < _LARGEST for x in residual)
    )


def _broken(path: Path, number: int) -> DataError:
    return DataError(
        "is not a line of a history of watches.",
        do="Remove the line, or name another file.",
        file=path,
        line=number,
    )


def append(
    path: Path, seen: WhitenedReadings, dataset: Dataset, baseline: str, verdict: WatchVerdict
) -> None:
    """Append a watch to a history file.

    Raises
    ------
    DataError
        The file cannot be read.
    OSError
        The file cannot be written.
    """
    occasion = dataset.header.occasion
    line = {
        "format": FORMAT,
        "measured": None if occasion is None else occasion.began,
        "data_sha256": dataset.sha256,
        "baseline_sha256": baseline,
        "poses_sha256": poses_hash(seen),
        "verdict": verdict.kind,
        "causes": [cause.label for cause, _ in verdict.causes],
        "residual": [float(f"{x:.6g}") for x in seen.residual],
    }
    text = read_text(path) if path.exists() else ""
    text += "\n" if text and not text.endswith("\n") else ""  # nothing is appended to a truncated line
    replace_file(path, text + json.dumps(line, allow_nan=False) + "\n")


def poses_hash(seen: WhitenedReadings) -> str:
    """Hash the positions and the order of the readings (SHA-256).

    The hash covers joints, sides of approach, targets, and the kind of each measurement.
    """
    conditions = seen.readings.conditions
    columns = np.column_stack(
        [
            np.round(np.degrees(conditions.joints), 3),
            conditions.side,
            conditions.target,
            conditions.anchor,
            seen.readings.observed.freedom,
        ]
    )
    names = json.dumps([*conditions.target_names, *conditions.anchor_names])
    return hashlib.sha256(names.encode() + (columns + 0.0).tobytes()).hexdigest()


def baseline_hash(saved: CalibratedModel) -> str:
    """Hash the estimate of a baseline and the data that it was fitted to (SHA-256)."""
    return hashlib.sha256(saved.data_sha256.encode() + saved.estimate.tobytes()).hexdigest()

"""A foreign file as a data set: text columns, a header, and the rows that are held out."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from calib.array import Array
from calib.errors import DataError
from calib.text.columns import no_formula
from calib.text.parquet import PARQUET, parquet_of
from calib.text.text_file import replace_file

Holdout = Literal["auto", "random", "block", "none"]
BLOCKS = 20
_JOINT = re.compile(r"[je]\d+_(?:deg|mm)")
_SAME_POSE = 0.05  # deg or mm: joints that a controller reads back in one pose differ by less
_FEWEST_POSES = 22  # "auto" holds none out of fewer: the rest must determine some forty parameters
_FEWEST_LEFT = 3  # readings of a target in a series, which a fit needs
_PATH = 0.1  # median step from pose to pose along a path, as a share of the distance between any two poses


@dataclass(frozen=True)
class ConvertedTable:
    """A converted file: columns of equal length, and the text of the header.

    The names of the columns are those of the data-set format.

    Attributes
    ----------
    holdout : str
        Kind of hold-out that was applied; empty before that.
    note : str
        A sentence on the hold-out.
    """

    columns: dict[str, list[str]]
    header: str
    holdout: str = ""
    note: str = ""

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def hold_out(self, kind: Holdout = "auto", share: float = 0.2, seed: int = 1) -> ConvertedTable:
        """Mark a share of the poses as validation: drawn at random, or blocks of consecutive poses.

        A random hold-out is optimistic if poses have near neighbours that took part in the fit. The kind "auto"
        therefore takes blocks along a path. It leaves tables with few poses, or with a column `set`, as they are.
        Readings of one pose are held out together, otherwise the fit would have seen the points that it is to
        predict.

        Raises
        ------
        DataError
            The share is outside (0, 1), or the kind contradicts the column `set`.
        """
        if not 0.0 < share < 1.0:
            raise DataError(
                f"a share of {share:g} cannot be held out.",
                do="Give a share between 0 and 1; --holdout none holds nothing out.",
                key="holdout.share",
            )
        if kind == "none":
            return replace(self, holdout="none", note="nothing is held out for validation, as requested")
        if "set" in self.columns:
            if kind != "auto":
                raise DataError(
                    f"has a column 'set', which marks the held-out readings, and '{kind}' would hold out others.",
                    do="Leave --holdout out, or take the column 'set' out of the map.",
                    key="holdout.kind",
                )
            held = self.columns["set"].count("validation")
            return replace(
                self,
                holdout="as measured",
                note=f"{held} readings are held out for validation, as 'set' says",
            )
        # kind and seed name the rows that published figures were found by; only "auto" looks more closely
        pose, joints = self._poses(_SAME_POSE if kind == "auto" else 0.0)
        count = max(pose, default=-1) + 1
        usable = self._usable()
        measured = np.unique(np.array(pose)[usable])
        if kind == "auto" and len(measured) < _FEWEST_POSES:
            return replace(
                self,
                holdout="none",
                note=f"nothing is held out for validation: {len(measured)} poses were measured, and fewer than "
                f"{_FEWEST_POSES} leave none to spare",
            )
        path = kind == "auto" and _along_a_path(joints)
        how = "block" if path or kind == "block" else "random"
        random = np.random.default_rng(seed)
        if how == "random":
            drawn = random.choice(measured, max(1, round(share * len(measured))), replace=False)
        else:
            blocks = min(BLOCKS, count)
            chosen = random.choice(blocks, max(1, round(share * blocks)), replace=False)
            drawn = np.flatnonzero(np.isin(np.arange(count) * blocks // count, chosen))
        held = self._sparing(np.array(pose), drawn, usable)
        columns = {}
        for name, cells in self.columns.items():
            columns[name] = cells
            if name == "reading_id":
                columns["set"] = ["validation" if row else "calibration" for row in held]
        poses = len(np.unique(np.array(pose)[held & usable]))
        drawing = "whole blocks of consecutive poses" if how == "block" else f"drawn at random, seed {seed}"
        why = ", because consecutive poses lie close together" if path else ""
        return replace(
            self,
            columns=columns,
            header=f'{self.header}\n[holdout]\nkind = "{how}"\nshare = {share:g}\nseed = {seed}\n',
            holdout=how,
            note=f"{int(held.sum())} readings, those of {poses} of {len(measured)} poses, are held out for "
            f"validation ({drawing}{why})",
        )

    def _poses(self, within: float) -> tuple[list[int], Array]:
        """Number the poses of the rows in order, and return the joints (p, N) of each, deg or mm.

        Rows of one waypoint are one pose. Without waypoints, rows whose joints differ by at most `within` are one
        pose.
        """
        named = [cells for name, cells in self.columns.items() if _JOINT.fullmatch(name)]
        joints = np.array([[float(cell or "nan") for cell in cells] for cells in named]).T
        joints = np.nan_to_num(joints) if named else np.arange(len(self), dtype=np.float64)[:, None]
        pose = np.full(len(self), -1)
        count = 0
        if "waypoint" in self.columns:
            seen: dict[str, int] = {}
            pose = np.array([seen.setdefault(name, len(seen)) for name in self.columns["waypoint"]])
        else:
            tree = KDTree(joints)
            for i in range(len(self)):  # a pose contains the rows near its first row
                if pose[i] < 0:
                    near = np.array(tree.query_ball_point(joints[i], within, p=np.inf))
                    pose[near[pose[near] < 0]] = count
                    count += 1
        return pose.tolist(), joints[np.unique(pose, return_index=True)[1]]

    def _usable(self) -> NDArray[np.bool_]:
        """Return the mask (n,) of the rows that hold a reading that counts."""
        n = len(self)
        status = np.isin(np.char.lower(self.columns.get("status", [""] * n)), ("", "ok"))
        measured = [
            np.array(self.columns[name]) != "" for name in ("x_mm", "length_mm") if name in self.columns
        ]
        return status & np.any(measured, axis=0) if measured else status

    def _sparing(
        self, pose: NDArray[np.int64], drawn: NDArray[np.int64], usable: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Return the mask (n,) of the rows of drawn poses that can be held out.

        A pose is spared if a target or a series could not be fitted without it.
        """
        n = len(self)
        of = list(zip(*(self.columns.get(name, [""] * n) for name in ("series", "tool_target")), strict=True))
        left = Counter(key for key, counts in zip(of, usable, strict=True) if counts)
        rows: dict[int, list[int]] = {}
        for i in np.flatnonzero(np.isin(pose, drawn)):
            rows.setdefault(int(pose[i]), []).append(int(i))
        held = np.zeros(n, dtype=bool)
        for each in drawn.tolist():
            taken = Counter(of[i] for i in rows[each] if usable[i])
            if all(left[key] - number >= _FEWEST_LEFT for key, number in taken.items()):
                left -= taken
                held[rows[each]] = True
        return held

    @property
    def text(self) -> str:
        """The columns as CSV, with their names in the first line.

        A cell that a spreadsheet would calculate has a ' before it.
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows(
            zip(*([no_formula(cell) for cell in cells] for cells in self.columns.values()), strict=True)
        )
        return text.getvalue()

    def write(self, path: Path) -> None:
        """Write `path`, CSV or Parquet, and its `.toml`; neither is left half-written."""
        content = parquet_of(self.columns) if path.suffix == PARQUET else self.text
        replace_file(path.with_suffix(".toml"), self.header)
        replace_file(path, content)


def _along_a_path(joints: Array) -> bool:
    """Test whether poses (p, N) follow each other closely, as along a path.

    The reading at a pose could then be predicted from its neighbours.
    """
    if len(joints) < _FEWEST_POSES:
        return False
    step = np.linalg.norm(np.diff(joints, axis=0), axis=1)
    shuffled = np.random.default_rng(0).permutation(joints)
    apart = np.linalg.norm(np.diff(shuffled, axis=0), axis=1)
    return bool(np.median(step) < _PATH * np.median(apart))

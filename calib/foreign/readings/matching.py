"""Points of one file matched to the joints of another, by pose name, row order or time.

By name, a point may carry its target behind the pose's name (`P12_T2`), and several points of one pose
are several readings. Matching by order is used only if the map requires it. By time, a point belongs to
the nearest row of joints within `within_s`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.errors import DataError
from calib.foreign.files.layout import Layout
from calib.foreign.map.map_file import Map
from calib.foreign.readings.readings import ForeignReadings

_TARGET = re.compile(r"[\s_.:/-]((?:T|SMR|M|R|Target|Marker|Ball)[\s_-]?\d{1,2})$", re.IGNORECASE)
_LONGEST_TARGET = len("_Target_12")
_APART = " \u00a0\t\n\r\f\v_.:/-"  # what may stand between the name of a pose and that of its target
_SHOWN = 6


@dataclass(frozen=True)
class Matched:
    """Rows of joints and of points (n,) that belong together.

    `targets` come from the names of the points; None if these contain none.
    """

    joints: NDArray[np.int64]
    points: NDArray[np.int64]
    targets: tuple[str, ...] | None
    said: tuple[str, ...]


def pose_name(name: str) -> str:
    """Normalise a pose name for comparison.

    The result is the last part of `Collection::Group::Point`, without case and without a star behind.
    """
    return name.rsplit("::", 1)[-1].strip().rstrip("*").casefold()


def with_target(name: str, poses: set[str]) -> tuple[str, str]:
    """Pose and target of the name of a point; the target is '' where the whole is a pose's name."""
    plain = pose_name(name)
    if plain in poses:
        return plain, ""
    whole = name.rsplit("::", 1)[-1].strip().rstrip("*")
    match = _TARGET.search(whole, max(0, len(whole) - _LONGEST_TARGET))
    if match and (pose := whole[: match.start()].rstrip(_APART).casefold()) in poses:
        return pose, re.sub(r"[\s_-]", "", match[1]).upper()
    return plain, ""


def matched(
    joints: ForeignReadings,
    points: ForeignReadings,
    made: Map,
    layouts: Sequence[Layout],
    map_path: Path | str,
) -> Matched:
    """Match the rows of two files.

    Raises
    ------
    DataError
        The files do not show which rows belong together.
    """
    if made.by == "name":
        return _by_name(joints, points, layouts, map_path)
    if made.by == "order":
        return _by_order(joints, points, layouts)
    if made.by == "time":
        return _by_time(joints, points, made, layouts, map_path)
    raise DataError(
        "is missing.", do='Write by = "name", "order" or "time" under [match].', file=map_path, key="match.by"
    )


def _names(of: ForeignReadings, map_path: Path | str, what: str) -> tuple[str, ...]:
    for key in ("pose", "id"):
        if key in of.texts:
            return of.texts[key]
    raise DataError(
        f"has no column of names for the {what}.",
        do='Name it: pose = "Point" under [file.columns].',
        file=map_path,
        key="match.by",
    )


def _by_name(
    joints: ForeignReadings, points: ForeignReadings, layouts: Sequence[Layout], map_path: Path | str
) -> Matched:
    poses = [pose_name(name) for name in _names(joints, map_path, "joints")]
    where: dict[str, list[int]] = {}
    for i, pose in enumerate(poses):
        where.setdefault(pose, []).append(i)
    found = [with_target(name, set(where)) for name in _names(points, map_path, "points")]
    twice = [pose for pose, rows in where.items() if len(rows) > 1 and _differ(joints, rows)]
    if twice:
        raise DataError(
            f"names {len(twice)} poses twice with other joints ({', '.join(twice[:_SHOWN])}): it is not "
            f"clear which point belongs to which.",
            do="Give every row a unique name in both files, or match by time.",
            file=layouts[0].sheet.shown,
        )
    alone = [i for i, (pose, _) in enumerate(found) if pose not in where]
    if len(alone) * 2 > len(found):
        raise DataError(
            f"{len(alone)} of {len(found)} points have the name of no pose "
            f"({', '.join(found[i][0] for i in alone[:_SHOWN])}; "
            f"the joints have {', '.join(list(where)[:_SHOWN])}).",
            do="Give both files the same names; by = 'order' under [match] if their rows belong together in order.",
            file=layouts[1].sheet.shown,
        )
    kept = [i for i in range(len(found)) if found[i][0] in where]
    bare = {found[i][0] for i in alone}
    said = (
        [
            f"{len(alone)} points have the name of no pose and are left aside: {', '.join(sorted(bare)[:_SHOWN])}"
        ]
        if alone
        else []
    )
    unseen = set(where) - {pose for pose, _ in found}
    if unseen:
        said.append(
            f"{len(unseen)} poses have no point and are left aside: {', '.join(sorted(unseen)[:_SHOWN])}"
        )
    targets = tuple(found[i][1] for i in kept)
    if any(targets) and not all(targets):
        raise DataError(
            "some points carry a target behind the pose's name and others do not.",
            do="Name all points alike, P1_T1, P1_T2.",
            file=layouts[1].sheet.shown,
        )
    order = sorted(range(len(kept)), key=lambda k: where[found[kept[k]][0]][0])
    return Matched(
        np.array([where[found[kept[k]][0]][0] for k in order], dtype=np.int64),
        np.array([kept[k] for k in order], dtype=np.int64),
        tuple(targets[k] for k in order) if any(targets) else None,
        tuple(said),
    )


def _differ(joints: ForeignReadings, rows: Sequence[int]) -> bool:
    return bool(np.ptp(joints.joints[list(rows)], axis=0).max() > 1e-9)


def _by_order(joints: ForeignReadings, points: ForeignReadings, layouts: Sequence[Layout]) -> Matched:
    if len(joints) != len(points):
        raise DataError(
            f"has {len(points)} points for {len(joints)} rows of joints: they cannot belong together in order.",
            do="Remove what is too much (points of the table, repeats), or match by name.",
            file=layouts[1].sheet.shown,
        )
    rows = np.arange(len(joints))
    return Matched(rows, rows, None, ("matched by the order of the rows, as told",))


def _by_time(
    joints: ForeignReadings,
    points: ForeignReadings,
    made: Map,
    layouts: Sequence[Layout],
    map_path: Path | str,
) -> Matched:
    for of, layout in ((joints, layouts[0]), (points, layouts[1])):
        if "time" not in of.numbers or not np.isfinite(of.numbers["time"]).all():
            raise DataError(
                "has no time in every row.", do='Name its column: time = "Time[s]".', file=layout.sheet.shown
            )
    if made.within_s <= 0.0:
        raise DataError(
            "is missing.",
            do="State how far apart times may be, as in within_s = 1.0.",
            file=map_path,
            key="match.within_s",
        )
    one, other = joints.numbers["time"], points.numbers["time"]
    order = np.argsort(one, kind="stable")
    place = np.searchsorted(one[order], other)
    near = np.stack([order[np.clip(place - 1, 0, len(one) - 1)], order[np.clip(place, 0, len(one) - 1)]])
    apart = np.abs(one[near] - other)
    which = near[np.argmin(apart, axis=0), np.arange(len(other))]
    kept = np.flatnonzero(apart.min(axis=0) <= made.within_s)
    if len(kept) * 2 < len(other):
        raise DataError(
            f"{len(other) - len(kept)} of {len(other)} points were taken farther than {made.within_s:g} s "
            f"from any row of joints.",
            do="Check whether both clocks agree (time zone, summer time), or match by name.",
            file=layouts[1].sheet.shown,
        )
    second = np.sort(apart, axis=0)[1]
    unclear = kept[
        (second[kept] <= made.within_s) & (np.ptp(joints.joints[near[:, kept]], axis=0).max(axis=1) > 1e-6)
    ]
    if len(unclear):
        raise DataError(
            f"{len(unclear)} points lie within {made.within_s:g} s of two rows of joints.",
            do="Make within_s smaller.",
            file=layouts[1].sheet.shown,
            line=layouts[1].lines[int(unclear[0])] if int(unclear[0]) < len(layouts[1].lines) else None,
        )
    said = (
        [f"{len(other) - len(kept)} points belong to no row of joints and are left aside"]
        if len(kept) < len(other)
        else []
    )
    return Matched(which[kept], kept, None, tuple(said))

"""The progress of a path: its finished share, and the samples of an interrupted program."""

from __future__ import annotations

import sqlite3
from typing import Any

from acquisition.record.database import Database


def share_of_path(database: Database, last: dict[str, Any] | None) -> float:
    """Return the finished share of the current path, 0 to 1, according to the last waypoint.

    It is 0 if no path is being driven.
    """
    if last is None or last["of"] < 2:
        return 0.0
    rows = database.query("SELECT status FROM attempt WHERE id = ?", (last["attempt"],))
    return (last["waypoint"] - 1) / (last["of"] - 1) if rows and rows[0]["status"] == "open" else 0.0


def streams_kept(db: sqlite3.Connection, attempt: int) -> dict[str, Any]:
    """Return the state of the streams of an attempt by role, or nothing if it has none.

    The state has the number of samples kept, the number lost, the device's clock at the last, and its arrival, campaign
    s.
    """
    rows = db.execute(
        "SELECT role, sum(samples), sum(lost), max(until_t_s), max(arrived_t_s) FROM chunk WHERE attempt = ? "
        "GROUP BY role",
        (attempt,),
    ).fetchall()
    keys = ("samples", "lost", "until_t_s", "arrived_t_s")
    return {"streams": {row[0]: dict(zip(keys, tuple(row)[1:], strict=True)) for row in rows}} if rows else {}

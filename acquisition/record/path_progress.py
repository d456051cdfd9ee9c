"""The progress of a path: how much of it is driven, and what a program that ended in the middle of it has kept."""

from __future__ import annotations

import sqlite3
from typing import Any

from acquisition.record.database import Database


def share_of_path(database: Database, last: dict[str, Any] | None) -> float:
    """Share of the path in hand that is driven, 0 to 1, by the last waypoint noted; 0 where no path is in hand."""
    if last is None or last["of"] < 2:
        return 0.0
    rows = database.query("SELECT status FROM attempt WHERE id = ?", (last["attempt"],))
    return (last["waypoint"] - 1) / (last["of"] - 1) if rows and rows[0]["status"] == "open" else 0.0


def streams_kept(db: sqlite3.Connection, attempt: int) -> dict[str, Any]:
    """`streams` by role: samples kept, lost ones counted, the device's clock at the last, and when it came, campaign s.

    Empty for an attempt without streams.
    """
    rows = db.execute(
        "SELECT role, sum(samples), sum(lost), max(until_t_s), max(arrived_t_s) FROM chunk WHERE attempt = ? "
        "GROUP BY role",
        (attempt,),
    ).fetchall()
    keys = ("samples", "lost", "until_t_s", "arrived_t_s")
    return {"streams": {row[0]: dict(zip(keys, tuple(row)[1:], strict=True)) for row in rows}} if rows else {}

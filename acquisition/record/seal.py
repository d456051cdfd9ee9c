"""The checksum of a row of a record, which reveals damage on the disk.

SQLite detects a damaged page structure, but returns a number that was changed within a page as it is. The checksum
covers names and values of all columns that are not empty, the table and the id of the campaign: a row of another
record is refused as well. BLAKE2b, 8 bytes: it protects against accidents, not against forgery.

Sealed are the plan (`pose`), each attempt once it is closed (`attempt`), the devices, and from the campaign its
initial settings and its world frame.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from acquisition.errors import damaged
from acquisition.record.database import Database

SEALED = ("pose", "attempt", "device", "chunk")
_OF_CAMPAIGN = (
    "id",
    "name",
    "created_utc",
    "simulated",
    "cell",
    "campaign",
    "world",
    "unsealed_poses",
    "unsealed_attempts",
    "unsealed_devices",
)
_CHUNK = 1000  # rows at once: a record may be larger than the memory should hold


@dataclass(frozen=True)
class Disagreement:
    """A row that does not agree with its checksum."""

    table: str
    id: int
    kind: str = ""  # of an attempt

    def __str__(self) -> str:
        if self.table == "attempt":
            return f"{'reading' if self.kind == 'measure' else 'arrival'} {self.id}"
        names = {"pose": "planned reading", "device": "device", "chunk": "chunk"}
        name = names.get(self.table)
        return "what the campaign was begun with" if name is None else f"{name} {self.id}"


def checksum(campaign: str, table: str, row: Mapping[str, Any]) -> str:
    """Compute the checksum, 16 hexadecimal digits, of a row of `table`.

    `campaign` is the id of the campaign of the record.
    """
    parts = [campaign, table]
    for name in sorted(row):
        value = row[name]
        # SQLite keeps neither NaN, which becomes NULL, nor the sign of zero.
        if name == "checksum" or value is None or value != value:
            continue
        if isinstance(value, bytes):
            parts += (name, value.hex())
        elif isinstance(value, str):
            parts += (name, value)
        else:
            parts += (name, repr(float(value) + 0.0))
    text = "\x1f".join(parts).encode("utf-8", "surrogatepass")
    return hashlib.blake2b(text, digest_size=8).hexdigest()


def checksum_of_campaign(row: Mapping[str, Any]) -> str:
    """Compute the checksum of the row `campaign` without its state, which may change."""
    return checksum(row["id"], "campaign", {name: row[name] for name in _OF_CAMPAIGN})


def campaign_agrees(row: Mapping[str, Any]) -> bool:
    """Check that a campaign agrees with its checksum."""
    return row["checksum"] == checksum_of_campaign(row)


def agrees(campaign: Mapping[str, Any], table: str, row: Mapping[str, Any]) -> bool:
    """Check that a row agrees with its checksum; an attempt gets its own when it is closed."""
    if table == "attempt" and row["status"] == "open":
        return True
    return row["checksum"] == checksum(campaign["id"], table, row)


class Seals:
    """Writer of the checksums of one record.

    Every method is called within a change, after its last statement for the row.
    """

    def __init__(self) -> None:
        self._campaign = ""  # its id, once it is known

    def campaign(self, db: sqlite3.Connection) -> None:
        """Seal the campaign again after its initial settings or its world frame were written."""
        row = dict(db.execute("SELECT * FROM campaign").fetchone())
        db.execute("UPDATE campaign SET checksum = ?", (checksum_of_campaign(row),))

    def row(self, db: sqlite3.Connection, table: str, number: int) -> None:
        """Write the checksum of a row that was written or changed."""
        values = dict(db.execute(f"SELECT * FROM {table} WHERE id = ?", (number,)).fetchone())
        db.execute(f"UPDATE {table} SET checksum = ? WHERE id = ?", (self._sum(db, table, values), number))

    def close(self, db: sqlite3.Connection, attempt: int, **values: Any) -> None:
        """Write the outcome of an attempt and its checksum in one statement.

        A closed attempt never changes again.
        """
        row = dict(db.execute("SELECT * FROM attempt WHERE id = ?", (attempt,)).fetchone()) | values
        values["checksum"] = self._sum(db, "attempt", row)
        assignments = ", ".join(f"{name} = ?" for name in values)
        db.execute(f"UPDATE attempt SET {assignments} WHERE id = ?", (*values.values(), attempt))

    def _sum(self, db: sqlite3.Connection, table: str, row: Mapping[str, Any]) -> str:
        if not self._campaign:
            self._campaign = db.execute("SELECT id FROM campaign").fetchone()[0]
        return checksum(self._campaign, table, row)


def disagreements(database: Database) -> Iterator[Disagreement]:
    """Find every row of a record that does not agree with its checksum.

    Raises
    ------
    StorageError
        Rows cannot even be read.
    """
    campaign = dict(database.query("SELECT * FROM campaign")[0])
    if not campaign_agrees(campaign):
        yield Disagreement("campaign", 1)
    for table in SEALED:
        last = 0
        while rows := database.query(
            f"SELECT * FROM {table} WHERE id > ? ORDER BY id LIMIT {_CHUNK}", (last,)
        ):
            names = rows[0].keys()
            for row in (
                dict(zip(names, each, strict=True)) for each in rows
            ):  # `dict` of a row looks names up
                if not agrees(campaign, table, row):
                    yield Disagreement(table, row["id"], row.get("kind", ""))
            last = rows[-1]["id"]


def check(database: Database) -> None:
    """Verify the database file and the checksum of every row.

    Raises
    ------
    DamagedRecord
        The file is damaged, or a row does not match its checksum; the message names the first one.
    """
    found = database.query("PRAGMA quick_check(1)")[0][0]
    if found != "ok":
        raise damaged(database.path, f"is damaged ({' '.join(found.split())})")
    wrong = list(disagreements(database))
    if wrong:
        more = f" and {len(wrong) - 1} other{'s' if len(wrong) > 2 else ''}" if len(wrong) > 1 else ""
        raise damaged(
            database.path, f"{wrong[0]}{more} no longer agree{'' if more else 's'} with the checksum"
        )

"""The store of the documents of many robots: an SQLite file or a PostgreSQL."""

from fleet.store.document import (
    KINDS,
    LONGEST,
    Added,
    Document,
    Entry,
    Kind,
    Known,
    Named,
    Point,
    RobotKey,
    Said,
    utc_now,
)
from fleet.store.engine import READER, WRITER, migrate
from fleet.store.rows import ERROR, dataset_content, dataset_texts
from fleet.store.standing import Baseline, Standing
from fleet.store.store import Store
from fleet.store.work import Job, Result, Work

__all__ = [
    "ERROR",
    "KINDS",
    "LONGEST",
    "READER",
    "WRITER",
    "Added",
    "Baseline",
    "Document",
    "Entry",
    "Job",
    "Kind",
    "Known",
    "Named",
    "Point",
    "Result",
    "RobotKey",
    "Said",
    "Standing",
    "Store",
    "Work",
    "dataset_content",
    "dataset_texts",
    "migrate",
    "utc_now",
]

"""The store of the documents of many robots: an SQLite file or a PostgreSQL."""

from fleet.store.document import (
    KINDS,
    LONGEST,
    AddResult,
    Document,
    DocumentSummary,
    Kind,
    NamedCause,
    RobotKey,
    RobotSummary,
    TrendPoint,
    VerdictRecord,
    utc_now,
)
from fleet.store.engine import READER, WRITER, migrate
from fleet.store.robot_state import BaselineRecord, RobotState
from fleet.store.rows import ERROR, dataset_content, dataset_texts
from fleet.store.store import FleetStore
from fleet.store.work import FleetJob, JobResult, Work

__all__ = [
    "ERROR",
    "KINDS",
    "LONGEST",
    "READER",
    "WRITER",
    "AddResult",
    "BaselineRecord",
    "Document",
    "DocumentSummary",
    "FleetJob",
    "FleetStore",
    "JobResult",
    "Kind",
    "NamedCause",
    "RobotKey",
    "RobotState",
    "RobotSummary",
    "TrendPoint",
    "VerdictRecord",
    "Work",
    "dataset_content",
    "dataset_texts",
    "migrate",
    "utc_now",
]

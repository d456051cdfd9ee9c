"""Diagnosis of many data sets by many workers, each result stored once (decision 0081)."""

from fleet.diagnose.batch import DatasetSource, DiagnosisOrder, EngineGone, in_files, in_store
from fleet.diagnose.call import diagnose_all, for_workers
from fleet.diagnose.changes import (
    VersionComparison,
    VersionDifference,
    VersionStatement,
    changes_between,
    named,
    release,
    this_program,
)
from fleet.diagnose.progress import ProgressCounts
from fleet.diagnose.statement import REFUSED

__all__ = [
    "REFUSED",
    "DatasetSource",
    "DiagnosisOrder",
    "EngineGone",
    "ProgressCounts",
    "VersionComparison",
    "VersionDifference",
    "VersionStatement",
    "changes_between",
    "diagnose_all",
    "for_workers",
    "in_files",
    "in_store",
    "named",
    "release",
    "this_program",
]

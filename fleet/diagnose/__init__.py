"""Many data sets diagnosed by many workers, every result once, in the store (docs/decisions/0081)."""

from fleet.diagnose.batch import REFUSED, EngineGone, Order, Source, in_files, in_store
from fleet.diagnose.call import diagnose_all, for_workers
from fleet.diagnose.changes import Change, Changes, Side, changes_between, named, release, this_program
from fleet.diagnose.run import Tally

__all__ = [
    "REFUSED",
    "Change",
    "Changes",
    "EngineGone",
    "Order",
    "Side",
    "Source",
    "Tally",
    "changes_between",
    "diagnose_all",
    "for_workers",
    "in_files",
    "in_store",
    "named",
    "release",
    "this_program",
]

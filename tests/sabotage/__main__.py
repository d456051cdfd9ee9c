"""`python -m tests.sabotage [--list] [--only WORD] [--jobs 2]`: break the program on purpose, so that a test fails.

Each change of the list is made in a temporary copy of the checkout, and the tests that should notice it are run there.
Exit code 1 when one survives that is not explained, when one cannot be made any more, or when tests could not run.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ThreadPoolExecutor
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tests.sabotage import (
    acquisition,
    arms,
    calib,
    drivers,
    elsewhere,
    fit,
    fleet,
    motion,
    outbox,
    priors,
    races,
    service,
    store,
    upkeep,
    watch,
)
from tests.sabotage.change import Change
from tests.sabotage.trial import Copies, Verdict

CHANGES: tuple[Change, ...] = (
    *drivers.CHANGES,
    *acquisition.CHANGES,
    *service.CHANGES,
    *calib.CHANGES,
    *fit.CHANGES,
    *motion.CHANGES,
    *watch.CHANGES,
    *store.CHANGES,
    *priors.CHANGES,
    *outbox.CHANGES,
    *arms.CHANGES,
    *fleet.CHANGES,
    *upkeep.CHANGES,
    *races.CHANGES,
    *elsewhere.CHANGES,
)


def table(verdicts: list[Verdict]) -> Table:
    """One row a change: what became of it, after how long, and what noticed."""
    shown = Table("change", "", "s", "noticed by", box=None, pad_edge=False)
    for each in verdicts:
        outcome = each.outcome if each.good or not each.change.survives else f"{each.outcome}, explained"
        shown.add_row(escape(each.change.title), outcome, f"{each.seconds:.0f}", escape(each.by))
    return shown


def main() -> int:
    """Run what was chosen, print the table; 0 when every change was noticed or is explained."""
    parser = argparse.ArgumentParser(prog="python -m tests.sabotage", description=__doc__)
    parser.add_argument("--list", action="store_true", help="only list the changes")
    parser.add_argument("--only", default="", metavar="WORD", help="those whose title holds this word")
    parser.add_argument("--jobs", type=int, default=2, help="changes at a time (%(default)s)")
    options = parser.parse_args()
    chosen = [each for each in CHANGES if options.only.lower() in each.title.lower()]
    if options.list:
        for each in chosen:
            sys.stdout.write(f"{each.title}{f' (survives: {each.survives})' if each.survives else ''}\n")
        return 0
    if not chosen:
        parser.error(f"no change holds the word {options.only!r}")
    with TemporaryDirectory(prefix="truepose-sabotage-") as folder, ThreadPoolExecutor(options.jobs) as pool:
        copies = Copies(folder, options.jobs)
        verdicts = []
        for verdict in pool.map(copies.trial, chosen):
            verdicts.append(verdict)
            sys.stderr.write(f"{verdict.outcome:9s}{verdict.seconds:5.0f} s  {verdict.change.title}\n")
    Console(width=200).print(table(verdicts))
    killed = sum(each.good for each in verdicts)
    sys.stdout.write(f"{killed} of {len(verdicts)} changes noticed\n")
    return 0 if all(each.good or (each.survived and each.change.survives) for each in verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())

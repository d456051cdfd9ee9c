"""Against the packages that do part of the same: robotkinecal, figaroh, pybotics. Needs the network once, to install.

The first run installs them under `.bench/`; one that cannot be installed counts as missed, and the others run.
"""

from __future__ import annotations

from tests.benchmarks.peers import identification, selection


def run() -> bool:
    """Print every row; return whether all limits are met."""
    reached = identification.run()
    return selection.run() and reached

"""Arms, laws and campaigns of somebody else: nothing of their physics is shared with the program or the simulators."""

from tests.benchmarks.strangers.bench import run

__all__ = ["run"]

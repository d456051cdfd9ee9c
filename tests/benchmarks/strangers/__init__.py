"""Independent arms, laws and campaigns.

Their physics shares nothing with the program or the simulators.
"""

from tests.benchmarks.strangers.bench import run

__all__ = ["run"]

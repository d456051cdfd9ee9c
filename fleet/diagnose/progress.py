"""The progress of a call, and its cost."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class ProgressCounts:
    """The progress of a call, in numbers of data sets.

    Attributes
    ----------
    known
        Had a result before the call.
    done
        Done by this call, including refused ones.
    found
        Had a result when a worker came to them, from a worker that was lost since or from another call.
    twice
        Were computed, but another result came first.
    failed
        Without a result, with the reason.
    seconds
        Processor time of the diagnoses, s.
    overhead_s
        Processor time of the command, and of a scheduler of this call, while data sets are distributed, s.
    start_s
        Processor time of the command before and after that, s.
    elapsed
        Time since the workers were available, s.
    """

    total: int
    known: int = 0
    done: int = 0
    refused: int = 0
    found: int = 0
    twice: int = 0
    batches: int = 0
    workers: int = 0
    lost: int = 0
    seconds: float = 0.0
    overhead_s: float = 0.0
    start_s: float = 0.0
    elapsed: float = 0.0
    failed: dict[str, str] = field(default_factory=dict)

    @property
    def left(self) -> int:
        """Number of remaining data sets."""
        return self.total - self.known - self.done - self.found - self.twice - len(self.failed)

    @property
    def seconds_each(self) -> float | None:
        """Processor seconds per data set; None before the first."""
        return self.seconds / self.done if self.done else None

    @property
    def seconds_left(self) -> float | None:
        """Remaining seconds at the pace so far; None before the first data set."""
        return self.elapsed / self.done * self.left if self.done else None

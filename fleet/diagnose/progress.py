"""The progress of a call, and its cost."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class ProgressCounts:
    """The progress of a call, in data sets.

    known: had a result before; done: by this call, refused among them; found: had a result when a worker came to them,
    from a worker that was lost since or from another call; twice: computed, though another result came first; failed:
    without a result, with the reason. seconds: processor time of the diagnoses; overhead_s: of the command, and of the
    scheduler where it is its own, while they are dealt out; start_s: of the command before and after that; elapsed:
    since the workers were there.
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
        """Data sets still to come."""
        return self.total - self.known - self.done - self.found - self.twice - len(self.failed)

    @property
    def seconds_each(self) -> float | None:
        """Processor seconds of one data set; None before the first."""
        return self.seconds / self.done if self.done else None

    @property
    def seconds_left(self) -> float | None:
        """Seconds to come, at the pace so far; None before the first data set."""
        return self.elapsed / self.done * self.left if self.done else None

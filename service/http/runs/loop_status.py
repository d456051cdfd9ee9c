"""The status of a closed loop, as `loop.json` and the interface have it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from acquisition import State


@dataclass(frozen=True)
class LoopStatus:
    """One moment of a loop; a change makes another one, with the next `version`.

    steps: what it has done, the last in hand; runs: of which `run_id` is in hand; problem: what it failed or rests for.
    """

    id: str
    name: str
    created_utc: str
    simulated: bool
    state: State
    dry_run: bool = False
    version: int = 1
    reason: str = ""
    step: str = ""
    steps: tuple[str, ...] = ()
    run_id: str | None = None
    runs: tuple[str, ...] = ()
    dataset_id: str | None = None
    problem: dict[str, Any] | None = None

    def as_dict(self) -> dict[str, Any]:
        """The status as plain values, for JSON."""
        shown = asdict(self) | {"steps": list(self.steps), "runs": list(self.runs)}
        return shown | {"state": self.state.value, "state_code": self.state.code}

"""Changes to code whose order matters: checks left out or moved, locks and wake-ups removed.

The simulation must notice each of them.
"""

from __future__ import annotations

from tests.sabotage.change import Change

_SIMULATION = ("tests/test_simulation.py",)
_CONTROL, _LEASE = "acquisition/run/orders/control.py", "acquisition/run/orders/lease.py"
_DESK, _RUN = "acquisition/run/prompts/prompt_queue.py", "acquisition/run/run.py"
_BOOK, _KEYS = "service/http/runs/run_manager.py", "service/http/work/idempotency.py"


def _race(file: str, old: str, new: str, breaks: str) -> Change:
    return Change(file, old, new, breaks, _SIMULATION)


CHANGES = (
    _race(
        _CONTROL,
        "            self._reason = reason\n        self._any.set()\n        self._notify()\n\n    def rest",
        "            self._reason = reason\n        self._notify()\n\n    def rest",
        "a pause is not noted",
    ),
    _race(
        _CONTROL,
        "        self._now.set()\n        self._any.set()\n        self._notify()\n\n    def stop",
        "        self._notify()\n\n    def stop",
        "a lease that ends lets the robot move on",
    ),
    _race(
        _CONTROL,
        "            watcher()",
        "            pass",
        "whoever waits for an answer does not hear of a stop",
    ),
    _race(
        _LEASE,
        "                if left_s <= 0.0:\n                    lapsed()\n                    return",
        "                if left_s <= 0.0:\n                    return",
        "a lease that ends within a run is not noticed",
    ),
    _race(
        _LEASE,
        "        for heard in tuple(self._heard):\n            heard.set()\n",
        "",
        "a lease that is shortened is watched by its old end",
    ),
    _race(
        _DESK,
        "pending is None or pending.id != prompt_id or self._answer is not None",
        "pending is None or self._answer is not None",
        "a late answer is taken for that to the next prompt",
    ),
    _race(
        _RUN,
        "            return execution.rig.halt()\n        try:",
        "            return []\n        try:",
        "a stop halts no robot",
    ),
    _race(
        _RUN,
        "            self._store.recover()\n",
        "",
        "what was under way when the program ended stays open",
    ),
    _race(
        _BOOK,
        "            with self._mutex:\n                self.refuse_busy()\n                self._runs[run_id] = run",
        "            with self._mutex:\n                self._runs[run_id] = run",
        "two runs are started at once",
    ),
    _race(
        _KEYS,
        "            mine = entry is None\n",
        "            mine = True\n",
        "a repeated request is done again",
    ),
)

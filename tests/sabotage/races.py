"""Changes to code whose order matters: checks left out or moved, locks and wake-ups removed.

The simulation must notice each of them.
"""

from __future__ import annotations

from tests.sabotage.change import Change

_SIMULATION = ("tests/simulation/test_simulation.py",)
_CONTROL, _LEASE = "acquisition/run/orders/control.py", "acquisition/run/orders/lease.py"
_DESK, _RUN, _RIG = (
    "acquisition/run/prompts/prompt_queue.py",
    "acquisition/run/run.py",
    "acquisition/run/rig/rig.py",
)
_BOOK, _KEYS, _BASE = (
    "service/http/runs/run_manager.py",
    "service/http/work/idempotency.py",
    "acquisition/record/database.py",
)


def _race(file: str, old: str, new: str, breaks: str) -> Change:
    return Change(file, old, new, breaks, _SIMULATION)


CHANGES = (
    _race(
        _CONTROL,
        "        if self._stop.is_set():\n            raise Stopping\n        if self._now",
        "        if self._now",
        "a stop is not looked at before an act",
    ),
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
        "        if self.left_s <= 0.0:\n            lapsed()\n            yield",
        "        if self.left_s <= 0.0:\n            yield",
        "a run begins under a lease that has ended",
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
        "pending is None or pending.id != prompt_id",
        "the second of two answers counts",
    ),
    _race(
        _DESK,
        "pending is None or pending.id != prompt_id or self._answer is not None",
        "pending is None or self._answer is not None",
        "a late answer is taken for that to the next prompt",
    ),
    _race(
        _DESK,
        "            answer, failure, self._pending = self._answer, self._failure, None",
        "            answer, failure = self._answer, self._failure",
        "a prompt that is over can be answered",
    ),
    _race(
        _RUN,
        "                execution.noting.begin(by, key)\n            self._resumed = False\n",
        "                execution.noting.begin(by, key)\n",
        "a stop that meets a resume is lost",
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
        _RIG,
        "            # A stop between the look before and the arming must not be undone by it.\n"
        "            self._control.check_stop()\n",
        "",
        "a stop is undone by the arming that it meets",
    ),
    _race(
        _RIG,
        "            self._halting.wait_for(lambda: not self._halts)\n",
        "",
        "the connections end under a stop",
    ),
    _race(
        "drivers/abb/arm.py",
        "                    if self._stopped.is_set():\n"
        '                        raise MotionStopped("stopped before it began", device=self.name, command="move_to")\n',
        "",
        "a stop before the order to go is lost",
    ),
    _race(
        "drivers/abb/conversation.py",
        'if echo != (b"%d" % number,) or not errno.isdigit():',
        "if not errno.isdigit():",
        "an answer to an earlier question is taken",
    ),
    _race(
        "drivers/link.py",
        "        except BaseException:\n            self.close()\n            raise\n\n    def send",
        "        except BaseException:\n            raise\n\n    def send",
        "a connection is used on after a fault",
    ),
    _race(
        "drivers/bridge/mbp.py",
        "                elif message.number != asked:\n                    self.strangers += 1\n",
        "",
        "a late answer of a bridge is taken",
    ),
    _race(
        _BOOK,
        "            with self._mutex:\n                self.refuse_busy()\n                self._runs[run_id] = run",
        "            with self._mutex:\n                self._runs[run_id] = run",
        "two runs are started at once",
    ),
    _race(
        _BOOK,
        "        with self._mutex:\n            self.refuse_busy()\n            status = run.status()",
        "        with self._mutex:\n            status = run.status()",
        "two runs are resumed at once",
    ),
    _race(
        _BOOK,
        "            execution.begun.wait(FINISH_S)  # a run that has not begun",
        "            pass  # a run that has not begun",
        "a pause before the run has begun is lost",
    ),
    _race(
        _BOOK,
        "            if name in (self.busy_with, *in_hand):\n                raise errors.in_use()\n",
        "",
        "a run is deleted while it measures",
    ),
    _race(
        _BOOK,
        "            self.pause(name, by, SERVICE_ENDS)\n            if not self.join(PAUSE_S)",
        "            if not self.join(PAUSE_S)",
        "a service ends without a word to its run",
    ),
    _race(
        "service/http/state.py",
        "        if now is None or now.beats is not held.beats:",
        "        if False:",
        "a lease that is lost while a run begins is not noticed",
    ),
    _race(
        _KEYS,
        "            mine = entry is None\n",
        "            mine = True\n",
        "a repeated request is done again",
    ),
    _race(_KEYS, "        entry.done.wait()\n", "", "a request is repeated while it is being done"),
    _race(
        _BASE,
        "        with self._lock:\n            within = self._within is not None",
        "        if True:\n            within = self._within is not None",
        "two threads write one transaction",
    ),
    _race(
        "acquisition/run/orders/robot_lock.py",
        '                self._hold(locked, endpoint, f"at {self._url}")',
        "                pass",
        "two programs move one robot",
    ),
    _race(
        "acquisition/run/sequencer.py",
        "        arrival, self._arrival = self._arrival, None  # only what ends well below leaves the approach valid",
        "        arrival = self._arrival",
        "an approach counts after a fault",
    ),
)

"""Play histories of a cell and its service from seeds.

With `python -m tests.simulation --seed N --campaigns K`, the histories of seeds N, N + 1, ... are played until K
campaigns have ended. One in which something happened that must never happen is shortened to the fewest steps that still
show it, and printed with the command that plays it again. Add `--log` to print every event of it.
`python -m pdb -m tests.simulation ...` plays it under a debugger.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import hashlib
import io
import os
import sys
import time
from collections.abc import Sequence

from tests.simulation.histories import History, Step, learn, steps_of

MOST_TRIES = 150  # to shorten a history


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def play(seed: int, steps: Sequence[Step]) -> History:
    """Play a history, without what the programs in it print."""
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        return History(seed, steps).run()


def shortest(seed: int, steps: Sequence[Step]) -> History:
    """Return the failing history with the fewest of these steps, as delta debugging finds them."""
    kept, failing, tries = list(steps), play(seed, steps), 0
    size = max(len(kept) // 2, 1)
    while kept and tries < MOST_TRIES:
        for begin in range(0, len(kept), size):
            tries += 1
            fewer = kept[:begin] + kept[begin + size :]
            if (tried := play(seed, fewer)).found:
                kept, failing = fewer, tried
                break
        else:
            if size == 1:
                break
            size = (size + 1) // 2
    return failing


def describe(history: History, *, log: bool) -> str:
    """Return what happened in a history, and how to play it again."""
    numbers = {step: number for number, step in enumerate(steps_of(history.seed))}
    only = ",".join(str(numbers[step]) for step in history.steps)
    lines = [
        f"seed {history.seed}: {len(history.found)} faults",
        *(f"    {text}" for text in history.found),
        "  steps:",
        *(f"    {step}" for step in history.steps),
        f'  again: python -m tests.simulation --seed {history.seed} --only "{only}" --log',
    ]
    return "\n".join([*lines, *(history.log if log else [])])


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.simulation", description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="the first seed")
    parser.add_argument("--campaigns", type=int, default=1, help="number of campaigns that must end")
    parser.add_argument(
        "--minutes", type=float, default=0.0, help="play for this time, however many campaigns"
    )
    parser.add_argument("--only", help="numbers of the steps of the seed that are played, such as 0,1,5")
    parser.add_argument("--log", action="store_true", help="print everything that happened")
    parser.add_argument(
        "--first", action="store_true", help="end with the first seed that fails, not shortened"
    )
    asked = parser.parse_args()
    with contextlib.redirect_stderr(io.StringIO()):
        calm = learn()
    gc.freeze()  # half a million objects that stay need not be looked through again and again
    gc.set_threshold(50_000, 20, 20)
    for each in calm:
        if each.found:
            say(describe(each, log=asked.log))
            return 1
    if asked.only is not None:
        steps = steps_of(asked.seed)
        history = play(asked.seed, [steps[int(each)] for each in asked.only.split(",") if each])
        say(describe(history, log=asked.log))
        return 1 if history.found else 0
    began, cpu = time.perf_counter(), time.process_time()
    seed, campaigns, failed, digest = asked.seed, 0, [], hashlib.sha256()
    while campaigns < asked.campaigns or time.perf_counter() - began < 60.0 * asked.minutes:
        history = play(seed, steps_of(seed))
        campaigns += history.campaigns
        digest.update("\n".join(history.log).encode())
        if history.found:
            failed.append(seed)
            if asked.first:
                say(describe(history, log=asked.log))
                break
            say(describe(shortest(seed, history.steps), log=asked.log))
        elif asked.log:
            say(describe(history, log=True))
        seed += 1
    wall, used = time.perf_counter() - began, time.process_time() - cpu
    say(
        f"{campaigns} campaigns in {seed - asked.seed} histories, {len(failed)} of them with faults; {wall:.1f} s, "
        f"{campaigns / max(used, 1e-9):.1f} campaigns per second of one core; log {digest.hexdigest()[:16]}"
    )
    return 1 if failed else 0


if __name__ == "__main__":
    code = main()
    os._exit(code)  # the tasks that were killed are never cleaned up

"""A process that computes for the service: `python -m service.worker`.

It reads calls from its standard input, pickled `(function, arguments)`, one after another, and writes the outcome of
each to its standard output, pickled `(result, refusal)`. The service holds the other end of both. If the service ends
or is killed, the input closes, and the process ends at once, even in the middle of a computation. A signal handler of
the service could not ensure this: nothing runs after `kill -9`.
"""

from __future__ import annotations

import os
import pickle
import queue
import threading
import traceback
from collections.abc import Callable
from typing import Any, BinaryIO

from service.refusals import REFUSALS, of_disk

Call = tuple[Callable[..., Any], tuple[Any, ...]]

PATIENT = 10
"""By how much a worker yields to the service, which has to hear a stop; Windows knows no such thing."""


def main() -> None:
    """Serve calls until the input closes.

    An unexpected error ends the process, with a traceback on standard error.
    """
    if os.name == "posix":
        os.nice(PATIENT)  # within the session, which is the service's: see docs/decisions/0033
    calls: queue.SimpleQueue[Call] = queue.SimpleQueue()
    answers = os.fdopen(os.dup(1), "wb")
    requests = os.fdopen(os.dup(0), "rb")
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1):  # a function that prints or reads must not disturb this protocol
        os.dup2(nothing, number)
    threading.Thread(target=_listen, args=(requests, calls), daemon=True).start()
    while True:
        function, arguments = calls.get()
        try:
            outcome = function(*arguments), None
        except REFUSALS as refusal:
            outcome = None, refusal
        except OSError as error:  # a full disk, a folder that may not be written
            traceback.print_exc()
            outcome = None, of_disk(error)
        answers.write(pickle.dumps(outcome))  # whole, or not at all
        answers.flush()


def _listen(requests: BinaryIO, calls: queue.SimpleQueue[Call]) -> None:
    """Read calls in a thread, so that the end of the service is noticed during a computation."""
    try:
        while True:
            calls.put(pickle.load(requests))
    except (EOFError, pickle.UnpicklingError):  # closed, perhaps in the middle of a call
        os._exit(0)


if __name__ == "__main__":
    main()

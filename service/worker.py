"""A process that computes for the service: `python -m service.worker`.

It reads calls from its standard input, pickled `(function, arguments)`, one after another, and writes what came of
each to its standard output, pickled `(result, refusal)`. The service holds the other end of both. When the input
closes, because the service ended or was killed, the process ends at once, in mid-computation if need be: no signal
handler of the service could see to that, nothing runs after `kill -9`.
"""

from __future__ import annotations

import os
import pickle
import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

from service.refusals import REFUSALS

Call = tuple[Callable[..., Any], tuple[Any, ...]]

PATIENT = 10
"""By how much a worker yields to the service, which has to hear a stop; Windows knows no such thing."""

SESSION = "/proc/{}/autogroup"
"""Where Linux keeps the priority of a process's session: "/autogroup-5737 nice 0"."""


def main() -> None:
    """Serve until the input closes. A fault of this program ends the process, with its traceback on standard error."""
    if os.name == "posix":
        _lower_priority()
    calls: queue.SimpleQueue[Call] = queue.SimpleQueue()
    answers = os.fdopen(os.dup(1), "wb")
    requests = os.fdopen(os.dup(0), "rb")
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1):  # whatever a function prints or reads, it is not the conversation
        os.dup2(nothing, number)
    threading.Thread(target=_listen, args=(requests, calls), daemon=True).start()
    while True:
        function, arguments = calls.get()
        try:
            outcome = function(*arguments), None
        except REFUSALS as refusal:
            outcome = None, refusal
        answers.write(pickle.dumps(outcome))  # whole, or not at all
        answers.flush()


def _lower_priority() -> None:
    """Let the service go first, in this worker's session as well as before others.

    Where Linux shares the processors out between sessions, a process is nice to its own session alone, and a worker is
    in one by itself. Its session has a file of its own for that, which takes one order in a tenth of a second from all
    programs together. Below the service's own session: that may have a low priority itself.
    """
    os.nice(PATIENT)
    try:
        of_service = int(Path(SESSION.format(os.getppid())).read_text(encoding="ascii").split()[-1])
    except OSError:  # sessions share nothing out here
        return
    own = Path(SESSION.format("self"))
    for _ in range(10):
        try:
            own.write_text(str(min(of_service + PATIENT, 19)), encoding="ascii")
        except BlockingIOError:
            time.sleep(0.1)
        except OSError:  # refused: somebody else's rule
            return
        else:
            return


def _listen(requests: BinaryIO, calls: queue.SimpleQueue[Call]) -> None:
    """The thread that reads calls: the end of the service is noticed while a function computes."""
    try:
        while True:
            calls.put(pickle.load(requests))
    except (EOFError, pickle.UnpicklingError):  # closed, perhaps in mid-call
        os._exit(0)


if __name__ == "__main__":
    main()

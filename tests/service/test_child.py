"""Wait for a child process while signals are handled.

`truepose mock` and the guard of the simulators do this. These tests would catch a plain `wait()`: Python runs a handler
only once the call is interrupted, and a signal that comes as it begins interrupts nothing. Nor does one that another
thread receives, and a test can produce that at any time.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import threading

import pytest

from service import child
from tests.drivers.waiting import in_thread

TELLS_ITS_PARENT = (
    "import os, signal; os.kill(os.getppid(), signal.SIGTERM); signal.alarm(60); signal.pause()"
)


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="a system without masks of signals")
def test_a_signal_that_interrupts_nothing_is_heard() -> None:
    heard: list[int] = []

    def hear(process: subprocess.Popen[bytes], number: int) -> None:
        heard.append(number)
        process.kill()

    end, before = threading.Event(), signal.getsignal(signal.SIGTERM)
    other = in_thread(end.wait)  # is given what this one blocks
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    try:
        assert child.run([sys.executable, "-c", TELLS_ITS_PARENT], hear) == -signal.SIGKILL
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        end.set()
        other.result()
    assert heard == [signal.SIGTERM]
    assert signal.getsignal(signal.SIGTERM) is before


def test_the_exit_code_is_that_of_the_child() -> None:
    assert child.run([sys.executable, "-c", "raise SystemExit(3)"], lambda *_: None) == 3

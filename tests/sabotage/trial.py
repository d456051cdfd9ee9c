"""One change made in a copy of the checkout, and what its tests said."""

from __future__ import annotations

import os
import queue
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile

from tests.sabotage.change import ROOT, Change

HUNG_S = 60  # for one test; a change that makes one hang is noticed
TRIAL_S = 600.0  # for all tests of a change, some hundred of them on a busy machine
_NOTICED = re.compile(r"^(?:FAILED|ERROR) (\S+)", re.MULTILINE)
_HUNG = re.compile(r"^\+* Timeout \+*$", re.MULTILINE)
_RUNNING = re.compile(r'File "\S*/tests/\S+", line \d+, in (test_\w+)')
_SOME_FAILED, _NO_FAULT = 1, 0


@dataclass(frozen=True)
class Verdict:
    """Result of a trial.

    `outcome` is killed, survived, stale or broken (the tests could not run). `by` is the test that noticed, or the
    reason.
    """

    change: Change
    outcome: str
    seconds: float
    by: str = ""

    @property
    def good(self) -> bool:
        return self.outcome == "killed"

    @property
    def survived(self) -> bool:
        return self.outcome == "survived"


class Copies:
    """Copies of the checkout, one for each trial at a time. What git does not know is not copied."""

    def __init__(self, folder: str, count: int) -> None:
        self._free: queue.SimpleQueue[Path] = queue.SimpleQueue()
        listed = subprocess.run(
            ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        )
        names = [name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]
        for number in range(count):
            copy = Path(folder) / f"copy{number}"
            for name in names:
                (copy / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ROOT / name, copy / name)
            self._free.put(copy)

    def trial(self, change: Change) -> Verdict:
        """Make the change in a copy, run its tests there, take it back."""
        copy = self._free.get()
        try:
            if why := change.stale(copy):
                return Verdict(change, "stale", 0.0, why)
            sound = (copy / change.file).read_bytes()
            change.apply(copy)
            try:
                return _tried(change, copy)
            finally:
                (copy / change.file).write_bytes(sound)
        finally:
            self._free.put(copy)


def _tried(change: Change, copy: Path) -> Verdict:
    # The environment has the checkout installed: the copy has to come before it, in programs that tests start as well.
    environment = os.environ | {
        "PYTHONPATH": str(copy),
        "PYTHONDONTWRITEBYTECODE": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", f"--timeout={HUNG_S}"]
    began = time.monotonic()
    code, said = _run([*command, "--timeout-method=thread", *change.tests], copy, environment)
    seconds = time.monotonic() - began
    noticed = _NOTICED.search(said)
    if code == _NO_FAULT:
        return Verdict(change, "survived", seconds)
    if code == _SOME_FAILED and noticed is not None:
        return Verdict(change, "killed", seconds, noticed[1])
    if code is None:
        return Verdict(change, "killed", seconds, f"tests that took longer than {TRIAL_S:g} s")
    if hung := _HUNG.search(said):
        test = _RUNNING.search(said, hung.end())
        return Verdict(change, "killed", seconds, f"a test that hung: {test[1] if test else 'unknown'}")
    return Verdict(change, "broken", seconds, said[-300:])


def _run(command: list[str], folder: Path, environment: dict[str, str]) -> tuple[int | None, str]:
    """Return the exit code and the whole output; the code is None if the time was over.

    The output is written to a file and not to a pipe: a simulator that a hung test leaves behind would keep the
    pipe open. Any process left behind is ended.
    """
    with TemporaryFile() as output:
        process = subprocess.Popen(
            command, cwd=folder, env=environment, stdout=output, stderr=output, start_new_session=True
        )
        try:
            code = process.wait(TRIAL_S)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        output.seek(0)
        return code, output.read().decode(errors="replace")

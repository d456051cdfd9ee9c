"""Benchmark of start-up: processor time of `truepose --help` and of `truepose serve`.

The time of `serve` ends when it is ready.

The shortest of some tries counts, since other load of the machine lengthens processor time, too.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

from tests.benchmarks.clock import line

TRIES = 5
HELP_S, READY_S = 0.5, 2.0
TRUEPOSE = [sys.executable, "-m", "service.cli"]


def run() -> bool:
    """Print both; True where both are soon enough."""
    helped = min(_spent(["--help"], until_ready=False) for _ in range(TRIES))
    line("truepose --help, processor time", f"{helped:.2f} s", f"< {HELP_S:g} s", helped < HELP_S)
    ready = min(_spent(["serve", "--json"], until_ready=True) for _ in range(TRIES))
    line("truepose serve ready, processor time", f"{ready:.2f} s", f"< {READY_S:g} s", ready < READY_S)
    return helped < HELP_S and ready < READY_S


def _spent(words: list[str], *, until_ready: bool) -> float:
    """Seconds of processor time until the process has printed its first line, or has ended."""
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen(
            [*TRUEPOSE, *words], stdout=subprocess.PIPE, cwd=folder, env=_environment()
        )
        assert process.stdout is not None
        try:
            process.stdout.read(1 if until_ready else -1)
            if until_ready:
                process.kill()
        finally:
            process.stdout.close()
            _, _, used = os.wait4(process.pid, 0)
            process.returncode = 0  # it has been waited for
    return used.ru_utime + used.ru_stime


def _environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}

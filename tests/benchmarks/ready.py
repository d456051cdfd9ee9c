"""Benchmark of start-up: processor time of `import truepose`, `truepose --help` and `serve`.

The time of `serve` ends when it is ready; that of the import is compared with numpy's, beyond an empty program.

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
IMPORT_RATIO = 0.3
TRUEPOSE = ["-m", "service.cli"]


def run() -> bool:
    """Print them; True where all are soon enough."""
    nothing, ours, numpys = (
        min(_spent(["-c", code], until_ready=False) for _ in range(TRIES))
        for code in ("", "import truepose", "import numpy")
    )
    ratio = (ours - nothing) / (numpys - nothing)
    line("import truepose / import numpy", f"{ratio:.2f}", f"< {IMPORT_RATIO:g}", ratio < IMPORT_RATIO)
    helped = min(_spent([*TRUEPOSE, "--help"], until_ready=False) for _ in range(TRIES))
    line("truepose --help, processor time", f"{helped:.2f} s", f"< {HELP_S:g} s", helped < HELP_S)
    ready = min(_spent([*TRUEPOSE, "serve", "--json"], until_ready=True) for _ in range(TRIES))
    line("truepose serve ready, processor time", f"{ready:.2f} s", f"< {READY_S:g} s", ready < READY_S)
    return helped < HELP_S and ready < READY_S and ratio < IMPORT_RATIO


def _spent(words: list[str], *, until_ready: bool) -> float:
    """Seconds of processor time until the process has printed its first line, or has ended."""
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen(
            [sys.executable, *words], stdout=subprocess.PIPE, cwd=folder, env=_environment()
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

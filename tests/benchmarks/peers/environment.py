"""Separate environments under `.bench/` for the packages, whose requirements conflict.

They are installed once by pip from the index for which it is configured; the versions are pinned.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[3]
RUNNERS = Path(__file__).parent / "runners"
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
INSTALL_S, RUN_S = 1800.0, 3600.0


class Absent(Exception):
    """A package could not be installed, or its runner failed."""


@dataclass(frozen=True)
class Peer:
    """A package and how much faster than it we have to be."""

    name: str
    requirements: tuple[str, ...]
    wanted: float

    @property
    def folder(self) -> Path:
        """Folder of the environment of this package."""
        return ROOT / ".bench" / self.name

    def install(self) -> Path:
        """Install the package and return its interpreter.

        Raises
        ------
        Absent
            The package could not be installed; the message gives the reason.
        """
        python, stamp = self.folder / "bin" / "python", self.folder / ".installed"
        wanted = "\n".join(self.requirements)
        if stamp.is_file() and stamp.read_text(encoding="utf-8") == wanted:
            return python
        print(f"installing {' '.join(self.requirements)} into {self.folder}", flush=True)
        _call([sys.executable, "-m", "venv", "--clear", str(self.folder)], INSTALL_S)
        install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", *self.requirements]
        _call([str(python), *install], INSTALL_S)
        stamp.write_text(wanted, encoding="utf-8")
        return python

    def answer(self, runner: str, cases: Sequence[Path], answer: Path) -> dict[str, Any]:
        """Run a runner on some cases and return the content of its answer file.

        Raises
        ------
        Absent
            The package could not be installed, or its runner failed; the message gives the reason.
        """
        python = self.install()
        _call([str(python), str(RUNNERS / runner), str(answer), *map(str, cases)], RUN_S)
        return json.loads(answer.read_text(encoding="utf-8"))


PEERS = (
    Peer("robotkinecal", ("robotkinecal==0.1.0",), 30.0),
    Peer("figaroh", ("figaroh==1.0.2", "pin==4.1.0"), 30.0),
    Peer("pybotics", ("pybotics==3.1.2",), 200.0),
)


def _call(command: list[str], seconds: float) -> None:
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=seconds, env=os.environ | ONE_THREAD
        )
    except subprocess.TimeoutExpired as error:
        raise Absent(f"took more than {seconds:.0f} s") from error
    if done.returncode != 0:
        said = [line for line in (done.stderr or done.stdout).splitlines() if line.strip()]
        raise Absent(said[-1] if said else f"ended with code {done.returncode}")

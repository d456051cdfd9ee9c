"""Schedulers and workers of a plant as separate programs.

They have certificates as in docs/howto/fleet.md.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.drivers.waiting import PATIENCE_S, until

ROOT = Path(__file__).parents[3]


def settings(files: dict[str, Path]) -> dict[str, str]:
    """Dask's settings of the command, as environment variables are read."""
    tls = "distributed.comm.tls"
    return {
        f"{tls}.ca-file": str(files["ca"]),
        f"{tls}.client.cert": str(files["cert"]),
        f"{tls}.client.key": str(files["key"]),
    }


@contextmanager
def process(*words: str, environment: dict[str, str] | None = None) -> Iterator[subprocess.Popen[str]]:
    """A program of Python, killed at the end of the block."""
    with subprocess.Popen(
        [sys.executable, "-m", *words],
        cwd=ROOT,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", **(environment or {})},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as running:
        try:
            yield running
        finally:
            running.kill()


def as_in_the_manual(what: str, files: dict[str, Path], *words: str) -> list[str]:
    """`dask scheduler` or `dask worker` with the options of docs/howto/fleet.md."""
    tls = [f"--tls-ca-file={files['ca']}", f"--tls-cert={files['cert']}", f"--tls-key={files['key']}"]
    return ["dask", what, *words, "--host", "127.0.0.1", "--no-dashboard", *tls]


def address_in(file: Path, patience_s: float = PATIENCE_S) -> str:
    """Return the address in a scheduler's file (`--scheduler-file`), as soon as it is complete."""
    until(lambda: _identity(file), patience_s)
    return str(_identity(file)["address"])


def _identity(file: Path) -> dict[str, Any]:
    """Empty as long as the file is not there, or not yet whole."""
    try:
        return json.loads(file.read_text("utf-8"))
    except (FileNotFoundError, json.JSONDecodeError):
        return {}

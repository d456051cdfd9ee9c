"""Schedulers and workers of a plant as programs of their own, with certificates as docs/fleet-engine.md has them."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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
    """`dask scheduler` or `dask worker` with the options of docs/fleet-engine.md."""
    tls = [f"--tls-ca-file={files['ca']}", f"--tls-cert={files['cert']}", f"--tls-key={files['key']}"]
    return ["dask", what, *words, "--host", "127.0.0.1", "--no-dashboard", *tls]

"""Windows tests that run elsewhere: imports without POSIX modules, stated file encodings.

No Windows machine has run the program yet.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
IMPORT_ALL = """
import asyncio, importlib, os, pkgutil, sys, warnings
import distributed, fastapi, matplotlib.figure, numpy, pandas, pymodbus.client, rich, scipy, serial, typer, uvicorn

for name in ("fcntl", "grp", "pty", "pwd", "resource", "syslog", "termios", "tty"):
    sys.modules[name] = None
for name in ("chown", "fchmod", "fork", "forkpty", "getpgid", "getuid", "killpg", "nice", "openpty", "setsid"):
    delattr(os, name)
warnings.simplefilter("ignore")  # of the file lock, which has another implementation there
seen = 0
for package in ("acquisition", "calib", "drivers", "fleet", "mocks", "service", "truepose"):
    for found in pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}."):
        if not found.name.endswith(("__main__", ".serial_line", ".migrations.env")):
            importlib.import_module(found.name)
            seen += 1
print(seen)
"""


def test_every_module_is_imported_without_posix() -> None:
    done = subprocess.run(
        [sys.executable, "-c", IMPORT_ALL], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 300


def test_files_are_read_and_written_in_a_stated_encoding(tmp_path: Path) -> None:
    """A Windows code page would read UTF-8 wrongly if no encoding is stated."""
    command = [
        sys.executable,
        "-X",
        "warn_default_encoding",
        "-W",
        "always::EncodingWarning",
        "-m",
        "truepose",
    ]
    demo = [*command, "demo", "--in-memory", "--out", str(tmp_path / "d"), "--json", str(tmp_path / "j.json")]
    done = subprocess.run(demo, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    warned = [line for line in done.stderr.splitlines() if "EncodingWarning" in line]
    assert not [line for line in warned if "site-packages" not in line]

"""The identity of the program that computes: its version and a fingerprint of the rooms that decide a diagnosis.

Two builds may bear one version, and a worker of the other one gives other results under the same key. Nothing here
needs numpy: a worker is asked before it loads any.
"""

from __future__ import annotations

import hashlib
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

_DECIDES = ("*.py", "*.toml")  # of calib: the numerics and the robots in the box
_DIGITS = 12


@cache
def this_program() -> str:
    """Version and fingerprint, "0.1.0+3f9a1c07b2ee": the first is that of `truepose --version`, the second the SHA-256
    over the sources of `calib`. It is that of the files when it is first asked."""
    spec = find_spec("calib")
    assert spec is not None
    assert spec.origin is not None
    return f"{metadata.version('truepose')}+{fingerprint(Path(spec.origin).parent)}"


def fingerprint(folder: Path) -> str:
    """The SHA-256 over names and contents of the sources below a folder, its first digits. Ends of lines as Unix has
    them: a checkout on Windows is the same program."""
    found = hashlib.sha256()
    for file in sorted(each for pattern in _DECIDES for each in folder.rglob(pattern)):
        content = file.read_bytes().replace(b"\r\n", b"\n")
        found.update(f"{file.relative_to(folder).as_posix()} {len(content)}\n".encode())
        found.update(content)
    return found.hexdigest()[:_DIGITS]


def release(of: str) -> str:
    """The version of a program without its fingerprint."""
    return of.partition("+")[0]

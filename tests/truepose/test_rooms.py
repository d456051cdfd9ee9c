"""A foreign package in the place of one of ours is noticed at start."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import truepose
from truepose.__main__ import ROOMS, refuse_foreign, where


def test_ours_are_found() -> None:
    home = Path(truepose.__file__).parents[1]
    assert {where(name) for name in ROOMS} == {home / name for name in ROOMS}
    with pytest.raises(ImportError, match=r"'no_such_room'.*there is none"):
        refuse_foreign(["no_such_room"])


def test_a_foreign_service_is_named(tmp_path: Path) -> None:
    """Another package `service` of the user is first on the path."""
    (tmp_path / "service").mkdir()
    (tmp_path / "service" / "__init__.py").write_text("")
    home = str(Path(truepose.__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), home])}
    command = [sys.executable, "-m", "truepose", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path, check=False)
    assert done.returncode == 1
    assert f"own package 'service', in {home}, but {tmp_path / 'service'} is found instead" in done.stderr
    assert "Traceback" not in done.stderr
    used = [sys.executable, "-c", "import truepose; truepose.read"]
    done = subprocess.run(used, capture_output=True, text=True, env=environment, cwd=tmp_path, check=False)
    assert "ImportError: truepose needs its own package 'service'" in done.stderr

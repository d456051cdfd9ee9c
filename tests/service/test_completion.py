"""Completion of words by a shell, as `truepose --install-completion` sets it up."""

from __future__ import annotations

import os
import subprocess
import sys


def test_a_shell_completes_commands() -> None:
    asked = {"_TRUEPOSE_COMPLETE": "complete_bash", "COMP_WORDS": "truepose campaign res", "COMP_CWORD": "2"}
    command = [sys.executable, "-m", "truepose"]
    done = subprocess.run(command, env=os.environ | asked, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["rescue", "resume"]

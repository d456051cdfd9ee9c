"""The files of `deploy/`: command lines for the program, a unit for systemd, a script.

The script is not tested.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from service.commands import load
from service.http.access.connections import is_loopback

DEPLOY = Path(__file__).parents[2] / "deploy"


def taken(words: list[str]) -> dict[str, Any]:
    """Return the options that the program reads from the words after `truepose`.

    An option that the program does not have raises an error.
    """
    name, *arguments = words
    return load(name).make_context(name, arguments).params


def command_lines() -> dict[str, list[str]]:
    """The words behind `truepose` in every file of the folder."""
    unit = (DEPLOY / "truepose.service").read_text("utf-8")
    image = (DEPLOY / "Dockerfile").read_text("utf-8")
    script = (DEPLOY / "windows" / "install-service.ps1").read_text("utf-8")
    (of_unit,) = re.findall(r"^ExecStart=\S+/truepose (.*)$", unit, re.MULTILINE)
    (of_image,) = re.findall(r"^CMD (\[.*\])$", image, re.MULTILINE)
    (of_script,) = re.findall(r'^\$arguments = "-X utf8 -m truepose (.*)"$', script, re.MULTILINE)
    windows = of_script.replace("`", "").replace("$Port", "8035").replace("\\", "/")
    return {
        "unit": shlex.split(of_unit),
        "image": json.loads(of_image),
        "script": [word.strip('"') for word in re.findall(r'"[^"]*"|\S+', windows)],
    }


def test_the_program_takes_every_command_line() -> None:
    for name, words in command_lines().items():
        given = taken(words)
        assert words[0] == "serve"
        assert given["port"] == 8035, name
        assert given["cell"].name == "cell.toml", name
        assert given["token_file"].name == "tokens", name
        assert not given["simulate"]
        # a container has an address of its own, and compose publishes it on this computer alone
        assert is_loopback(given["host"]) is (name != "image")
    assert '"127.0.0.1:8035:8035"' in (DEPLOY / "compose.yaml").read_text("utf-8")


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd here")
def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    unit = (DEPLOY / "truepose.service").read_text("utf-8")
    file = tmp_path / "truepose.service"
    file.write_text(unit.replace("/opt/truepose/bin/truepose", "/bin/true"), "utf-8")
    done = subprocess.run(
        ["systemd-analyze", "verify", str(file)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_what_is_untested_says_so() -> None:
    assert "UNTESTED" in (DEPLOY / "windows" / "install-service.ps1").read_text("utf-8")
    page = (DEPLOY.parent / "docs" / "cell-pc" / "install.md").read_text("utf-8")
    assert "**not at all**: there is no Windows here" in page


@pytest.mark.whole
def test_the_image_is_built_and_runs() -> None:
    if shutil.which("docker") is None or subprocess.run(["docker", "info"], capture_output=True).returncode:
        pytest.skip("no Docker daemon runs here: `make image` is not tried")
    subprocess.run(["make", "image"], cwd=DEPLOY.parent, check=True)
    run = ["docker", "run", "--rm", "truepose"]
    done = subprocess.run([*run, "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("truepose ")
    refused = subprocess.run(
        [*run, "serve", "--cell", "/none.toml"], capture_output=True, text=True, check=False
    )
    assert refused.returncode == 2
    assert "/none.toml: there is no such file" in refused.stderr

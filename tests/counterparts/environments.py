"""Programs that nobody here wrote, each in an environment of its own under `.counterparts/`.

They do not share ours: fanucpy declares a numpy below 2, and ur-rtde holds the interpreter's lock while it connects.
`<name>.txt` beside this file pins them. `make counterparts` builds what is missing, by pip and whatever index it is
set up for; a test whose environment is not there skips and names that command.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
HERE = Path(__file__).parent
INSTALL_S = 300.0


class Absent(Exception):
    """A counterpart could not be installed."""


@dataclass(frozen=True)
class Environment:
    """One counterpart and what it is set against."""

    name: str
    against: str

    @property
    def folder(self) -> Path:
        return ROOT / ".counterparts" / self.name

    @property
    def python(self) -> Path:
        return self.folder / "bin" / "python"

    @property
    def _wanted(self) -> str:
        return f"{sys.version}\n{self._requirements.read_text(encoding='utf-8')}"

    @property
    def _requirements(self) -> Path:
        return HERE / f"{self.name}.txt"

    @property
    def _stamp(self) -> Path:
        return self.folder / ".installed"

    @property
    def built(self) -> bool:
        """Whether it is there, for this Python and as pinned."""
        return self._stamp.is_file() and self._stamp.read_text(encoding="utf-8") == self._wanted

    def build(self) -> None:
        """Install it unless it is there. Raises Absent, with the reason."""
        if self.built:
            return
        _call("-m", "venv", "--clear", "--without-pip", str(self.folder))
        pip = ("-m", "pip", "--python", str(self.python), "install", "--quiet", "--no-deps")
        _call(*pip, "--disable-pip-version-check", "--requirement", str(self._requirements))
        self._stamp.write_text(self._wanted, encoding="utf-8")

    @property
    def versions(self) -> list[tuple[str, str]]:
        """Name and version of every package in it."""
        packages = self.folder.glob("lib/python*/site-packages")
        found = distributions(path=[str(each) for each in packages])
        return sorted((each.metadata["Name"], each.version) for each in found)

    def needed(self) -> pytest.MarkDecorator:
        """Mark of a test that talks to it."""
        return pytest.mark.skipif(not self.built, reason=f"no {self.name} here: make counterparts")


def _call(*arguments: str) -> None:
    try:
        done = subprocess.run(
            [sys.executable, *arguments], capture_output=True, text=True, check=False, timeout=INSTALL_S
        )
    except subprocess.TimeoutExpired as error:
        raise Absent(f"took more than {INSTALL_S:.0f} s") from error
    if done.returncode != 0:
        said = [line for line in (done.stderr or done.stdout).splitlines() if line.strip()]
        raise Absent(said[-1] if said else f"ended with code {done.returncode}")


FANUCPY = Environment("fanucpy", "simulated Fanuc, MAPPDK text: moves it")
FANUC_RMI = Environment("fanuc-rmi", "simulated Fanuc, RMI: moves it")
FANUC_UCL = Environment("fanuc-ucl", "simulated Fanuc, RMI: moves it through points in one go")
UR_RTDE = Environment("ur-rtde", "simulated UR, RTDE: reads it while our driver moves it")
RWS = Environment("rws", "simulated Robot Web Services: RWS 1 by abb-robot-client, RWS 2 by rwswrap")
CESAPI = Environment("cesapi", "simulated emScon: measures with it; emScon driver: serves its commands")
YRCOM = Environment("yrcom", "simulated Yaskawa, HSES: moves it; Yaskawa driver: replays what it recorded")
DCC = Environment("dcc", "digital calibration certificate: reads it, its schema's types and its units")
POSTGRES = Environment("postgres", "store of a plant: keeps it")
ENVIRONMENTS = (FANUCPY, FANUC_RMI, FANUC_UCL, UR_RTDE, RWS, CESAPI, YRCOM, DCC, POSTGRES)

"""`python -m tests.counterparts [--list]`: install the counterparts of the tests, print which there are.

Exit code 1 when one is missing; its tests then skip.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from importlib.metadata import version

from rich.console import Console
from rich.table import Table

from tests.counterparts.environments import ENVIRONMENTS, Absent

OURS = (
    ("pymodbus", "simulated Fanuc: its client moves it by registers and by signals"),
    ("pymodbus", "Fanuc driver on Modbus: its server answers"),
)
"""Installed beside the program itself."""


def mbpoll() -> str:
    """Version of the C program, `not installed` where it is not on the path."""
    path = shutil.which("mbpoll")
    if path is None:
        return "not installed"
    said = subprocess.run([path, "-V"], capture_output=True, text=True, check=False, timeout=10)
    return (said.stdout + said.stderr).split()[-1]


def main() -> int:
    """Build unless told only to list; print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.counterparts", description=__doc__)
    parser.add_argument("--list", action="store_true", help="install nothing")
    if not parser.parse_args().list:
        for each in ENVIRONMENTS:
            try:
                each.build()
            except Absent as error:
                sys.stderr.write(f"{each.name} is not installed: {error}\n")
    table = Table("program", "version", "against", box=None, pad_edge=False)
    for each in ENVIRONMENTS:
        for name, number in each.versions if each.built else [(each.name, "not installed")]:
            table.add_row(name, number, each.against)
    for name, against in OURS:
        table.add_row(name, version(name), against)
    table.add_row("mbpoll", mbpoll(), "simulated Fanuc on Modbus: reads its joints")
    Console(width=120).print(table)
    return 0 if all(each.built for each in ENVIRONMENTS) else 1


if __name__ == "__main__":
    sys.exit(main())

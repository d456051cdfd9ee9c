"""Cells of the examples on a bench for `truepose doctor`.

The simulators run in this process; the requests that they received are recorded.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from acquisition import Cell, Devices, open_devices, read_cell
from acquisition.examination import Examination, examine
from mocks.cell import CellThread
from mocks.cell_file import read_cell as read_mock_cell
from tests.end_to_end.simulated import ROOT

EXAMPLES = sorted(path.parent.name for path in (ROOT / "examples").glob("*/cell.toml"))


@dataclass
class Bench:
    """Cell of an example in this process, with the addresses of its simulators in its cell file."""

    simulators: CellThread
    file: Path

    @property
    def cell(self) -> Cell:
        return read_cell(self.file)

    def examine(self, devices: Devices | None = None, **options: Any) -> Examination:
        cell = self.cell
        return examine(cell, devices or open_devices(cell), record=self.file.parent, **options)

    def rewrite(self, old: str, new: str) -> None:
        text = self.file.read_text("utf-8")
        assert old in text
        self.file.write_text(text.replace(old, new), "utf-8")


@contextmanager
def bench(
    example: str, folder: Path, robot_driver: str = "", instrument_driver: str = "", dialect: str = ""
) -> Iterator[Bench]:
    """Set up the cell of an example in a folder.

    Drivers for robot or instrument, and the dialect of a device, replace those of the example if they are named.
    """
    file, source = folder / "cell.toml", ROOT / "examples" / example
    for robot_file in source.glob("abb-*.toml"):
        shutil.copy(robot_file, folder)
    shutil.copy(source / "cell.toml", file)
    text = file.read_text("utf-8")
    for section, driver in (("robot", robot_driver), ("instrument", instrument_driver)):
        if driver:
            text = re.sub(rf'(?s)(\[{section}\].*?driver = )"[a-z]+"', rf'\1"{driver}"', text, count=1)
    file.write_text(text, "utf-8")
    with TemporaryDirectory() as elsewhere:
        whole = Path(elsewhere) / "cell.toml"
        whole.write_text(read_cell(file).source, "utf-8")
        described = replace(read_mock_cell(whole), time_scale=1.0)
    described = replace(described, dialect=dialect or described.dialect)
    names = (described.robot_driver, described.instrument_driver)
    with CellThread(described, devices=described.devices) as simulators:
        urls = iter([simulators.url(name) for name in names])
        text = re.sub(r'(?m)^url = "[^"]*"', lambda _: f'url = "{next(urls)}"', file.read_text("utf-8"))
        file.write_text(text, "utf-8")
        yield Bench(simulators, file)


@dataclass
class Requests:
    """Requests that were sent to each device."""

    sent: list[tuple[str, bytes]] = field(default_factory=list)

    def record(self, device: str, direction: str, data: bytes) -> None:
        if direction == ">":
            self.sent.append((device, data))


def faults(found: Examination) -> dict[tuple[str, str], tuple[int | None, str | None]]:
    for each in found.faults:
        assert re.fullmatch(r"[A-Z].{10,}\.", each.do), each
    return {(each.device, each.check): (each.code, each.error) for each in found.faults}


def level_of(found: Examination, device: str, check: str) -> str:
    return next(each.level for each in found.findings if (each.device, each.check) == (device, check))

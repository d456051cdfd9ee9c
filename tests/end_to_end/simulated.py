"""A simulated cell in a separate process, as a person would start it, and its back door."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from acquisition import Cell, Devices, open_devices
from acquisition.loop import Equipment
from drivers import Operator
from mocks.cell import CellThread
from mocks.cell_file import read_cell as read_mock_cell
from mocks.shared.clock import SteppedClock
from service.simulated_cell import ManualCellOperator, SimulatedHands
from tests.drivers.waiting import PATIENCE_S

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "irb120_faro"


def truepose(
    *arguments: str, stdin: int = subprocess.DEVNULL, cwd: Path = ROOT
) -> subprocess.CompletedProcess[str]:
    """Run `truepose` in a separate process, as a shell starts it."""
    return subprocess.run(
        [sys.executable, "-m", "service.cli", *arguments],
        stdin=stdin,
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=PATIENCE_S,
        check=False,
    )


class SimulatedCell:
    """Addresses of the devices of the other process."""

    def __init__(self, lines: Sequence[str]) -> None:
        self.ports = {end["device"]: end["port"] for end in map(json.loads, lines)}

    def url(self, device: str) -> str:
        return f"tcp://127.0.0.1:{self.ports[device]}"

    def devices(self, cell: Cell, operator: Operator | None = None) -> Devices:
        return open_devices(
            cell, operator=operator, robot_url=self.url("abb"), instrument_url=self.url("faro")
        )

    def do(self, what: str, **order: object) -> dict[str, Any]:
        """An order of the back door."""
        with socket.create_connection(("127.0.0.1", self.ports["backdoor"]), timeout=PATIENCE_S) as link:
            link.sendall(json.dumps({"do": what} | order).encode() + b"\n")
            with link.makefile("rb") as answers:
                answer = json.loads(answers.readline())
        assert answer["ok"], answer
        return answer


@contextmanager
def simulated_cell(file: Path, *options: str) -> Iterator[SimulatedCell]:
    """`python -m mocks cell FILE --port 0` until the block ends."""
    command = [sys.executable, "-m", "mocks", "cell", str(file), "--port", "0", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        try:
            assert process.stdout is not None
            lines = [process.stdout.readline()]
            while json.loads(lines[-1])["device"] != "backdoor":  # the last
                lines.append(process.stdout.readline())
            yield SimulatedCell(lines)
        finally:
            process.terminate()


_BEGAN_UTC_S = 1_700_000_000.0


class SteppedCampaignClock:
    """Clock of a campaign on a cell whose time passes only while a thread waits for it."""

    time_scale = 1.0

    def __init__(self, cell: SteppedClock) -> None:
        self._cell = cell

    def now(self) -> float:
        self._cell.step(1e-3)  # no two things happen at the same moment
        return self._cell.now()

    def utc(self) -> float:
        return _BEGAN_UTC_S + self._cell.now()

    def wait(self, seconds: float, wake: threading.Event) -> bool:
        if wake.is_set():
            return True
        self._cell.step(seconds)
        return False


@contextmanager
def stepped_cell(cell: Cell, operator: Operator | None = None) -> Iterator[Equipment]:
    """Run the simulated cell behind its sockets, in a thread.

    Neither it nor a campaign there waits for real time.
    """
    clock = SteppedClock()
    with TemporaryDirectory() as folder:
        file = Path(folder) / "cell.toml"
        file.write_text(cell.source, encoding="utf-8")
        described = read_mock_cell(file)
    drivers = (cell.robot.driver, cell.instrument.driver)
    with CellThread(described, devices=described.devices, clock=clock) as simulated:
        robot, instrument = map(simulated.url, drivers)
        hands = SimulatedHands(simulated.port("backdoor"))
        by_hand = cell.robot.declared.by_hand or cell.instrument.declared.by_hand
        devices = open_devices(
            cell,
            operator=operator,
            hands=hands,
            person=ManualCellOperator(simulated.port("manual")) if by_hand else None,
            robot_url=robot,
            instrument_url=instrument,
        )
        yield Equipment(cell, devices, SteppedCampaignClock(clock), simulated=True)


def cell_file(
    folder: Path, *, time_scale: float, effects: Sequence[str] = ("none",), one_smr: bool = False
) -> Path:
    """Write the example's cell, faster and with these effects.

    With `one_smr`, a person seats the SMR for every target.
    """
    text = (EXAMPLE / "cell.toml").read_text(encoding="utf-8")
    text = text.replace("effects = []", f"effects = {json.dumps(list(effects))}")
    text = text.replace("time_scale = 200.0", f"time_scale = {time_scale}")
    if one_smr:
        text = text.replace("one_smr = false", "one_smr = true")
    path = folder / "cell.toml"
    path.write_text(text, encoding="utf-8")
    return path


def campaign_file(folder: Path, **changes: object) -> Path:
    """Write the example's campaign with changed keys.

    `calibration` and `validation` are numbers of poses, the rest are plain keys.
    """
    text = (EXAMPLE / "campaign.toml").read_text(encoding="utf-8")
    top, *blocks = text.split("[[block]]")
    for key, value in changes.items():
        if key in ("calibration", "validation"):
            blocks = [re.sub(r"count = \d+", f"count = {value}", b) if f'"{key}"' in b else b for b in blocks]
        else:
            top = re.sub(rf"(?m)^{key} = .*$", f"{key} = {json.dumps(value)}", top)
    text = "[[block]]".join([top, *blocks])
    path = folder / "campaign.toml"
    path.write_text(text, encoding="utf-8")
    return path

"""Simulators of a cell in a separate process.

The process is started, reports the addresses of its devices, and is certain to end with the block that needs it.
"""

from __future__ import annotations

import json
import socket
import subprocess
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any

from acquisition import Cell, Devices, open_devices
from drivers.errors import ConfigError
from drivers.interfaces import Answer, Operator, Prompt, Typed
from drivers.operator import RehearsalOperator
from service.child import python

START_TIMEOUT_S = 60.0  # a shared machine may be slow to import numpy
END_TIMEOUT_S = 5.0
HAND_TIMEOUT_S = 30.0
_LAST = "backdoor"  # printed after all others


class SimulatedDevices:
    """Addresses at which the simulators of a cell listen.

    `queries` holds what a driver has to know besides the port of its device, as the query of a URL.
    """

    def __init__(self, ports: Mapping[str, int], queries: Mapping[str, str] | None = None) -> None:
        self.ports = ports
        self._queries = queries or {}

    def open(self, cell: Cell, operator: Operator | None = None) -> Devices:
        """Open the devices of the cell at the addresses of the simulators.

        `operator` is not used if the cell file requests a simulated operator as well.

        Raises
        ------
        ConfigError
            There is no simulator for a driver of the cell.
        """
        by_hand = [each.driver for each in (cell.robot, cell.instrument) if each.declared.by_hand]
        return open_devices(
            cell,
            operator=RehearsalOperator() if cell.rehearsed else operator,
            person=ManualCellOperator(self._port(by_hand[0])) if by_hand else None,
            robot_url=self._url(cell.robot.driver, cell.robot.declared.scheme),
            instrument_url=self._url(cell.instrument.driver),
            hands=SimulatedHands(self.ports[_LAST]),
        )

    def _url(self, driver: str, scheme: str = "tcp") -> str:
        query = self._queries.get(driver, "")
        return f"{scheme}://127.0.0.1:{self._port(driver)}" + (f"?{query}" if query else "")

    def _port(self, driver: str) -> int:
        if driver not in self.ports:
            raise ConfigError(
                f"there is no simulator for the driver {driver!r} in this cell",
                what_to_do="Use the devices of the cell file without --simulate.",
            )
        return self.ports[driver]


class ManualCellOperator:
    """Simulated person for devices without a driver: moves the arm, reads values and types them."""

    def __init__(self, port: int) -> None:
        self._port = port

    def ask(self, prompt: Prompt) -> Answer | Typed:
        """Have the simulators answer a prompt.

        Raises
        ------
        ConfigError
            The simulators do not answer.
        """
        entry = None if prompt.entry is None else asdict(prompt.entry)
        question = {"text": prompt.text, "picture": prompt.picture, "entry": entry}
        answer = _answer_of(self._port, question, None)
        return Typed(answer["typed"]) if answer["typed"] else Answer.CONFIRM


class SimulatedHands:
    """Hands of a person who guides the arm of a simulated cell, through its back door."""

    def __init__(self, port: int) -> None:
        self._port = port

    def touch(self, target: str, base_target: str, near_deg: Sequence[float]) -> None:
        """Touch a base ball with a target.

        Raises
        ------
        ConfigError
            The simulated arm does not reach the ball.
        """
        self._do({"do": "touch", "target": target, "base": base_target, "near_deg": list(near_deg)})

    def jog(self, joints_deg: Sequence[float]) -> None:
        """Move the simulated arm by hand.

        Raises
        ------
        ConfigError
            The simulated arm did not move, or does not answer.
        """
        self._do({"do": "jog", "joints_deg": list(joints_deg)})

    def _do(self, order: Mapping[str, object]) -> None:
        answer = _answer_of(self._port, order, HAND_TIMEOUT_S)
        if not answer.get("ok"):
            raise ConfigError(
                f"the simulated arm was not jogged: {answer.get('error', 'no answer')}",
                what_to_do="Start the simulation again.",
            )


def _answer_of(port: int, question: Mapping[str, object], seconds: float | None) -> dict[str, Any]:
    """Send one JSON line to a simulator and return its answer.

    Waits up to `seconds`; without limit if None.

    Raises
    ------
    ConfigError
        The simulators do not answer or have ended.
    """
    try:
        with (
            socket.create_connection(("127.0.0.1", port), HAND_TIMEOUT_S) as back_door,
            back_door.makefile("rwb") as lines,
        ):
            back_door.settimeout(seconds)
            lines.write(json.dumps(question).encode() + b"\n")
            lines.flush()
            if line := lines.readline():
                return json.loads(line)
    except OSError as error:
        raise ConfigError(
            f"the simulators of the cell do not answer: {error}", what_to_do="Start the simulation again."
        ) from error
    raise ConfigError("the simulators of the cell have ended", what_to_do="Start the simulation again.")


def command_of(*arguments: str) -> list[str]:
    """Return the command line of the simulators."""
    return python("mocks", *arguments)


@contextmanager
def simulated_cell(cell: Cell) -> Iterator[SimulatedDevices]:
    """Run the simulators of `cell` until the block ends.

    Raises
    ------
    ConfigError
        The simulators do not start.
    """
    with TemporaryDirectory(prefix="truepose-cell-") as folder:
        file = Path(folder) / "cell.toml"
        file.write_text(cell.source, encoding="utf-8")
        process = subprocess.Popen(
            python("service.guard", *command_of("cell", str(file), "--port", "0")),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            encoding="utf-8",
            start_new_session=True,  # Ctrl-C at the terminal is for the campaign; it still needs its devices
        )
        try:
            assert process.stdout is not None
            yield SimulatedDevices(*_endpoints(process, process.stdout))
        finally:
            _end(process)


def _endpoints(process: subprocess.Popen[str], lines: IO[str]) -> tuple[dict[str, int], dict[str, str]]:
    """Return the port of each simulated device, and the query of its URL if it has one."""
    ports: dict[str, int] = {}
    queries: dict[str, str] = {}
    impatience = threading.Timer(START_TIMEOUT_S, process.kill)
    impatience.start()
    try:
        while _LAST not in ports:
            line = lines.readline()
            if not line:
                raise ConfigError("the simulators of the cell did not start; their message is above")
            endpoint = json.loads(line)
            ports[endpoint["device"]] = endpoint["port"]
            queries[endpoint["device"]] = endpoint.get("query", "")
    finally:
        impatience.cancel()
    return ports, queries


def _end(process: subprocess.Popen[str]) -> None:
    """Close the input of the guard, which then ends the simulators and itself."""
    for stream in (process.stdin, process.stdout):
        assert stream is not None
        stream.close()
    try:
        process.wait(END_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()

"""A simulated person who reads a question, acts on it, and types an answer.

The person drives the simulated arm by hand or reads the simulated tracker. JSON lines over TCP: {"text": ...,
"picture": ..., "entry": {...}} is answered by {"answer": "confirm", "typed": ...}.

The action is taken from the text, as a person does. The arm is driven to the named postures in turn, `J1 12.50
deg, E1 ... mm`. The name after "Measure" is the target. The pendant shows as many digits as `resolution_deg` of
the cell file allows, in mm for a sliding joint. If `within_deg` is given, the hand is off by up to half of it.
"""

from __future__ import annotations

import asyncio
import json
import math
import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mocks.cell_file import CellFile
from mocks.shared.arm_device import ArmDevice
from mocks.shared.clock import CellClock
from mocks.shared.tracker_device import TrackerDevice
from mocks.world.robots import Robot

HAND_STREAM = 43
HAND_DEG_S, HAND_MM_S = 10.0, 100.0  # of jogging
READING_S = 5.0  # from looking at the display to the last digit
_MM = {"mm": 1.0, "m": 1000.0, "in": 25.4}
_NUMBER = r"(-?\d+(?:\.\d+)?)(?: deg| mm)?"


class SimulatedPerson:
    """One person for robot and instrument.

    The pendant counts joints as the controller of `robot` does.
    """

    def __init__(
        self, cell: CellFile, arm: ArmDevice, tracker: TrackerDevice, clock: CellClock, robot: Robot
    ) -> None:
        self._cell, self._arm, self._tracker, self._clock = cell, arm, tracker, clock
        self._counting = robot.counting
        self._posture = re.compile(", ".join(f"{name.upper()} {_NUMBER}" for name in robot.names))
        self._rng = np.random.default_rng([cell.seed, HAND_STREAM])
        self._last = ""
        self.slip: Callable[[str], str] | None = None  # what the next entry is mistyped to
        self.asked: list[str] = []

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while line := await reader.readline():
            writer.write(json.dumps(await self.answer(json.loads(line))).encode() + b"\n")
            await writer.drain()

    async def answer(self, question: dict[str, Any]) -> dict[str, str]:
        """Answer one question."""
        entry, picture = question.get("entry"), question.get("picture") or ""
        self.asked.append(question["text"])
        if entry is None:
            return {"answer": "confirm", "typed": ""}
        if "again" not in picture.split("/"):
            self._last = await self._act(question["text"], picture.split("/")[0], entry)
            if self._last and self.slip is not None:
                slip, self.slip = self.slip, None
                return {"answer": "confirm", "typed": slip(self._last)}
        return {"answer": "confirm", "typed": self._last}

    async def _act(self, text: str, what: str, entry: dict[str, Any]) -> str:
        """Carry out a question and return the text to type.

        The text is empty if the display shows the requested value.
        """
        if what == "read":
            return await self._read(text, entry["unit"])
        if what == "pendant":
            return self._shown()
        postures = [[float(q) for q in each.groups()] for each in self._posture.finditer(text)]
        for number, posture in enumerate(postures, start=1):
            await self._drive(posture, off=number == len(postures))
        return "" if self._cell.within_deg is None else self._shown()

    async def _drive(self, posture: Sequence[float], *, off: bool) -> None:
        if off and self._cell.within_deg is not None:
            half = 0.5 * self._cell.within_deg
            posture = [self._rounded(q + float(self._rng.uniform(-half, half))) for q in posture]
        self._arm.start(self._counting.to_model(posture), HAND_DEG_S, HAND_MM_S)
        await self._clock.wait(self._arm.left_s, asyncio.Event())

    def _rounded(self, q: float) -> float:
        return round(q / self._cell.resolution_deg) * self._cell.resolution_deg

    def _shown(self) -> str:
        """Return the joints that the pendant shows."""
        decimals = max(0, math.ceil(-math.log10(self._cell.resolution_deg)))
        shown = self._counting.counted(self._arm.joints_deg())
        return " ".join(f"{self._rounded(q) + 0.0:.{decimals}f}" for q in shown)

    async def _read(self, text: str, unit: str) -> str:
        """Return the point of the target that the instrument shows."""
        await self._clock.wait(READING_S, asyncio.Event())
        (name,) = re.findall(r"Measure (\w+)", text)
        point, _ = self._tracker.average(self._tracker.choose(name), 100)
        return " ".join(f"{x / _MM[unit]:.7f}" for x in point)

"""Test Yaskawa's HSES with yrcom, a third-party client and server of recorded answers."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers import ProtocolError, YaskawaArm, YaskawaDeadlines
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.yaskawa.controller import MAX_DEG_S, PULSES_PER_DEG
from tests.counterparts.environments import YRCOM
from tests.drivers.waiting import PATIENCE_S

FAST = CellFile(robot="yaskawa-gp7", time_scale=10_000.0, effects=("none",))
PEER = [str(YRCOM.python), str(Path(__file__).parent / "yrcom_peer.py")]
CALM = YaskawaDeadlines(reply_s=PATIENCE_S, gap_s=0.001)


@pytest.fixture
def cell() -> Iterator[CellThread]:
    with CellThread(FAST, devices=("yaskawa",)) as cell:
        yield cell


def arm_at(url: str, wire: object = None) -> YaskawaArm:
    return YaskawaArm(
        url,
        pulses_per_deg=PULSES_PER_DEG,
        max_deg_s=MAX_DEG_S,
        deadlines=CALM,
        wire=wire,  # type: ignore[arg-type]
    )


@YRCOM.needed()
def test_yrcom_moves_the_simulator(cell: CellThread) -> None:
    """Every refusal reaches yrcom, though it reads another header field than the manual states."""
    command = [*PEER, "client", str(cell.port("yaskawa"))]
    said = json.loads(
        subprocess.run(command, capture_output=True, text=True, check=True, timeout=PATIENCE_S).stdout
    )
    status = said["status"]
    assert (status["play"], status["cmd_remote"], status["servo_on"]) == (True, True, True)
    assert (status["teach"], status["running"], status["alarm"], status["hold_cmd"]) == (False,) * 4
    assert said["info"]["model"] == "GP7"
    assert said["axes"] == ["S", "L", "U", "R", "B", "T"]
    pulses = [14353, -26006, 4266, 9699, -4901, 45475]
    assert said["target"] == [*pulses, 0, 0]
    assert said["job"] == "TRUEPOSE1"
    assert said["held"]
    assert said["start while held"]
    assert [said["position"][f"pos_{axis}"] for axis in "SLURBT"] == pulses
    assert set(said["following error"].values()) == {0}
    assert said["alarm"] == 0
    assert said["no such job"]
    assert said["undefined position"]
    assert cell.cell is not None
    expected = [count / per for count, per in zip(pulses, PULSES_PER_DEG, strict=True)]
    assert cell.cell.arm.joints_deg() == pytest.approx(expected, abs=1e-9)


class SessionRecorder:
    """Keeps requests and answers in yrcom's form of a recorded session."""

    def __init__(self) -> None:
        self.pairs: list[dict[str, str]] = []

    def record(self, device: str, direction: str, data: bytes) -> None:
        if direction == ">":
            self.pairs.append({"tx": data.hex()})
        elif direction == "<":
            self.pairs[-1]["rx"] = data.hex()


@YRCOM.needed()
def test_driver_with_yrcom_server(cell: CellThread, tmp_path: Path) -> None:
    """The driver reads recorded answers as before, and refuses the other answers for their form."""
    recorder = SessionRecorder()
    arm = arm_at(cell.url("yaskawa"), recorder)
    arm.connect()
    arm.arm()
    target = arm.move_to((10.0, 20.0, -30.0, 40.0, -50.0, 60.0)).joints_deg
    recorder.pairs = []  # from here on it only reads
    arm.disconnect()
    arm.connect()
    seen = arm.position(), arm.identify(), arm.status()
    arm.disconnect()
    capture = tmp_path / "capture.json"
    capture.write_text(json.dumps({"hses": {"ops": [{"wire": recorder.pairs}]}}), encoding="utf-8")
    with subprocess.Popen(
        [*PEER, "replay", str(capture)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as server:
        assert server.stdout is not None
        assert server.stdin is not None
        again = arm_at(f"udp://127.0.0.1:{int(server.stdout.readline())}")
        again.connect()
        assert (again.position(), again.identify(), again.status()) == seen
        assert seen[0].joints_deg == target
        with pytest.raises(ProtocolError, match="no answer of a High-Speed Ethernet Server"):
            again.arm()
        again.disconnect()
        server.stdin.close()

"""Test the simulated Robot Web Services with third-party clients.

abb-robot-client speaks RWS 1, and rwswrap speaks RWS 2.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from mocks.cell import CellThread
from mocks.cell_file import CellFile
from tests.counterparts.environments import RWS
from tests.drivers.waiting import PATIENCE_S

FAST = CellFile(time_scale=10_000.0, effects=("none",))
JOINTS = [10.0, 20.25, -30.5, 40.0, -45.125, 3.0]


def said(cell: CellThread, dialect: str) -> dict[str, Any]:
    peer = [str(RWS.python), str(Path(__file__).parent / "rws_peer.py"), str(cell.port("abb-rws")), dialect]
    return json.loads(
        subprocess.run(peer, capture_output=True, text=True, check=True, timeout=PATIENCE_S).stdout
    )


@RWS.needed()
def test_rwswrap_stops_the_program_in_one_session() -> None:
    with CellThread(FAST, devices=("abb", "abb-rws")) as cell:
        assert said(cell, "rws2") == {"before": "running", "stop": 204, "after": "stopped", "runs": False}
        assert cell.cell is not None
        assert len(cell.cell.rws.sessions) == 1
        assert cell.cell.arm.hung


@RWS.needed()
def test_abb_robot_client_reads_the_old_dialect() -> None:
    cell = CellThread(FAST, devices=("abb", "abb-rws"))
    make = cell._make

    def made() -> Any:
        simulated = make()
        simulated.rws.old = True
        return simulated

    cell._make = made
    with cell:
        cell.do("jog", joints_deg=JOINTS)
        read = said(cell, "rws1")
    assert read.pop("joints") == pytest.approx(JOINTS)
    assert read == {"controller": "motoron", "mode": "AUTO", "execution": "running"}

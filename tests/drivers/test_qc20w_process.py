"""The instruments' simulators as separate processes, with a JSON line per endpoint.

They serve until a signal.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys

import pytest

from drivers import CTrack, Device, EmsconTracker, LeicaTracker, Qc20w
from tests.drivers.waiting import PATIENCE_S


def _driver(end: dict[str, str | int]) -> Device:
    url = str(end.get("url", f"tcp://{end.get('host')}:{end.get('port')}"))
    if str(end["device"]).startswith("qc20w"):
        return Qc20w(url, nominal_mm=300.0)
    return {"ctrack": CTrack, "leica": LeicaTracker, "emscon": EmsconTracker}[str(end["device"])](url)


@pytest.mark.parametrize(
    ("name", "protocols"),
    [
        ("ctrack", {"ctrack": "mbp1"}),
        ("leica", {"leica": "mbp1"}),
        ("emscon", {"emscon": "emscon"}),
        ("qc20w", {"qc20w": "mbp1", "qc20w-serial": "mbp1"}),
    ],
)
def test_every_endpoint_can_be_armed(name: str, protocols: dict[str, str]) -> None:
    command = [sys.executable, "-W", "error", "-m", "mocks", name, "--time-scale", "1000"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        ends = [json.loads(process.stdout.readline()) for _ in range(len(protocols) + 1)]
        assert {end["device"]: end["protocol"] for end in ends[:-1]} == protocols
        assert ends[-1]["device"] == "backdoor"
        for end in ends[:-1]:
            device = _driver(end)
            device.connect()
            device.arm()
            device.disconnect()
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, out, err) == (0, "", "")

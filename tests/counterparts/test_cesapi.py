"""emScon both ways round against CESAPI, which nobody here wrote: its client, and its packets as a server."""

from __future__ import annotations

import json
import math
import subprocess
from pathlib import Path

from drivers import EmsconTracker
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from tests.counterparts.environments import CESAPI
from tests.drivers.waiting import PATIENCE_S

HERE = Path(__file__).parent
FAST = CellFile(time_scale=10_000.0, effects=("none",))
NAMES = ("T1", "N1", "N2")

pytestmark = CESAPI.needed()


def test_its_client_measures_with_the_simulator() -> None:
    with CellThread(FAST, devices=("emscon",)) as cell:
        assert cell.cell is not None
        device = cell.cell.at960
        truth = [[float(v) for v in device.to_tracker(device.true_world(name))] for name in NAMES]
        places = [str(v + 3.0) for place in truth for v in place]
        peer = [str(CESAPI.python), str(HERE / "cesapi_client_peer.py"), str(cell.port("emscon")), *places]
        said = subprocess.run(peer, capture_output=True, text=True, check=True, timeout=PATIENCE_S).stdout
        reflector = cell.cell.emscon.reflector
    answers = [json.loads(line) for line in said.splitlines()]
    assert answers[:13] == [
        ["SetUnits", 0],
        ["Initialize", 0],
        ["SetCoordinateSystemType", 0],
        ["SetMeasurementMode", 0],
        ["SetStationaryModeParams", 0],
        ["SetSearchParams", 0],
        ["SetReflector", 0],
        ["air", 1013.2, 45.0],
        ["ready", 2],
        ["reflector", 100, 1, "CCR-1.5in"],
        ["reflector", 100, 2, "RRR-1.5in"],
        ["reflector", 100, 7, "TBR-0.5in"],
        ["serial", 390123],
    ]
    assert reflector == 7
    assert [answer[1] for answer in answers[13:] if answer[0] in ("go", "start")] == [0] * 2 * len(NAMES)
    readings = [answer[1:] for answer in answers[13:] if answer[0] == "measured"]
    assert len(readings) == len(NAMES)
    for (status, mode, point, std, air), true in zip(readings, truth, strict=True):
        assert (status, mode) == (0, 0)
        assert math.dist(point, true) < 0.3
        assert all(0.0 < each < 0.3 for each in std)
        assert air[1] == 1013.2


def test_our_driver_is_understood_by_its_packets() -> None:
    peer = [str(CESAPI.python), str(HERE / "cesapi_server_peer.py")]
    with subprocess.Popen(peer, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        url = f"tcp://127.0.0.1:{int(server.stdout.readline())}"
        tracker = EmsconTracker(url, search_radius_mm=25.0, reflector="TBR-0.5in")
        tracker.connect()
        identity = tracker.identify()
        tracker.arm()
        status = tracker.status()
        readings = [tracker.measure("T1", samples=80, near_mm=(k, 2.5, -3.25)) for k in range(3)]
        tracker.disconnect()
        heard = [json.loads(line) for line in server.stdout]
        assert server.wait(PATIENCE_S) == 0
    assert identity.serial == "390999"
    assert (status.state, status.t_air_c, status.pressure_hpa, status.humidity_percent) == (
        "READY",
        20.5,
        1001.25,
        40.0,
    )
    for k, reading in enumerate(readings):
        assert reading.xyz_mm == (1000.0 * (k + 1), -200.0, 50.25)
        assert reading.std_mm == (0.01, 0.02, 0.03)
        assert (reading.t_air_c, reading.pressure_hpa, reading.humidity_percent) == (20.5, 1001.25, 40.0)
    units = {"lenUnitType": 1, "angUnitType": 1, "tempUnitType": 0, "pressUnitType": 1, "humUnitType": 0}
    for command in (
        [5, units],
        [24, {"measMode": 0}],
        [26, {"coordSysType": 0}],
        [40, {"iInternalReflectorId": 7}],
        [42, {}],
        [28, {"lMeasTime": 800, "bUseADM": 1}],
        [43, {"dSearchRadius": 25.0, "lTimeOut": 7500}],
        *([55, {"dVal1": float(k), "dVal2": 2.5, "dVal3": -3.25, "bUseADM": 1}] for k in range(3)),
    ):
        assert heard.count(command) == 1, command
    assert heard.count([49, {}]) == 3

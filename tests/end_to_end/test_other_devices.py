"""Wrong devices at the address, or none.

Another device, another version, and another robot than in the cell file.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from acquisition.cell.cell import Cell, OtherDevice, cell_from, check_identity, is_model
from drivers import (
    AcquisitionError,
    ConfigError,
    FaroTracker,
    Identity,
    LinkError,
    LinkLost,
    ProtocolError,
    Qc20w,
)
from mocks.cell import CellThread
from mocks.shared.mbp import line
from tests.drivers.expected import CALSRV_MAIN, MBP_MEASURE, ExpectedDevice
from tests.drivers.nobody import nobody_listens
from tests.end_to_end.driver_benches import (
    BAR_MM,
    BENCHES,
    BRIDGE,
    FAST,
    abb_arm,
    fanuc_arm,
    sentence,
    ur_arm,
)

# -- addresses -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bench", BENCHES)
def test_nobody_at_the_address(bench: str) -> None:
    with nobody_listens() as port:
        device = BENCHES[bench].make(f"tcp://127.0.0.1:{port}")
        with pytest.raises(LinkLost) as caught:
            device.connect()
    assert caught.value.code == 1002
    assert caught.value.device.startswith(device.name)  # a second connection has a name of its own behind it
    assert "127.0.0.1" in caught.value.message
    # The port is closed, the cable is in order. A UR has services that a person opens.
    does = "enable Real-Time Data Exchange" if bench == "ur" else "start the program that listens there"
    assert does in caught.value.what_to_do


@pytest.mark.parametrize(
    ("make", "kind", "says"),
    [
        (lambda: abb_arm("tcp://no-such-host.invalid:5000").connect(), LinkLost, "no-such-host.invalid:5000"),
        (
            lambda: Qc20w("/dev/no-such-port", nominal_mm=BAR_MM, **BRIDGE).connect(),
            LinkLost,
            "/dev/no-such-port",
        ),
        (lambda: ur_arm("tcp://192.168.1.10"), ConfigError, "has no port"),
        (lambda: fanuc_arm("192.168.1.10:18735"), ConfigError, "must begin with tcp://"),
    ],
)
def test_no_such_host_port_or_form(
    make: Callable[[], object], kind: type[AcquisitionError], says: str
) -> None:
    with pytest.raises(kind, match=says) as caught:
        make()
    assert sentence(caught.value)


OWN = {
    "abb": {"abb"},
    "abb-simple": {"abb-simple"},
    "fanuc": {"fanuc"},
    "fanuc-hmi": {
        "fanuc-modbus-hmi",
        "fanuc-modbus-io",
    },  # one protocol; what the registers mean is not in it
    "fanuc-rmi": {"fanuc-rmi"},
    "ur": {"ur"},
    "faro": {"faro"},
    "leica": {"leica"},
    "emscon": {"emscon"},
    "ctrack": {"ctrack"},
    "qc20w": {"qc20w"},
}


@pytest.fixture(scope="module")
def everything() -> Any:
    simulators = (
        "abb",
        "abb-simple",
        "fanuc",
        "fanuc-rmi",
        "ur",
        "faro",
        "leica",
        "emscon",
        "ctrack",
        "qc20w",
    )
    with CellThread(FAST, devices=simulators) as cell:
        yield cell


@pytest.mark.parametrize("bench", OWN)
def test_every_other_device_on_the_port_is_refused(everything: CellThread, bench: str) -> None:
    """The bridge of another maker's tracker speaks the same lines; its identity shows it."""
    others = [end.device for end in everything.endpoints if end.device not in OWN[bench]]

    def met(endpoint: str) -> AcquisitionError | None:
        device = BENCHES[bench].make(everything.url(endpoint))
        try:
            device.connect()
            check_identity(cell_of(instrument=bench), "instrument", device.identify())
        except AcquisitionError as error:
            return error
        finally:
            device.disconnect()
        return None

    with ThreadPoolExecutor(max_workers=len(others)) as pool:
        errors = dict(zip(others, pool.map(met, others), strict=True))
    for endpoint, error in errors.items():
        assert isinstance(error, LinkError | OtherDevice), (endpoint, error)
        assert error.code in (1001, 1002, 1003, 6102)
        assert sentence(error)
        assert re.search(
            "address|program that listens|program runs|programs run|model, driver or url", error.what_to_do
        ), endpoint
    makers = {name for name, error in errors.items() if isinstance(error, OtherDevice)}
    assert makers == {"faro": {"leica"}, "leica": {"faro"}}.get(bench, set())


# -- versions ------------------------------------------------------------------------------------------------


def test_bridge_of_another_version() -> None:
    request, reply = MBP_MEASURE[0]
    changed = line(reply.rsplit(b"*", 1)[0].decode().replace("proto=1", "proto=2"))
    with ExpectedDevice([(request, changed)]) as device:
        tracker = FaroTracker(f"tcp://127.0.0.1:{device.port}", **BRIDGE)
        with pytest.raises(ProtocolError, match="proto is 2, needed 1") as caught:
            tracker.connect()
    assert (caught.value.code, caught.value.device) == (1003, "faro")
    assert "versions of MBP" in caught.value.what_to_do


def test_bridge_that_refuses_our_version() -> None:
    refusal = line('1 ERR code=103 text="proto=2 only" retry=0')
    with ExpectedDevice([(MBP_MEASURE[0][0], refusal)]) as device:
        tracker = FaroTracker(f"tcp://127.0.0.1:{device.port}", **BRIDGE)
        with pytest.raises(ProtocolError, match="proto=2 only") as caught:
            tracker.connect()
    assert (caught.value.code, caught.value.device) == (1003, "faro")
    assert "versions of MBP" in caught.value.what_to_do


@pytest.mark.parametrize("version", [1, 3])
def test_robot_program_of_another_version(version: int) -> None:
    main = [CALSRV_MAIN[0], (b"200 #", b"200 1 CAL %d 5 #\n" % version)]
    with ExpectedDevice(main) as device:
        robot = abb_arm(f"tcp://127.0.0.1:{device.port}")
        with pytest.raises(ProtocolError, match=f"program version {version}, needed 2") as caught:
            robot.connect()
    assert (caught.value.code, caught.value.device) == (1003, "abb")
    assert "Load CALSRV.mod" in caught.value.what_to_do


def test_controller_of_another_version() -> None:
    with ExpectedDevice([(b"\x00\x05V\x00\x02", b"\x00\x04V\x00")]) as device:
        robot = ur_arm(f"tcp://127.0.0.1:{device.port}")
        with pytest.raises(ProtocolError, match="version 2") as caught:
            robot.connect()
    assert (caught.value.code, caught.value.device) == (1003, "ur")
    assert "program version" in caught.value.what_to_do


# -- another robot than the cell file says -------------------------------------------------------------------


def cell_of(*, model: str = "abb-irb120", instrument: str = "faro") -> Cell:
    robot = {"model": model, "driver": "abb", "url": "tcp://127.0.0.1:1"}
    meter: dict[str, Any] = {"driver": instrument, "url": "tcp://127.0.0.1:2"}
    meter |= {"nominal_mm": BAR_MM} if instrument == "qc20w" else {"station_mm": [2400.0, -900.0, 350.0]}
    return cell_from(
        {
            "format": "truepose-cell/1",
            "name": "bench",
            "robot": robot,
            "instrument": meter,
            "world": {"nests": {"N1": [0, 0, 0], "N2": [600, 0, 0], "N3": [0, 600, 0]}},
            "tool": {"targets": {"T1": [0, 0, 125]}},
        },
        str(Path("bench.toml")),
    )


MODELS = {"abb": "abb-irb120", "fanuc": "fanuc-lrmate200ic", "ur": "ur5"}


@pytest.mark.parametrize("bench", MODELS)
def test_another_robot_than_the_cell_file_says(bench: str) -> None:
    with BENCHES[bench].cell() as cell:
        robot = BENCHES[bench].make(cell.url(BENCHES[bench].endpoint))
        robot.connect()
        who = robot.identify()
        robot.disconnect()
    check_identity(cell_of(model=MODELS[bench]), "robot", who)
    for other in {*MODELS.values(), "ur10"} - {MODELS[bench]}:
        with pytest.raises(OtherDevice) as caught:
            check_identity(cell_of(model=other), "robot", who)
        assert (caught.value.code, caught.value.exit_code, caught.value.device) == (6102, 2, "robot")
        assert other in caught.value.message
        assert "cell file" in caught.value.what_to_do


@pytest.mark.parametrize(
    ("name", "maker", "reported", "same"),
    [
        ("abb-irb120", "ABB", "IRB 120-3/0.6", True),
        ("abb-irb120", "ABB", "IRB120", True),
        ("abb-irb120", "ABB", "IRB 1200-5/0.9", False),
        ("abb-irb120", "ABB", "IRB 1520", False),
        ("fanuc-lrmate200ic", "FANUC", "LR Mate 200iC", True),
        ("fanuc-lrmate200ic", "FANUC", "LR Mate 200iD", False),
        ("ur5", "Universal Robots", "UR5", True),
        ("ur5", "Universal Robots", "UR5e", False),
        ("ur10", "Universal Robots", "UR5", False),
        ("ur10e", "Universal Robots", "UR10", False),
        ("abb-irb1200-5-0.9", "ABB", "IRB 1200-5/0.9", True),
        ("abb-irb1200-5-0.9", "ABB", "IRB 1200-7/0.7", False),
        ("abb-irb1600-10-1.45", "ABB", "IRB 1600-10/1.45", True),
        ("abb-irb1600-6-1.2", "ABB", "IRB 1600-6/1.45", False),
        ("fanuc-r2000ic-165f", "Fanuc", "R-2000iC/165F", True),
        ("fanuc-r2000ic-165f", "Fanuc", "R-2000iC/210F", False),
        ("fanuc-m20ia", "Fanuc", "M-20iA", True),
    ],
)
def test_how_makers_write_their_models(name: str, maker: str, reported: str, same: bool) -> None:
    assert is_model(name, maker, reported) is same


def test_silence_about_the_model_proves_nothing() -> None:
    check_identity(cell_of(model="fanuc-lrmate200ic"), "robot", Identity("Fanuc", "", "", "", "mappdk"))
    check_identity(cell_of(), "instrument", Identity("Example", "Still", "0", "0", "mbp1"))
    with pytest.raises(OtherDevice, match="Leica"):
        check_identity(cell_of(), "instrument", Identity("Leica Geosystems", "AT960", "1", "1", "mbp1"))

"""Findings of `truepose doctor` in sick cells, device by device.

Codes, exit codes, and the checks that are done in spite of a fault.
"""

from __future__ import annotations

import shutil
import sqlite3
from dataclasses import dataclass
from pathlib import Path

import pytest

from acquisition import Devices, open_devices
from acquisition.examination import CheckResult, Examination, examine
from acquisition.examination.finding import Chart
from acquisition.examination.meeting import ClockReading, examine_clock, rate_of
from drivers import FaroTracker, Identity, JointReading, RobotArm, RobotStatus
from mocks.faultproxy import FaultProxy
from tests.drivers.nobody import nobody_listens
from tests.service.benches import Bench, bench, faults, level_of

pytestmark = pytest.mark.usefixtures("impatience")


def test_a_device_that_is_gone_leaves_the_others_examined(faro: Bench) -> None:
    faro.rewrite(faro.simulators.url("abb"), "tcp://127.0.0.1:9")
    found = faro.examine()
    assert faults(found) == {("robot", "link"): (1002, "LinkLost")}
    assert found.exit_code == 4
    assert {each.check for each in found.findings if each.device == "instrument"} >= {
        "state",
        "weather",
        "clock",
    }
    faro.rewrite(faro.simulators.url("faro"), "tcp://127.0.0.1:9")
    assert set(faults(faro.examine())) == {("robot", "link"), ("instrument", "link")}


def test_another_robot_than_the_cell_file_says(tmp_path: Path) -> None:
    with bench("ur5_leica", tmp_path) as ur5:
        ur5.rewrite('model = "ur5"', 'model = "ur10"')
        found = ur5.examine()
    assert faults(found) == {
        ("robot", "model"): (6102, "OtherDevice"),
        ("robot", "geometry"): (6102, "OtherDevice"),  # the DH lengths of a UR5 are not those of a UR10
    }
    assert found.exit_code == 2


def test_another_makers_instrument(faro: Bench) -> None:
    faro.rewrite('driver = "faro"', 'driver = "leica"')
    found = faro.examine()
    assert faults(found) == {("instrument", "model"): (6102, "OtherDevice")}
    assert found.exit_code == 2


@pytest.mark.parametrize(
    ("order", "fields", "wanted", "code"),
    [
        ("mode", {"mode": "manual_full"}, {("robot", "mode"): (3004, "WrongMode")}, 4),
        ("mode", {"mode": "manual"}, {}, 0),  # at reduced speed, with the enabling device held
        ("motors", {"on": False}, {("robot", "motors"): (3004, "WrongMode")}, 4),
        ("supervise", {}, {("robot", "link"): (1001, "LinkTimeout")}, 4),
        ("tracker", {"state": "WARMING"}, {("instrument", "state"): (3005, "NotReady")}, 4),
        ("tracker", {"state": "ERROR"}, {("instrument", "state"): (3005, "NotReady")}, 4),
        ("tracker", {"state": "ESTOP"}, {("instrument", "state"): (4001, "EmergencyStop")}, 5),
    ],
)
def test_states(
    faro: Bench,
    order: str,
    fields: dict[str, object],
    wanted: dict[tuple[str, str], tuple[int, str]],
    code: int,
) -> None:
    faro.simulators.do(order, **fields)
    found = faro.examine()
    assert faults(found) == wanted
    assert found.exit_code == code


@pytest.mark.parametrize(
    ("told", "wanted", "code"),
    [
        ({}, {}, 0),
        ({"off_deg": 1.0}, {("robot", "details"): (1003, "ProtocolError")}, 4),
        ({"busy": True}, {("robot", "link"): (3002, "Busy")}, 4),
    ],
)
def test_the_second_channel_of_an_omnicore(
    told: dict[str, object], wanted: dict[tuple[str, str], tuple[int, str]], code: int, tmp_path: Path
) -> None:
    with bench("gofa_omnicore", tmp_path) as gofa:
        devices = open_devices(gofa.cell)
        if (
            "off_deg" in told
        ):  # from the second look on: a robot that is another one from the start is not connected
            connect = devices.robot.connect
            devices.robot.connect = lambda: (connect(), gofa.simulators.do("rws", **told))  # type: ignore[method-assign]
        else:
            gofa.simulators.do("rws", **told)
        found = gofa.examine(devices)
        shown = [each.found for each in found.findings if each.check == "second_channel"]
    assert faults(found) == wanted
    assert found.exit_code == code
    assert len(shown) == (not wanted)
    assert all("RobotWare 7" in each and "joints agree" in each for each in shown)


def test_a_certificate_that_nobody_compared_is_shown(tmp_path: Path) -> None:
    with bench("gofa_omnicore", tmp_path) as gofa:
        assert gofa.simulators.cell is not None
        pin = gofa.simulators.cell.rws.fingerprint
        gofa.rewrite(f"&fingerprint={pin}", "")
        file = tmp_path / "password"
        file.write_text("robotics\n", "utf-8")
        file.chmod(0o600)
        gofa.rewrite("~/.truepose/omnicore-password", str(file))
        gofa.rewrite('rws_user = "truepose"', 'rws_user = "Default User"')
        line = next(line for line in gofa.file.read_text("utf-8").splitlines() if "rws_fingerprint" in line)
        gofa.rewrite(line, "")
        found = gofa.examine()
        assert faults(found) == {("robot", "link"): (6000, "ConfigError")}
        assert any(pin in each.found for each in found.faults)
        gofa.rewrite("rws_user", f'rws_fingerprint = "{pin}"\nrws_user')
        assert not faults(gofa.examine())


def test_an_instrument_that_is_off_is_a_note(faro: Bench) -> None:
    faro.simulators.do("tracker", state="OFF")
    found = faro.examine()
    assert (found.exit_code, level_of(found, "instrument", "state")) == (0, "note")
    assert faro.simulators.do("state")["tracker"] == "OFF"  # and stays so


@pytest.mark.parametrize(
    ("order", "fields", "wanted", "code"),
    [
        ("supervise", {}, {("robot", "safety"): (4002, "ProtectiveStop")}, 5),
        ("ur_safety_mode", {"mode": 5}, {("robot", "safety"): (4003, "EnableLost")}, 5),
        ("estop", {}, {("robot", "safety"): (4001, "EmergencyStop")}, 5),
        ("motors", {"on": False}, {("robot", "program"): (3004, "WrongMode")}, 4),
    ],
)
def test_states_of_a_ur(
    tmp_path: Path,
    order: str,
    fields: dict[str, object],
    wanted: dict[tuple[str, str], tuple[int, str]],
    code: int,
) -> None:
    with bench("ur5_leica", tmp_path) as ur5:
        ur5.simulators.do(order, **fields)
        found = ur5.examine()
    assert faults(found) == wanted
    assert found.exit_code == code


@pytest.mark.parametrize(
    ("order", "fields", "wanted", "code"),
    [
        ("mode", {"mode": "manual"}, {("robot", "mode"): (3004, "WrongMode")}, 4),
        ("motors", {"on": False}, {("robot", "motors"): (3004, "WrongMode")}, 4),
        ("yaskawa", {"remote": False}, {("robot", "program"): (3004, "WrongMode")}, 4),
        ("yaskawa", {"hold": "pendant"}, {("robot", "program"): (3011, "ProgramNotReady")}, 4),
        ("yaskawa", {"alarm": [4315, "COLLISION"]}, {("robot", "safety"): (4002, "ProtectiveStop")}, 5),
        ("yaskawa", {"error": True}, {("robot", "safety"): (4002, "ProtectiveStop")}, 5),
    ],
)
def test_states_of_a_yaskawa(
    tmp_path: Path,
    order: str,
    fields: dict[str, object],
    wanted: dict[tuple[str, str], tuple[int, str]],
    code: int,
) -> None:
    with bench("gp7_faro", tmp_path) as gp7:
        gp7.simulators.do(order, **fields)
        found = gp7.examine()
    assert faults(found) == wanted
    assert found.exit_code == code


def test_speed_slider_and_clock_of_a_ur(tmp_path: Path) -> None:
    with bench("ur5_leica", tmp_path) as ur5:
        ur5.simulators.do("ur_speed_slider", fraction=0.3)
        found = ur5.examine()
    assert level_of(found, "robot", "speed") == "note"
    assert level_of(found, "robot", "clock") == "ok"
    assert level_of(found, "robot", "warm_up") == "ok"


def test_bar_and_battery(tmp_path: Path) -> None:
    with bench("lrmate_ballbar", tmp_path) as ballbar:
        ballbar.simulators.do("extend", nominal_mm=150.0)
        ballbar.simulators.do("battery", percent=12.0)
        found = ballbar.examine()
        assert faults(found) == {("instrument", "ballbar"): (3005, "NotReady")}
        assert level_of(found, "instrument", "battery") == "note"
        ballbar.simulators.do("battery", percent=3.0)
        assert ("instrument", "battery") in faults(ballbar.examine())
        ballbar.rewrite(ballbar.simulators.url("qc20w"), str(tmp_path / "rfcomm0"))
        found = ballbar.examine()
        assert faults(found) == {
            ("instrument", "link"): (1002, "LinkLost"),
            ("computer", "serial"): (1002, "LinkLost"),
        }


def test_an_alarm_of_a_fanuc(tmp_path: Path) -> None:
    with bench("lrmate_ballbar", tmp_path) as ballbar:
        ballbar.simulators.do("supervise")
        found = ballbar.examine()
    assert faults(found) == {("robot", "safety"): (4002, "ProtectiveStop")}


@pytest.mark.parametrize(
    ("order", "fields", "wanted"),
    [
        ("supervise", {}, {("robot", "program"): (3005, "NotReady")}),
        ("estop", {}, {("robot", "safety"): (4001, "EmergencyStop")}),
        ("mode", {"mode": "manual"}, {("robot", "mode"): (3004, "WrongMode")}),
    ],
)
def test_states_by_simple_message(
    tmp_path: Path, order: str, fields: dict[str, object], wanted: dict[tuple[str, str], tuple[int, str]]
) -> None:
    with bench("irb120_faro", tmp_path, "abb-simple") as simple:
        assert simple.examine().exit_code == 0
        simple.simulators.do(order, **fields)
        assert faults(simple.examine()) == wanted


def test_bodies_that_the_camera_does_not_know(tmp_path: Path) -> None:
    with bench("irb120_ctrack", tmp_path) as ctrack:
        ctrack.rewrite("T3 = [150.0", "T9 = [150.0")
        found = ctrack.examine()
    assert faults(found) == {("instrument", "bodies"): (6000, "ConfigError")}
    assert found.exit_code == 2


def test_a_joint_matrix_that_cannot_be_right(tmp_path: Path) -> None:
    """The robot reports a position outside its joint limits."""
    with bench("irb120_faro", tmp_path) as faro:
        assert faro.simulators.cell is not None
        arm = faro.simulators.cell.arm
        arm.put((0.0, 0.0, 90.0, 0.0, 0.0, 0.0))  # joint 3 ends at 70
        found = faro.examine()
        assert faults(found) == {("robot", "position"): (6102, "OtherDevice")}
        arm.put((120.0, 0.0, 0.0, 0.0, 0.0, 0.0))  # the robot can, the cell does not want to
        assert level_of(faro.examine(), "robot", "position") == "note"


def test_emscon_without_its_weather_station_tells_old_weather(tmp_path: Path) -> None:
    with bench("ur5_leica", tmp_path, instrument_driver="emscon") as emscon:
        assert emscon.examine().exit_code == 0
        emscon.simulators.do("weather", on=False)
        assert faults(emscon.examine()) == {("instrument", "weather"): (3005, "NotReady")}


def test_another_client_has_the_instrument(faro: Bench) -> None:
    other = FaroTracker(faro.simulators.url("faro"), heartbeat_s=None)
    other.connect()
    try:
        found = faro.examine()
    finally:
        other.disconnect()
    assert faults(found) == {("instrument", "link"): (3002, "Busy")}
    assert found.exit_code == 4


def test_unplugged_in_the_middle(faro: Bench) -> None:
    """No answers come after greeting and clock.

    Earlier findings stay, and the robot is examined.
    """
    with FaultProxy(faro.simulators.port("faro"), boundary=b"\n") as proxy:
        faro.rewrite(faro.simulators.url("faro"), f"tcp://127.0.0.1:{proxy.port}")
        proxy.spoil("close", after=2, times=None)
        found = faro.examine()
    assert faults(found) == {("instrument", "status"): (1002, "LinkLost")}
    assert level_of(found, "instrument", "identity") == "ok"
    assert level_of(found, "robot", "motion") == "ok"


def test_a_clock_that_stands(faro: Bench) -> None:
    """The simulator's clock is set back between the two looks."""
    heard: list[str] = []

    def tell(step: str) -> None:
        heard.append(step)
        if step == "instrument: clock" and heard.count(step) == 2:
            faro.simulators.do("clock_step", by_s=-3600)

    assert faults(faro.examine(progress=tell)) == {("instrument", "clock"): (1003, "ProtocolError")}


PORTS = {"realtime": -1, "secondary": -2, "primary": -3, "dashboard": -5}


def with_closed(ur: Bench, nobody: int, *closed: str) -> Examination:
    """Examine a UR, some of whose ports are not served."""
    first = ur.simulators.port("ur")
    ports = {name: nobody if name in closed else first + offset for name, offset in PORTS.items()}
    options = "&".join(f"{name}={port}" for name, port in ports.items())
    main = nobody if "rtde" in closed else first
    ur.rewrite(ur.simulators.url("ur"), f"tcp://127.0.0.1:{main}?{options}")
    return ur.examine()


def test_a_closed_port_ends_one_check_and_names_the_menu(tmp_path: Path) -> None:
    """A UR that sends its identity nowhere: all else can be asked."""
    with bench("ur5e_polyscopex", tmp_path, dialect="polyscope-5.11") as ur5e, nobody_listens() as closed:
        found = with_closed(ur5e, closed, "secondary", "primary")
    assert faults(found) == {("robot", "identity"): (1002, "LinkLost")}
    (fault,) = found.faults
    assert f"127.0.0.1:{closed}" in fault.found
    assert "port is closed" in fault.found
    assert "PolyScope 5.11" in fault.do
    assert "Settings > Security > Services" in fault.do
    assert "Secondary Client Interface" in fault.do
    assert "Cable and power are in order" in fault.do
    for check in ("safety", "motors", "warm_up", "position", "stop", "motion"):
        assert level_of(found, "robot", check) in ("ok", "note"), check
    services = next(each for each in found.notes if each.check == "services")
    assert "Secondary Client Interface, Primary Client Interface" in services.found


def test_a_robot_whose_main_ports_are_closed_still_tells_who_it_is(tmp_path: Path) -> None:
    with bench("ur5e_polyscopex", tmp_path, dialect="polyscope-5.11") as ur5e, nobody_listens() as closed:
        found = with_closed(ur5e, closed, "rtde", "realtime", "primary")
    assert faults(found) == {("robot", "link"): (1002, "LinkLost")}
    assert level_of(found, "robot", "model") == "ok"
    assert "Settings > Security > Services" in found.faults[0].do
    assert "enable Real-Time Data Exchange (RTDE) and Primary Client Interface" in found.faults[0].do


def test_rtde_closed_is_named_with_its_menu(tmp_path: Path) -> None:
    with bench("ur5e_polyscopex", tmp_path, dialect="polyscope-5.11") as ur5e, nobody_listens() as closed:
        found = with_closed(ur5e, closed, "rtde")
    assert found.faults == []
    wire = next(each for each in found.notes if each.check == "wire")
    assert "the port of RTDE is closed" in wire.found
    assert "Services" in wire.found


def test_polyscope_x_is_healthy_without_a_dashboard(tmp_path: Path) -> None:
    with bench("ur5e_polyscopex", tmp_path) as ur5e:
        found = ur5e.examine()
        assert found.faults == []
        assert level_of(found, "robot", "calibration") == "ok"
        assert {each.check for each in found.notes if each.device == "robot"} <= {
            "driver",
            "untold",
            "position",
        }
        ur5e.simulators.do("mode", mode="manual")
        found = ur5e.examine()
    assert faults(found) == {("robot", "program"): (3004, "WrongMode")}
    assert "safety overview" in found.faults[0].do


# -- a robot that tells little, or moves ---------------------------------------------------------------------


SILENT = RobotStatus("unknown", None, None, None)


@dataclass
class Taciturn:
    """A robot whose protocol tells only joints."""

    places: list[tuple[float, ...]]
    name: str = "taciturn"
    unverified_on_hardware: bool = False
    can_stop: bool = False
    reported: RobotStatus = SILENT

    def connect(self) -> None: ...
    def disconnect(self) -> None: ...
    def arm(self) -> None:
        raise AssertionError("armed")

    def disarm(self) -> None: ...
    def identify(self) -> Identity:
        return Identity("ABB", "", "", "", "words")

    def move_to(self, joints_deg: object) -> JointReading:
        raise AssertionError("moved")

    def position(self) -> JointReading:
        return JointReading(self.places.pop(0) if len(self.places) > 1 else self.places[0], 0.01)

    def stop(self) -> None:
        raise AssertionError("stopped")

    def status(self) -> RobotStatus:
        return self.reported


def with_robot(faro: Bench, robot: RobotArm) -> Examination:
    return faro.examine(Devices(robot, open_devices(faro.cell).instrument))


def test_silence_is_not_taken_for_good_news(faro: Bench) -> None:
    found = with_robot(faro, Taciturn([(0.0,) * 6]))
    of_robot = {each.check: each for each in found.findings if each.device == "robot"}
    assert of_robot["untold"].level == of_robot["model"].level == of_robot["stop"].level == "note"
    assert "mode, emergency stop, motors, clock" in of_robot["untold"].found
    assert "pendant" in of_robot["untold"].do
    assert not {"mode", "safety", "motors", "clock"} & set(of_robot)


def test_a_robot_that_moves_is_somebody_elses(faro: Bench) -> None:
    found = with_robot(faro, Taciturn([(0.0,) * 6, (1.0, *(0.0,) * 5)]))
    assert faults(found) == {("robot", "motion"): (3002, "Busy")}


def test_a_number_on_the_controllers_display(faro: Bench) -> None:
    found = with_robot(faro, Taciturn([(0.0,) * 6], reported=RobotStatus("auto", True, False, False, 50027)))
    assert level_of(found, "robot", "alarm") == "note"
    assert found.exit_code == 0


def test_a_robot_with_another_number_of_joints(faro: Bench) -> None:
    assert set(faults(with_robot(faro, Taciturn([(0.0,) * 7])))) == {("robot", "position")}


# -- clocks and the computer ---------------------------------------------------------------------------------


def clock(
    first: tuple[float, float, float], second: tuple[float, float, float], scale: float = 1.0
) -> CheckResult:
    chart = Chart("robot", lambda step: None)
    examine_clock(chart, ClockReading(*first, 1.8e9), ClockReading(*second, 1.8e9 + 0.5), scale)
    (found,) = chart.findings
    return found


def test_rate_and_its_uncertainty() -> None:
    """Two answers within 10 ms each leave 2 % of half a second uncertain."""
    first, second = ClockReading(100.0, 0.0, 0.01, 0.0), ClockReading(100.5, 0.5, 0.51, 0.0)
    rate, spread = rate_of(first, second)
    assert rate == pytest.approx(1.0)
    assert spread == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("second_s", "scale", "level"),
    [
        (100.5, 1.0, "ok"),
        (200.0, 200.0, "ok"),
        (200.0, 1.0, "note"),
        (100.25, 1.0, "note"),
        (100.0, 1.0, "fault"),
    ],
)
def test_clocks(second_s: float, scale: float, level: str) -> None:
    assert clock((100.0, 0.0, 0.001), (second_s, 0.5, 0.501), scale).level == level


def test_a_calendar_that_is_off() -> None:
    assert clock((1.8e9 + 60.0, 0.0, 0.001), (1.8e9 + 60.5, 0.5, 0.501)).found.startswith("+60.0 s")
    assert clock((1.8e9 + 1.0, 0.0, 0.001), (1.8e9 + 1.5, 0.5, 0.501)).level == "ok"


def test_room_for_the_record(faro: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cell = faro.cell
    found = examine(cell, open_devices(cell), record=tmp_path / "not" / "yet" / "there")
    assert level_of(found, "computer", "record") == "ok"
    assert list(tmp_path.iterdir()) == [faro.file]  # nothing was left behind
    found = examine(cell, open_devices(cell), record=faro.file)  # a file, no folder
    assert faults(found) == {("computer", "record"): (5000, "StorageError")}
    assert found.exit_code == 1
    full = shutil.disk_usage(tmp_path)._replace(free=10_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: full)
    found = faro.examine()
    assert faults(found) == {("computer", "record"): (5000, "StorageError")}
    assert "10 MB free" in found.faults[0].found


@pytest.mark.parametrize(("version", "level"), [((3, 51, 2), "note"), ((3, 51, 3), "ok")])
def test_sqlite(faro: Bench, monkeypatch: pytest.MonkeyPatch, version: tuple[int, ...], level: str) -> None:
    monkeypatch.setattr(sqlite3, "sqlite_version_info", version)
    assert level_of(faro.examine(), "computer", "sqlite") == level


@pytest.mark.parametrize(
    ("found", "code"),
    [([], 0), ([4], 4), ([4, 1], 4), ([4, 2], 2), ([2, 5, 4], 5), ([1], 1)],
)
def test_the_worst_fault_is_the_exit_code(found: list[int], code: int) -> None:
    findings = [CheckResult("robot", "x", "fault", "", exit_code=each) for each in found]
    assert Examination("cell", False, 1.0, findings).exit_code == code


# -- what a wire cannot see, and where weather is told -------------------------------------------------------------


def test_a_bridge_without_checksums_and_a_dialect_without_confirmation_are_named(tmp_path: Path) -> None:
    with bench("irb120_faro", tmp_path, robot_driver="abb-simple") as made:
        made.simulators.do("sums", on=False)
        found = made.examine()
    assert not found.faults
    wires = {each.device: each.found for each in found.notes if each.check == "wire"}
    assert "simple_message has no checksum" in wires["robot"]
    assert "the bridge sends no checksums" in wires["instrument"]


def test_nothing_is_said_of_wires_that_see_everything(faro: Bench) -> None:
    assert not [each for each in faro.examine().findings if each.check == "wire"]


@pytest.mark.parametrize("driver", ["faro", "leica"])
def test_weather_is_asked_for_where_status_lacks_it(tmp_path: Path, driver: str) -> None:
    """STATUS may report the state alone, as docs/bridge.md allows."""
    with bench("irb120_faro", tmp_path, instrument_driver=driver) as made:
        made.simulators.do("status_weather", on=False)
        found = made.examine()
        made.simulators.do("weather", on=False)
        without = made.examine()
    weather = [each for each in found.findings if each.check == "weather"]
    assert [(each.level, each.found[:3]) for each in weather] == [("ok", "air")]
    assert ("instrument", "weather") not in faults(found)
    assert ("instrument", "weather") in faults(without)

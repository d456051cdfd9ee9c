"""`truepose doctor` in a shell: healthy examples, a sick one, wrong files.

It must change nothing on the devices.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from acquisition import open_devices
from acquisition.run.orders.robot_lock import Mover
from service.cli import main
from tests.end_to_end.simulated import ROOT
from tests.service.benches import EXAMPLES, Bench, Requests, bench, faults, level_of

pytestmark = pytest.mark.usefixtures("impatience")
UNSEEN = {"manual": {"position", "motion", "state", "weather"}}
"""What nobody can ask of devices that a person works."""
KEYS = {"device", "check", "level", "found", "do", "code", "error"}


# -- healthy -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_is_healthy(example: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(ROOT / "examples" / example / "cell.toml")
    assert main(["doctor", file, "--simulate", "--record", str(tmp_path), "--json", "-"]) == 0
    shown = capsys.readouterr()
    document = json.loads(shown.out)  # and nothing else
    assert (document["format"], document["simulated"], document["healthy"]) == (
        "truepose-doctor/1",
        True,
        True,
    )
    assert "HEALTHY" in document["verdict"]
    assert {each["device"] for each in document["findings"]} == {"robot", "instrument", "computer"}
    assert all(set(each) == KEYS for each in document["findings"])
    assert {each["check"] for each in document["findings"]} >= {
        "link",
        "identity",
        "model",
        "driver",
        "position",
        "stop",
        "motion",
        "state",
        "weather",
        "clock",
        "sqlite",
        "record",
        "operator",
    } - UNSEEN.get(example, set())
    assert "robot: link" in shown.err
    assert "unverified" not in shown.err.lower()  # said in the table, once


def test_the_table_has_one_line_a_check_and_one_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(ROOT / "examples" / "irb120_faro" / "cell.toml")
    assert (
        main(["doctor", file, "--simulate", "--record", str(tmp_path), "--json", str(tmp_path / "d.json")])
        == 0
    )
    *lines, verdict = [text.rstrip() for text in capsys.readouterr().out.splitlines()]
    document = json.loads((tmp_path / "d.json").read_text("utf-8"))
    begun = [text for text in lines if re.match(r"(ok|note|FAULT) ", text)]
    assert len(begun) == len(document["findings"])
    assert sum("-> " in text for text in lines) == sum(bool(each["do"]) for each in document["findings"])
    assert verdict == document["verdict"]
    assert re.fullmatch(r"irb120-faro \(SIMULATED\): HEALTHY, \d notes; \d+ checks in \d\.\d s\.", verdict)
    assert not any("\x1b" in text for text in lines)


# -- sick ----------------------------------------------------------------------------------------------------


def test_two_faults_at_once(faro: Bench, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    faro.simulators.do("estop")
    faro.simulators.do("weather", on=False)
    assert (
        main(["doctor", str(faro.file), "--record", str(tmp_path), "--json", str(tmp_path / "d.json")]) == 5
    )
    shown = capsys.readouterr().out
    assert "emergency stop pressed [4001]" in shown
    assert "the weather station does not report air, pressure, humidity [3005]" in shown
    assert "UNSAFE, 2 faults: robot safety, instrument weather" in shown
    document = json.loads((tmp_path / "d.json").read_text("utf-8"))
    assert (document["exit_code"], document["healthy"]) == (5, False)
    assert {each["code"] for each in document["findings"] if each["level"] == "fault"} == {4001, 3005}


# -- it only looks -------------------------------------------------------------------------------------------


LOOKS = {
    "abb-rws": rb"GET /[\w/-]+",
    "abb(?!-rws)": rb"(0|4|98|200|202 \d+|205 \d+) #",
    "faro|leica|ctrack|qc20w": rb"\d+ (HELLO [^*]*|STATUS|PING|CAL|MODELS|BYE)\*\w{4}\n",
    "fanuc-rmi": rb'\{"(Communication": "FRC_(Connect|Disconnect)|Command": "FRC_(GetStatus|ReadJointAngles))"\}\r\n',
    "fanuc(?!-rmi)": rb"(curjpos|curpos|calname:\d+|calstat:\d+)\n",
    "yaskawa": rb"YERC.{20}[\x70-\x77\x89]\x00..\x00\x01\x00\x00",  # service 1 reads
    # RTDE packages V v O S P: versions, outputs, start, pause; the dashboard is asked for two things. PolyScope X is
    # asked by HTTP, and by a program that writes one line beside any other and can neither move nor set anything.
    "ur": rb"([\x00\x01].[VvOSP].*)|(get serial number|is in remote control)\n|GET /[a-z0-9/.]+ |"
    rb'sec truepose\(\):\n  textmsg\("truepose asks"\)\nend\n',
}


@pytest.mark.parametrize("example", EXAMPLES)
def test_nothing_is_armed_moved_or_set(example: str, tmp_path: Path) -> None:
    wire = Requests()
    with bench(example, tmp_path) as made:
        cell = made.cell
        before = made.simulators.do("state")
        found = made.examine(open_devices(cell, wire=wire))
        after = made.simulators.do("state")
    assert not found.faults
    wired = {each.driver for each in (cell.robot, cell.instrument) if not each.declared.by_hand}
    assert {name for name in wired for device, _ in wire.sent if device.startswith(name)} == wired
    for device, data in wire.sent:
        (form,) = (form for names, form in LOOKS.items() if re.match(names, device))
        assert re.fullmatch(form, data, re.DOTALL), (device, data)
    same = ("joints_deg", "mode", "motors_on", "emergency_stop", "tracker", "seated", "readings")
    assert {key: before[key] for key in same} == {key: after[key] for key in same}


def test_a_campaign_that_runs_is_left_in_peace(faro: Bench) -> None:
    wire = Requests()
    with Mover(faro.cell.robot.url):
        found = faro.examine(open_devices(faro.cell, wire=wire))
    assert faults(found) == {("robot", "lease"): (3106, "RobotInUse")}
    assert found.exit_code == 4
    assert wire.sent == []
    assert level_of(found, "instrument", "lease") == "note"
    with Mover(faro.cell.robot.url):  # and it was given back
        pass


# -- wrong command lines -------------------------------------------------------------------------------------


def test_wrong_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "cell.toml"
    assert main(["doctor", str(file)]) != 0
    file.write_text('format = "truepose-cell/1"\n', "utf-8")
    assert main(["doctor", str(file)]) == 2
    example = ROOT / "examples" / "irb120_faro" / "cell.toml"
    text = example.read_text("utf-8")
    file.write_text(text.replace("tcp://192.168.125.1:5000", "192.168.125.1"), "utf-8")
    assert main(["doctor", str(file)]) == 2
    assert main(["doctor", str(example), "--json", str(example)]) == 2
    assert "Traceback" not in capsys.readouterr().err
    assert example.read_text("utf-8") == text

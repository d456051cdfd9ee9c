"""Lock on the robot: one campaign at a time moves it, under every form of its address.

The same holds for every one of its addresses. These would catch: a lock on the text of the url, a lock that does not
know the robot behind a second address, and a lock that is kept after the campaign.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from acquisition import Run
from acquisition.errors import RobotInUse
from acquisition.run.orders import robot_lock as movers
from acquisition.run.orders.robot_lock import Mover
from drivers import ConfigError, Identity
from drivers.link import endpoints
from tests.acquisition.fakes import Bench, JumpingClock, SeatingOperator, a_campaign, a_cell, devices_of

ROOT = Path(__file__).parents[2]
HOLD = """
import sys
from acquisition.run.orders.robot_lock import Mover
with Mover(sys.argv[1]):
    print("held", flush=True)
    sys.stdin.readline()
"""


def test_a_robot_is_moved_by_one_program(tmp_path: Path) -> None:
    """The other program is killed: then the robot is free again, without anybody's help."""
    url = f"tcp://{tmp_path.name}:5000"
    with another(url) as other:
        with pytest.raises(RobotInUse, match="another campaign moves the robot"), Mover(url):
            pass
        with Mover(url + "1"):
            pass
        other.kill()
    with Mover(url):
        pass


def another(url: str, **options: Any) -> subprocess.Popen[Any]:
    """A program that holds the lock of a robot until its input closes."""
    other = subprocess.Popen(
        [sys.executable, "-c", HOLD, url], stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT, **options
    )
    assert other.stdout is not None
    assert other.stdout.readline() == b"held\n"
    return other


def test_who_holds_the_robot_is_told(tmp_path: Path) -> None:
    url = f"tcp://{tmp_path.name}:5002"
    with another(url) as other:
        with (
            pytest.raises(RobotInUse, match=rf"python.*, process {other.pid} of user {os.getuid()}\)"),
            Mover(url),
        ):
            pass
        other.communicate()


def test_a_service_that_sees_other_folders_locks_the_same_robot(tmp_path: Path) -> None:
    """The service has separate temporary files (`PrivateTmp`), permissions (`UMask`) and home."""
    url = f"tcp://{tmp_path.name}:5001"
    own = {"TMPDIR": str(tmp_path), "HOME": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    with another(url, env=os.environ | own, umask=0o077) as other:
        with pytest.raises(RobotInUse), Mover(url):
            pass
        other.communicate()


def test_the_lock_by_files_of_other_systems(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import_module("filelock")  # that of this system
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(movers, "_FOLDER", tmp_path / "locks")
    arm = Identity("ABB", "IRB 120", "", "1", "none")
    with Mover("tcp://10.1.1.1:5000") as lock:
        lock.met(arm)
        with pytest.raises(RobotInUse, match="another campaign"), Mover("tcp://10.1.1.1:5000"):
            pass
        for path in (tmp_path / "locks").iterdir():
            path.unlink()
        with pytest.raises(RobotInUse, match="taken away"):
            lock.met(arm)
    monkeypatch.setattr(movers, "_FOLDER", tmp_path / "a-file" / "locks")
    (tmp_path / "a-file").touch()
    with pytest.raises(RobotInUse, match="cannot be locked"), Mover("tcp://10.1.1.1:5000"):
        pass


PORT = 49_317  # no other test locks it


@pytest.mark.parametrize(
    "url",
    [
        f"tcp://localhost:{PORT}",
        f"tcp://LOCALHOST:{PORT}",
        f"tcp://127.0.0.1:{PORT}/",
        f"tcp://127.0.0.1:0{PORT}",
        f"TCP://127.0.0.1:{PORT}",
        f"tcp://127.0.0.1:{PORT}?background=5002",
        f"tcp://127.1:{PORT}",
        f"tcp://127.0.0.2:{PORT}",
        f"tcp://0.0.0.0:{PORT}",
        f"tcp://[::1]:{PORT}",
        f"tcp://[::ffff:127.0.0.1]:{PORT}",
    ],
)
def test_one_address_however_it_is_written(url: str) -> None:
    with Mover(f"tcp://127.0.0.1:{PORT}"):
        with pytest.raises(RobotInUse, match="moves the robot at"), Mover(url):
            pass
        with Mover(f"tcp://127.0.0.1:{PORT + 1}"):
            pass
    with Mover(url):
        pass


def test_a_name_with_several_addresses_is_each_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    def found(host: str, port: int, **_: Any) -> list[Any]:
        places = [("192.0.2.7", port), ("2001:db8::7", port, 0, 0)] if host == "arm.cell" else [(host, port)]
        return [(0, 0, 0, "", place) for place in places]

    monkeypatch.setattr(socket, "getaddrinfo", found)
    assert endpoints("tcp://arm.cell:5000") == {"192.0.2.7:5000", "2001:db8::7:5000"}
    with Mover("tcp://arm.cell:5000"), pytest.raises(RobotInUse), Mover("tcp://192.0.2.7:5000"):
        pass
    with Mover("tcp://192.0.2.7:5000"):
        with pytest.raises(RobotInUse), Mover("tcp://arm.cell:5000"):
            pass
        with Mover("tcp://[2001:db8::7]:5000"):  # what was locked before the refusal is free again
            pass


def test_a_serial_device_is_its_real_path_and_no_address_is_refused(tmp_path: Path) -> None:
    (tmp_path / "ttyUSB0").touch()
    (tmp_path / "by-id").symlink_to(tmp_path / "ttyUSB0")
    assert endpoints(str(tmp_path / "by-id")) == endpoints(str(tmp_path / "ttyUSB0"))
    with pytest.raises(ConfigError, match="no port"):
        endpoints("tcp://127.0.0.1")


def test_two_addresses_of_one_controller_are_one_robot() -> None:
    arm = Identity("ABB", "IRB 120", "120-500001", "6.08", "none")
    with mover("a") as first, mover("b") as second, mover("c") as third:
        first.met(arm)
        first.met(arm)  # after a reconnect
        with pytest.raises(RobotInUse, match="serial number 120-500001 "):
            second.met(Identity("abb", "IRB 120", "120-500001 ", "6.08", "superset"))
        second.met(Identity("ABB", "IRB 120", "120-777777", "6.08", "none"))
        third.met(Identity("ABB", "IRB 120", "", "", "none"))  # that proves nothing
    with mover("b") as second:
        second.met(arm)


@contextmanager
def mover(name: str) -> Iterator[Mover]:
    with Mover(f"tcp://{name}.test-mover.invalid:5000") as made:
        yield made


def test_a_run_does_not_arm_a_robot_that_another_moves(tmp_path: Path) -> None:
    """The other campaign reaches it by another address: only its serial number says so."""
    cell = a_cell(robot__url=f"tcp://{tmp_path.name}:5000")
    bench = Bench(cell)
    with Run.create(tmp_path / "r", cell, a_campaign()) as run, mover("other") as other:
        other.met(Identity("ABB", "IRB 120", "1", "1", "none"))  # as the fake arm says
        outcome = run.execute(devices_of(bench), JumpingClock())
        assert outcome.state.value == "paused"
        assert not [call for call in bench.log if call.startswith(("arm", "move"))]
        assert outcome.reason.startswith("another campaign moves the robot with the serial number 1 (")
    with Run.open(tmp_path / "r") as run:
        run.resume(by="anna")
        assert run.execute(devices_of(bench, SeatingOperator(bench)), JumpingClock()).exit_code == 0

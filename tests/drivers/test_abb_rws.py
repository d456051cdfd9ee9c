"""Test the second channel of the ABB driver on a simulated OmniCore.

Covered are its readings, refusals, stops and secrets.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import (
    ROBOTS,
    AbbArm,
    AbbDeadlines,
    Busy,
    CannotStop,
    CommandRefused,
    ConfigError,
    EmergencyStop,
    EnableLost,
    LinkError,
    LinkLost,
    LinkTimeout,
    MotionStopped,
    ProtocolError,
    WrongMode,
)
from drivers.abb.rws import parse_joints, texts_of
from drivers.errors import ProgramNotReady
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from tests.drivers.waiting import PATIENCE_S, in_thread, under_way, until

FAR = (90.0, 60.0, 30.0, 40.0, 50.0, 60.0)
NEAR = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
DEVICES = ("abb", "abb-rws")
PATIENT = AbbDeadlines(
    reply_s=30.0, ping_s=30.0, stop_s=30.0, rws_s=30.0, rws_every_s=0.005, rws_silent_s=30.0, rws_stop_s=30.0
)
HASTY = replace(PATIENT, rws_s=0.3, rws_silent_s=0.3, rws_stop_s=0.3)


@contextmanager
def omnicore(
    time_scale: float = 5000.0, *, stock: bool = False, old: bool = False, **options: Any
) -> Iterator[tuple[CellThread, AbbArm]]:
    """A simulated controller, and the driver that knows its address; not connected."""
    cell = CellThread(CellFile(time_scale=time_scale, effects=("none",)), stock=stock, devices=DEVICES)
    make = cell._make

    def made() -> Any:
        simulated = make()
        simulated.rws.old = old
        return simulated

    cell._make = made
    with cell:
        given: dict[str, Any] = {"deadlines": PATIENT, **options}
        arm = AbbArm(cell.url("abb"), **given)
        try:
            yield cell, arm
        finally:
            arm.disconnect()


def server(cell: CellThread) -> Any:
    assert cell.cell is not None
    return cell.cell.rws


def ready(arm: AbbArm) -> None:
    arm.connect()
    arm.arm()


def test_it_looks_in_one_session_and_ends_it() -> None:
    with omnicore() as (cell, arm):
        ready(arm)
        assert arm.move_to(NEAR).joints_deg == NEAR
        until(lambda: len(server(cell).asked) > 40)
        assert len(server(cell).sessions) == 1
        arm.disconnect()
        until(lambda: not server(cell).sessions)
        assert server(cell).asked[-1] == "GET /logout"


SEEN = {
    "manual": ({"mode": "MANR"}, WrongMode, "from mode auto to reduced"),
    "full speed": ({"mode": "MANF"}, WrongMode, "mode manual"),
    "being switched": ({"mode": "AUTO_CH"}, WrongMode, "mode manual"),
}


@pytest.mark.parametrize("stock", [False, True])
@pytest.mark.parametrize("what", SEEN)
def test_only_the_second_channel_sees_it_and_the_robot_is_stopped(what: str, stock: bool) -> None:
    told, kind, words = SEEN[what]
    with omnicore(1.0, stock=stock) as (cell, arm):
        ready(arm)
        move = under_way(arm, FAR, cell)
        cell.do("rws", **told)
        with pytest.raises(kind, match=words):
            move.result(PATIENCE_S)
        until(lambda: not cell.do("state")["moving"])
        assert max(cell.do("state")["joints_deg"]) < 80.0
        assert not arm._armed


@pytest.mark.parametrize(
    ("order", "kind"), [({"what": "estop"}, EmergencyStop), ({"what": "motors", "on": False}, EnableLost)]
)
def test_a_stock_program_that_cannot_tell_is_told_by_the_second_channel(
    order: dict[str, Any], kind: type[Exception]
) -> None:
    with omnicore(1.0, stock=True) as (cell, arm):
        ready(arm)
        move = under_way(arm, FAR, cell)
        cell.do(**order)
        with pytest.raises(kind):
            move.result(PATIENCE_S)


def test_a_program_that_was_stopped_on_the_pendant_is_seen_at_once() -> None:
    with omnicore(1.0) as (cell, arm):
        ready(arm)
        move = under_way(arm, FAR, cell)
        cell.do("supervise")
        with pytest.raises(ProgramNotReady) as caught:
            move.result(PATIENCE_S)
        assert "pointer" in caught.value.what_to_do
        arm.deadlines = replace(PATIENT, reply_s=0.3)
        with pytest.raises((LinkError, ProgramNotReady)):
            arm.arm()
        cell.do("restart")
        arm.deadlines = PATIENT
        ready(arm)


@pytest.mark.parametrize("order", [{"what": "estop"}, {"what": "mode", "mode": "manual_full"}])
def test_arming_is_refused(order: dict[str, Any]) -> None:
    with omnicore(stock=True) as (cell, arm):
        arm.connect()
        cell.do(**order)
        with pytest.raises((EmergencyStop, WrongMode)):
            arm.arm()


def test_joints_that_differ_at_rest_end_the_next_question() -> None:
    with omnicore() as (cell, arm):
        ready(arm)
        arm.move_to(NEAR)
        cell.do("rws", off_deg=0.5)
        until(lambda: arm.second is not None and arm.second.doubts)
        with pytest.raises(ProtocolError, match=r"0\.500 deg apart"):
            arm.position()
        moves = len(server(cell).arm.sent_to)
        with pytest.raises(ProtocolError, match="apart"):
            arm.move_to(FAR)
        assert len(server(cell).arm.sent_to) == moves
        with pytest.raises(ProtocolError, match="apart"):
            arm.connect()
        cell.do("rws", off_deg=0.01)  # a servo that holds, and rounding
        ready(arm)
        arm.move_to(FAR)


def test_a_robot_that_a_person_moved_is_no_difference() -> None:
    with omnicore() as (cell, arm):
        ready(arm)
        arm.move_to(NEAR)
        cell.do("jog", joints_deg=[2.0, 2.0, 3.0, 4.0, 5.0, 6.0])
        until(lambda: arm.second is not None and arm.second.doubts)
        assert arm.position().joints_deg[0] == 2.0
        arm.move_to(NEAR)


def test_a_silent_second_channel_delays_neither_robot_nor_stop_and_allows_no_further_move() -> None:
    with omnicore(1.0, deadlines=HASTY, speed_deg_s=5.0) as (cell, arm):
        ready(arm)
        move = under_way(arm, FAR, cell)
        cell.do("rws", silent=True)
        arm.stop()
        assert not cell.do("state")["moving"]
        with pytest.raises(MotionStopped):
            move.result(PATIENCE_S)
        with pytest.raises(LinkTimeout, match="rws_s"):
            arm.arm()
        cell.do("rws", silent=False)
        arm.deadlines = PATIENT
        ready(arm)
        arm.deadlines = HASTY
        cell.do("rws", silent=True)
        assert arm.second is not None
        until(lambda: arm.second is not None and arm.second._failure is not None)
        until(lambda: refused(arm))
        cell.do("rws", silent=False)


def refused(arm: AbbArm) -> bool:
    try:
        arm._armed = True
        arm._expect_both(arm.second)  # type: ignore[arg-type]
    except LinkTimeout:
        return True
    return False


@pytest.mark.parametrize("stock", [False, True])
def test_it_stops_the_program_where_the_robot_itself_cannot_be_stopped(
    stock: bool, caplog: pytest.LogCaptureFixture
) -> None:
    with omnicore(1.0, stock=stock, watchdog_s=PATIENCE_S) as (cell, arm):
        ready(arm)
        assert arm.can_stop
        move = under_way(arm, FAR, cell)
        if not stock:  # nobody answers on the background port any more
            arm._back.link.close()
            arm._back.link.address = replace(arm._back.link.address, port=1)
        with caplog.at_level(logging.WARNING):
            arm.stop()
        assert not cell.do("state")["moving"]
        assert max(cell.do("state")["joints_deg"]) < 80.0
        with pytest.raises((MotionStopped, LinkError, ProgramNotReady)):
            move.result(PATIENCE_S)
        assert "POST /rw/rapid/execution/stop" in server(cell).asked
        assert "pointer to main" in caplog.text


def test_a_stop_outlasts_a_server_that_is_busy() -> None:
    with omnicore(1.0, stock=True) as (cell, arm):
        ready(arm)
        move = under_way(arm, FAR, cell)
        cell.do("rws", busy=True)
        stopping = in_thread(arm.stop)
        until(lambda: arm.second is not None and isinstance(arm.second._failure, Busy))
        cell.do("rws", busy=False)
        stopping.result(PATIENCE_S)
        assert not cell.do("state")["moving"]
        with pytest.raises((MotionStopped, LinkError)):
            move.result(PATIENCE_S)
        cell.do("rws", busy=True)
        arm.deadlines = HASTY
        with pytest.raises(Busy):
            arm.stop()


def test_a_user_who_may_not_stop_is_told_so() -> None:
    with omnicore(1.0, stock=True) as (cell, arm):
        ready(arm)
        cell.do("rws", may_stop=False)
        with pytest.raises(CommandRefused) as caught:
            arm.stop()
        assert "right" in caught.value.what_to_do
    with omnicore(stock=True) as (cell, _):
        alone = AbbArm(cell.url("abb").partition("?")[0])
        alone.connect()
        with pytest.raises(CannotStop):
            alone.stop()
        alone.disconnect()


# -- who answers ------------------------------------------------------------------------------------------


def test_no_password_goes_to_a_controller_with_another_certificate() -> None:
    with omnicore() as (cell, arm):
        right = server(cell).fingerprint
        server(cell).renew()
        with pytest.raises(ProtocolError, match="another certificate") as caught:
            arm.connect()
        assert server(cell).fingerprint in caught.value.message
        assert server(cell).fingerprint != right
        assert not server(cell).sessions
        assert not server(cell).asked


def test_a_controller_that_closes_every_connection_is_not_asked_unseen() -> None:
    with omnicore() as (cell, arm):
        cell.do("rws", closes=True)
        ready(arm)
        assert arm.move_to(NEAR).joints_deg == NEAR
        server(cell).renew()
        until(lambda: isinstance(arm.second and arm.second._failure, ProtocolError))
        asked = len(server(cell).asked)
        before = arm.second and arm.second._failure
        until(lambda: arm.second is not None and arm.second._failure is not before)
        assert len(server(cell).asked) == asked


def test_a_certificate_that_changes_under_way_allows_no_further_move() -> None:
    with omnicore(deadlines=HASTY) as (cell, arm):
        arm.deadlines = PATIENT
        ready(arm)
        server(cell).renew()
        assert arm.second is not None
        assert arm.second._session is not None
        arm.second._session.abort()  # so that a new connection is made
        until(lambda: isinstance(arm.second and arm.second._failure, ProtocolError))
        arm.deadlines = HASTY
        until(lambda: arm.second is not None and silent(arm))


def silent(arm: AbbArm) -> bool:
    try:
        arm._armed = True
        arm.move_to(NEAR)
    except ProtocolError as error:
        return "certificate" in error.message
    return False


def test_a_certificate_that_is_not_pinned_is_shown_and_not_believed() -> None:
    with omnicore() as (cell, _):
        address = cell.url("abb").partition("&")[0]
        arm = AbbArm(address)
        with pytest.raises(ConfigError, match=server(cell).fingerprint) as caught:
            arm.connect()
        assert "rws_fingerprint" in caught.value.what_to_do
        assert not server(cell).asked


def test_the_old_dialect_is_named() -> None:
    with omnicore(old=True) as (_, arm), pytest.raises(ProtocolError, match="RobotWare 6") as caught:
        arm.connect()
    assert "leave rws out" in caught.value.what_to_do


@pytest.mark.parametrize(
    ("order", "kind", "words"),
    [
        ({"busy": True}, Busy, "no free session"),
        ({"version_of_json": "3.0"}, ProtocolError, "does not answer in"),
    ],
)
def test_refusals_of_the_web_server(order: dict[str, Any], kind: type[Exception], words: str) -> None:
    with omnicore() as (cell, arm):
        cell.do("rws", **order)
        with pytest.raises(kind, match=words):
            arm.connect()


def test_seventy_sessions_are_all() -> None:
    with omnicore() as (cell, arm):
        server(cell).sessions.update({str(i): float("inf") for i in range(69)})
        ready(arm)
        other = AbbArm(cell.url("abb"), deadlines=PATIENT)
        here = arm.position().joints_deg
        assert other.second is not None
        with pytest.raises(Busy):
            other.second.connect(here)
        server(cell).sessions.pop("0")
        other.second.connect(here)
        other.second.disconnect()


def test_nobody_listens_there() -> None:
    with omnicore() as (cell, _):
        port = cell.port("abb-rws")
        arm = AbbArm(cell.url("abb").replace(f"rws={port}", "rws=1"))
        with pytest.raises(LinkLost, match="not reachable") as caught:
            arm.connect()
        assert caught.value.device == "abb-rws"


def test_a_word_that_comes_byte_by_byte_ends_within_its_deadline() -> None:
    with omnicore() as (cell, arm):
        ready(arm)
        cell.do("rws", silent=True)
        session = arm.second._session if arm.second else None
        assert session is not None
        other = arm.second._new_session(session.access) if arm.second else None
        assert other is not None
        other.limit_s = 0.1
        with pytest.raises(LinkTimeout, match=r"rws_s = 0\.1 s"):
            other.version()
        cell.do("rws", silent=False)


# -- cell file and secrets --------------------------------------------------------------------------------


def test_the_password_stays_in_its_file(tmp_path: Path) -> None:
    file = tmp_path / "password"
    file.write_text("hunter4711\n", encoding="utf-8")
    file.chmod(0o600)

    said: list[bytes] = []

    class WireRecorder:
        def record(self, device: str, direction: str, data: bytes) -> None:
            said.append(data)

    with omnicore() as (cell, _):
        server(cell).users["truepose"] = "hunter4711"
        url, _, pin = cell.url("abb").partition("&fingerprint=")
        arm = AbbArm(
            url,
            rws_fingerprint=":".join(pin[i : i + 2].upper() for i in range(0, 64, 2)),
            rws_user="truepose",
            rws_password_file=str(file),
            wire=WireRecorder(),
        )
        arm.connect()
        arm.disconnect()
        server(cell).users["truepose"] = "other"
        with pytest.raises(ConfigError, match="truepose") as caught:
            arm.connect()
        whole = b"".join(said) + repr([arm.second.__dict__ if arm.second else ""]).encode()
        whole += json.dumps(caught.value.as_dict()).encode()
    assert b"GET /rw/panel/ctrl-state" in whole
    assert b"hunter4711" not in whole
    assert b"dHJ1ZXBvc2U6" not in whole  # "truepose:" in base64


def test_a_password_that_others_can_read_is_not_used(tmp_path: Path) -> None:
    file = tmp_path / "password"
    file.write_text("secret\n", encoding="utf-8")
    file.chmod(0o644)
    with omnicore() as (cell, _):
        url, _, pin = cell.url("abb").partition("&fingerprint=")
        for path, words in ((file, "by other users"), (tmp_path / "none", "cannot be read")):
            arm = AbbArm(url, rws_fingerprint=pin, rws_password_file=str(path))
            with pytest.raises(ConfigError, match=words):
                arm.connect()
        file.chmod(0o600)
        file.write_text("\n", encoding="utf-8")
        with pytest.raises(ConfigError, match="empty"):
            AbbArm(url, rws_fingerprint=pin, rws_password_file=str(file)).connect()


@pytest.mark.parametrize(
    ("query", "options", "words"),
    [
        ("", {"rws_fingerprint": "0" * 64}, "no port"),
        ("", {"rws_user": "anna"}, "no port"),
        ("?rws=443", {"rws_fingerprint": "0" * 63}, "SHA-256"),
        ("?rws=web", {}, "not a port"),
    ],
)
def test_a_wrong_cell_file_is_refused_before_anything_is_opened(
    query: str, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        AbbArm(f"tcp://192.168.125.1:5000{query}", **options)


def test_a_simulator_gets_no_password_of_the_cell_file() -> None:
    """`--simulate` replaces the address, keeps the keys, and needs no password file."""
    with omnicore(rws_fingerprint="0" * 64, rws_user="anna", rws_password_file="/none") as (_, arm):
        arm.connect()
        assert arm.second is not None
        assert arm.second._session is not None
        assert arm.second._session.access.user == "Default User"


def test_doctor_reads_what_the_second_channel_says() -> None:
    with omnicore() as (cell, arm):
        arm.connect()
        told = ROBOTS["abb"].details(arm, arm.status()).second_channel
        assert "7.13.0+294" in told
        assert "program runs" in told
        cell.do("rws", off_deg=1.0)
        with pytest.raises(ProtocolError, match="apart"):
            ROBOTS["abb"].details(arm, arm.status())
        alone = AbbArm(cell.url("abb").partition("?")[0])
        assert ROBOTS["abb"].details(alone, arm.status()).second_channel == ""


def test_connecting_again_leaves_one_thread() -> None:
    with omnicore() as (cell, arm):
        ready(arm)
        connecting = [in_thread(arm.connect) for _ in range(3)]
        for each in connecting:
            each.result(PATIENCE_S)
        until(lambda: len(server(cell).sessions) == 1)


# -- answers ----------------------------------------------------------------------------------------------

# As recorded of RobotWare 7.21 (abb-rws-client, tests/RwsClient2.haljson.test.ts), with other joints.
RECORDED = (
    b'{ "_links" : { "base" : { "href" : "https://127.0.0.1:5466/rw/motionsystem/mechunits/ROB_1/jointtarget/" }, '
    b'"self" : { "href" : "" } } ,"status" : {"code":294912} , "state" : [ { "_type" : "ms-jointtarget", "_title" : '
    b'"ROB_1", "rax_1" : "10", "rax_2" : "15.5", "rax_3" : "-10", "rax_4" : "2E-05", "rax_5" : "30", "rax_6" : "45", '
    b'"eax_a" : "9E+09", "eax_b" : "0", "eax_c" : "0", "eax_d" : "0", "eax_e" : "0", "eax_f" : "0" } ]}'
)


def test_an_answer_of_a_real_controller_is_understood() -> None:
    assert parse_joints(RECORDED) == (10.0, 15.5, -10.0, 2e-05, 30.0, 45.0)


@pytest.mark.parametrize(
    ("good", "bad"),
    [
        (b'"10"', b"10"),
        (b'"10"', b'"nan"'),
        (b'"10"', b'"9E+09"'),
        (b"ms-jointtarget", b"ms-robtarget"),
        (b'"rax_6"', b'"rax_7"'),
        (b"]}", b""),
    ],
)
def test_an_answer_that_is_none(good: bytes, bad: bytes) -> None:
    with pytest.raises(ProtocolError):
        parse_joints(RECORDED.replace(good, bad, 1))


@given(st.binary(max_size=200) | st.binary(max_size=8).map(lambda part: RECORDED.replace(b"10", part)))
def test_any_answer_of_the_web_server(raw: bytes) -> None:
    for parse in (parse_joints, lambda raw: texts_of(raw, "pnl-opmode", "opmode")):
        try:
            parse(raw)
        except ProtocolError:
            continue

"""Test the Fanuc driver over RMI: numbers, hold, faults, sessions, versions, cuts."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from drivers import (
    AcquisitionError,
    Busy,
    CommandRefused,
    FanucArm,
    FanucDeadlines,
    LinkError,
    LinkLost,
    LinkTimeout,
    MotionStopped,
    NotArmed,
    NotReady,
    ProtectiveStop,
    WireLog,
    WrongMode,
    open_robot,
)
from drivers.fanuc.declaration import DRIVERS
from drivers.fanuc.rmi_link import refusal
from mocks.cell import CellThread
from mocks.fanuc.rmi import RmiServer
from mocks.faultproxy import FaultProxy
from tests.drivers.fanuc_cells import FAR, FAST, QUICK, SLOW
from tests.drivers.waiting import PATIENCE_S, under_way, until

POSE = (12.5, 20.0, -31.25, 40.0, -45.0, 60.1234)
PATIENT = replace(QUICK, takeover_s=30.0, abort_s=30.0)


def arm_of(cell: CellThread, options: str = "", **arguments: Any) -> Any:
    return open_robot("fanuc-rmi", cell.url("fanuc-rmi") + options, **({"deadlines": PATIENT} | arguments))


@contextmanager
def served(*, slow: bool = False, options: str = "", **arguments: Any) -> Iterator[tuple[CellThread, Any]]:
    """A simulated cell and its driver, connected."""
    with CellThread(SLOW if slow else FAST, devices=("fanuc-rmi",)) as cell:
        arm = arm_of(cell, options, **arguments)
        try:
            arm.connect()
            yield cell, arm
        finally:
            arm.disconnect()


@contextmanager
def proxied(**arguments: Any) -> Iterator[tuple[CellThread, FaultProxy, Any]]:
    """A slow cell, a proxy before its session, and the driver, connected."""
    with (
        CellThread(SLOW, devices=("fanuc-rmi",)) as cell,
        FaultProxy(cell.port("fanuc-rmi-session"), boundary=b"\n") as proxy,
    ):
        arm = arm_of(cell, f"?session={proxy.port}", **arguments)
        try:
            arm.connect()
            yield cell, proxy, arm
        finally:
            arm.disconnect()


def rmi_of(cell: CellThread) -> RmiServer:
    assert cell.cell is not None
    return cell.cell.fanuc.rmi


def sent(log: io.StringIO) -> list[dict[str, Any]]:
    """Packets that went to the controller."""
    rows = map(json.loads, log.getvalue().splitlines())
    return [json.loads(row["data"]) for row in rows if row["dir"] == ">"]


# -- joints ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("remote", "stream_3"),
    [  # measured on a CRX-10iA: airo-ugent/airo-fanuc, docs/controller-notes.md, 1.5
        ((92.678, 2.595, -3.975, -45.464, -27.230, -11.037), -1.380),
        ((0.0, 11.695, -3.934, 0.0, 0.0, 0.0), 7.761),
        ((0.0, 36.692, -28.935, 0.0, 0.0, 0.0), 7.757),
    ],
)
def test_joint_3_counts_from_the_horizontal(remote: tuple[float, ...], stream_3: float) -> None:
    """The maker's stream interface has J3 + J2, which is minus the joint of the model."""
    with served() as (cell, arm):
        arm.arm()
        assert arm.move_to(remote).joints_deg == pytest.approx(remote, abs=0.0006)
        assert cell.do("state")["joints_deg"][2] == pytest.approx(-stream_3, abs=0.0006)


def test_joints_that_the_controller_does_not_renew_are_no_reading() -> None:
    with served(deadlines=replace(PATIENT, reply_s=0.2)) as (cell, arm):
        rmi_of(cell)._time_tag = lambda: 7  # type: ignore[method-assign]
        with pytest.raises(LinkError, match="does not renew"):
            arm.position()


# -- instructions ----------------------------------------------------------------------------------------------


def test_motions_are_numbered_from_one_end_fine_and_come_one_at_a_time() -> None:
    log = io.StringIO()
    with served(wire=WireLog(log)) as (_, arm):
        arm.arm()
        for j1 in (1.0, 2.0, 3.0):
            arm.move_to((j1, *POSE[1:]))
    motions = [packet for packet in sent(log) if "Instruction" in packet]
    assert [packet["SequenceID"] for packet in motions] == [1, 2, 3]
    assert {(packet["Instruction"], packet["TermType"], packet["SpeedType"]) for packet in motions} == {
        ("FRC_JointMotionJRep", "FINE", "Percent")
    }
    assert motions[-1]["JointAngle"] == {f"J{i}": q for i, q in enumerate((3.0, *POSE[1:]), start=1)}
    names = [packet.get("Command") for packet in sent(log)]
    assert names.count("FRC_Initialize") == 1
    assert all(one != two for one, two in pairwise(names) if one)  # answers have no number


def test_nothing_but_questions_before_arming() -> None:
    log = io.StringIO()
    with served(wire=WireLog(log)) as (cell, arm):
        arm.status()
        arm.position()
        arm.identify()
        with pytest.raises(NotArmed):
            arm.move_to(POSE)
        assert not rmi_of(cell).running
    assert {packet.get("Command", packet.get("Communication")) for packet in sent(log)} == {
        "FRC_Connect",
        "FRC_GetStatus",
        "FRC_ReadJointAngles",
        "FRC_Disconnect",
    }


def test_a_count_that_goes_on_after_initialize_is_taken_from_the_status() -> None:
    with served() as (cell, arm):
        rmi = rmi_of(cell)
        rmi.keeps_numbers, rmi.expected = True, 42
        arm.arm()
        arm.move_to(POSE)
        assert rmi.expected == 43


def test_hold_after_a_number_out_of_sequence_is_left_by_reset() -> None:
    log = io.StringIO()
    with served(wire=WireLog(log)) as (cell, arm):
        arm.arm()
        rmi_of(cell).expected = 5
        with pytest.raises(CommandRefused, match="RMIT-029"):
            arm.move_to(POSE)
        with pytest.raises(NotArmed):
            arm.move_to(POSE)
        assert rmi_of(cell).hold
        assert "FRC_Reset" not in {
            packet.get("Command") for packet in sent(log)
        }  # only as a person arms again
        arm.arm()
        arm.move_to(POSE)
        assert not rmi_of(cell).hold


def test_hold_that_another_program_left_behind_is_left_by_reset() -> None:
    with served() as (cell, arm):
        rmi_of(cell).hold = True
        arm.arm()
        arm.move_to(POSE)


def test_an_instruction_sent_twice_is_refused_and_the_motion_aborted() -> None:
    with proxied(speed_deg_s=4.0) as (cell, proxy, arm):
        arm.arm()
        begin = arm._controller._link.begin

        def twice(*arguments: Any) -> None:
            proxy.spoil("request_duplicate", times=1)
            begin(*arguments)

        arm._controller._link.begin = twice
        with pytest.raises(AcquisitionError):
            arm.move_to(FAR)
        assert not cell.do("state")["moving"]


def test_a_slow_override_does_not_end_a_move() -> None:
    """The deadline holds for full speed; at 10 % a motion takes ten times as long."""
    deadlines = replace(PATIENT, move_factor=1.0, move_margin_s=0.5)
    with served(slow=True, deadlines=deadlines) as (cell, arm):
        rmi_of(cell).override = 10
        arm.arm()
        arm.move_to((2.0, 0.0, 0.0, 0.0, 0.0, 0.0))


def test_a_robot_off_its_way_is_stopped() -> None:
    """The target that arrived is another one: joint 2 turns, which should rest."""
    with served(slow=True, speed_deg_s=10.0) as (cell, arm):
        arm.arm()
        begin = arm._controller._link.begin
        arm._controller._link.begin = lambda number, move: begin(
            number, replace(move, target=(40.0, -40.0, 0.0, 0.0, 0.0, 0.0))
        )
        with pytest.raises(ProtectiveStop, match="off the way"):
            arm.move_to((40.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        state = cell.do("state")
        assert not state["moving"]
        assert state["joints_deg"][1] > -30.0
        with pytest.raises(NotArmed):
            arm.move_to(POSE)


# -- what comes without a question ------------------------------------------------------------------------------


def test_a_fault_during_a_move_ends_it() -> None:
    with served(slow=True, speed_deg_s=4.0) as (cell, arm):
        arm.arm()
        move = under_way(arm, FAR, cell)
        cell.do("rmi_push", packet={"Communication": "FRC_SystemFault", "SequenceID": 1})
        with pytest.raises(ProtectiveStop, match="FRC_SystemFault"):
            move.result(PATIENCE_S)
        assert not cell.do("state")["moving"]


def test_a_session_that_the_controller_ends_is_lost_and_another_begins() -> None:
    with served() as (cell, arm):
        arm.arm()
        cell.do("rmi_push", packet={"Communication": "FRC_Terminate"})
        with pytest.raises(LinkLost, match="ended the session"):
            arm.position()
        arm.connect()
        arm.arm()
        arm.move_to(POSE)


def test_an_answer_to_no_motion_closes_the_session() -> None:
    with served() as (cell, arm):
        cell.do("rmi_push", packet={"Instruction": "FRC_JointMotionJRep", "ErrorID": 0, "SequenceID": 1})
        with pytest.raises(LinkError, match="no motion under way"):
            arm.position()


# -- sessions ---------------------------------------------------------------------------------------------------


def test_a_second_program_is_refused() -> None:
    with served() as (cell, _):
        with pytest.raises(Busy, match="another program") as caught:
            arm_of(cell, deadlines=replace(PATIENT, takeover_s=0.1)).connect()
        assert caught.value.device == "fanuc-rmi"
        rmi_of(cell).second = "silent"  # as a CRX-10iA does
        with pytest.raises(LinkTimeout) as silent:
            arm_of(cell, deadlines=replace(PATIENT, reply_s=0.2)).connect()
        assert "no other program" in silent.value.what_to_do


def unreachable() -> None:
    raise LinkLost("no network")


@contextmanager
def cut(*, deadlines: FanucDeadlines = PATIENT) -> Iterator[tuple[CellThread, FanucArm]]:
    """A driver whose session was cut during a motion, which continues."""
    with CellThread(SLOW, devices=("fanuc-rmi",)) as cell:
        arm = arm_of(cell, speed_deg_s=4.0, deadlines=deadlines)
        arm.connect()
        arm.arm()
        move, link = under_way(arm, FAR, cell), arm._controller._link
        enter, link.open = link.open, unreachable
        link.close()
        with pytest.raises(LinkLost):
            move.result(PATIENCE_S)
        link.open = enter
        assert cell.do("state")["moving"]
        assert rmi_of(cell).running
        yield cell, arm
        arm.disconnect()


def test_a_motion_whose_connection_breaks_is_aborted_in_a_new_session() -> None:
    with served(slow=True, speed_deg_s=4.0) as (cell, arm):
        arm.arm()
        move = under_way(arm, FAR, cell)
        arm._controller._link.close()
        with pytest.raises(LinkLost):
            move.result(PATIENCE_S)
        assert not cell.do("state")["moving"]
        with pytest.raises(LinkLost):
            arm.position()
        arm.connect()
        arm.arm()
        arm.move_to((0.0,) * 6)


def test_a_motion_that_a_cut_has_left_running_is_aborted_on_reconnecting() -> None:
    with cut() as (cell, arm):
        sent_to = len(_targets(cell))
        with pytest.raises(LinkError):
            arm.move_to(FAR) if arm._armed else arm.position()
        arm.connect()
        assert not cell.do("state")["moving"]
        with pytest.raises(NotArmed):
            arm.move_to(FAR)
        assert len(_targets(cell)) == sent_to
        arm.arm()
        arm.move_to((0.0,) * 6)


def test_another_program_finds_a_motion_running_and_leaves_no_session_that_moves() -> None:
    with cut() as (cell, _):
        other = arm_of(cell, deadlines=replace(PATIENT, settle_s=0.1, gap_s=0.05))
        with pytest.raises(Busy, match="still moving"):
            other.connect()
        assert not cell.do("state")["moving"]  # FRC_Disconnect aborts RMI_MOVE


def test_another_program_can_stop_a_motion_without_arming() -> None:
    with cut() as (cell, _):
        other = arm_of(cell)
        other.stop()
        assert not cell.do("state")["moving"]
        other.connect()
        other.arm()
        other.disconnect()


def test_arming_aborts_what_remote_motion_still_does_before_anything_else() -> None:
    log = io.StringIO()
    with cut() as (cell, _):
        other = arm_of(cell, wire=WireLog(log))
        other._controller.open()
        other.arm()
        assert not cell.do("state")["moving"]
        other.disconnect()
    names = [packet.get("Command") for packet in sent(log)]
    assert names.index("FRC_Abort") < names.index("FRC_Initialize")


def test_disconnecting_during_a_move_aborts_it() -> None:
    with served(slow=True, speed_deg_s=4.0) as (cell, arm):
        arm.arm()
        move = under_way(arm, FAR, cell)
        arm.disconnect()
        with pytest.raises((LinkError, MotionStopped)):
            move.result(PATIENCE_S)
        assert not cell.do("state")["moving"]
        assert not rmi_of(cell).running


def test_stop_of_a_session_that_answers_nothing_is_sent_in_a_new_one() -> None:
    with proxied(speed_deg_s=4.0, deadlines=replace(PATIENT, reply_s=1.0)) as (cell, proxy, arm):
        arm.arm()
        move = under_way(arm, FAR, cell)
        proxy.spoil("black_hole", times=1)
        until(lambda: proxy.spoiled == 1)
        proxy.heal()
        arm.stop()
        with pytest.raises((LinkError, MotionStopped)):
            move.result(PATIENCE_S)
        assert not cell.do("state")["moving"]


# -- controllers that do not start remote motion ------------------------------------------------------------------


def test_rmi_move_selected_on_the_pendant() -> None:
    with served() as (cell, arm):
        rmi_of(cell).selected = True
        with pytest.raises(NotReady, match="RMI_MOVE") as caught:
            arm.arm()
        assert "Select another program" in caught.value.what_to_do


def test_single_step_mode() -> None:
    with served() as (cell, arm):
        rmi_of(cell).single_step = True
        with pytest.raises(WrongMode, match="single step"):
            arm.arm()
        assert not rmi_of(cell).running


def test_an_older_version_moves_and_says_what_its_joints_are() -> None:
    with CellThread(FAST, devices=("fanuc-rmi",)) as cell:
        rmi_of(cell).version, rmi_of(cell).checks_numbers = (5, 2), False
        arm = arm_of(cell)
        arm.connect()
        assert arm.identify().firmware == "RMI 5.2"
        assert "commanded" in arm.weakness
        arm.arm()
        arm.move_to(POSE)
        rmi_of(cell).hold = True
        with pytest.raises(AcquisitionError):
            arm.move_to(FAR)
        with pytest.raises(CommandRefused, match="unknown packet"):  # it has no FRC_Reset
            arm.arm()
        arm.disconnect()
        rmi_of(cell).version = (6, 0)
        arm.connect()
        assert "commanded" not in arm.weakness
        arm.disconnect()


@pytest.mark.parametrize(
    ("number", "kind"),
    [(7, WrongMode), (8, WrongMode), (16, NotReady), (27, Busy), (30, CommandRefused), (0, CommandRefused)],
)
def test_refusals_have_their_classes(number: int, kind: type[AcquisitionError]) -> None:
    assert isinstance(refusal(2556928 + number, "robot", "arm"), kind)


def test_the_override_is_a_detail() -> None:
    (declared,) = (each for each in DRIVERS if each.name == "fanuc-rmi")
    with served() as (cell, arm):
        rmi_of(cell).override = 30
        assert declared.details(arm, arm.status()).speed_share == 0.3


def _targets(cell: CellThread) -> list[tuple[float, ...]]:
    assert cell.cell is not None
    return cell.cell.arm.sent_to

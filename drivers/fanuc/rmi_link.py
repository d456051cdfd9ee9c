"""A session with the Remote Motion Interface (RMI) of a Fanuc, option R912.

A packet is one JSON object with CR LF. `FRC_Connect` on TCP 16001 is answered with the port of the session and the
version of RMI, and that connection ends; there is one session at a time. Kinds of packets by their first key:

- `Command`: answered at once, with its own name and an `ErrorID`, 0 if it was carried out.
- `Instruction`: numbered, joins the TP program RMI_MOVE, and is answered when the robot has carried it out, with name,
  `ErrorID` and `SequenceID`. Commands are answered meanwhile.
- `Communication`: of the session. `FRC_SystemFault` and `FRC_Terminate` come without a question.

An answer to a command has neither number nor checksum. Two commands in a row therefore always differ: a late, doubled
or older answer then has the wrong name and closes the session. A command must be answered before the next is sent
(RMIT-027).

Sources:

- packet definitions of the maker's ROS 2 driver after the operator's manual B-84184EN/03, in
  FANUC-CORPORATION/fanuc_driver, `rmi/packets.hpp` and `rmi.cpp`
- vertec-io/Fanuc_RMI_API
- answers of a CRX-10iA in airo-ugent/airo-fanuc, `docs/controller-notes.md`
"""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Collection, Mapping
from typing import Any

from drivers.errors import (
    AcquisitionError,
    Busy,
    CommandRefused,
    JointLimit,
    LinkLost,
    LinkTimeout,
    MotionStopped,
    ProgramNotReady,
    ProtocolError,
    WrongMode,
)
from drivers.fanuc.controller import FanucDeadlines, JointMove
from drivers.link import TcpLink, beside

Packet = Mapping[str, Any]

STATUS, JOINTS_READ = "FRC_GetStatus", "FRC_ReadJointAngles"
MOTION = "FRC_JointMotionJRep"
_LONGEST = 4096  # five error texts and their keys are below 1000
_THERE_S = 0.001  # to look whether something has come
_RETRY_S = 0.05
_RMIT = 2556928  # ErrorID of RMIT-000
_CONNECTED, HOLD, SEQUENCE = _RMIT + 26, _RMIT + 24, _RMIT + 29

# Classes of RMIT numbers; all others are CommandRefused.
_CLASSES: dict[int, tuple[type[AcquisitionError], str]] = {
    6: (ProgramNotReady, "cannot run its TP program"),
    7: (WrongMode, "servo power is off"),
    8: (WrongMode, "cannot run its TP program: the teach pendant is enabled"),
    9: (ProgramNotReady, "remote motion does not run"),
    13: (CommandRefused, "unknown packet"),
    15: (ProgramNotReady, "remote motion is in a state that does not allow this"),
    16: (ProgramNotReady, "remote motion was just configured; the controller has to be switched off and on"),
    23: (JointLimit, "invalid position"),
    24: (ProgramNotReady, "on hold after a refused instruction"),
    26: (Busy, "another program has the session"),
    27: (Busy, "still busy with another command"),
    28: (Busy, "still busy with an instruction"),
    29: (CommandRefused, "instruction out of sequence"),
    36: (JointLimit, "position not reachable"),
    43: (WrongMode, "in single step mode"),
}
_SELECTED = {7004, 7015}  # MEMO-004, MEMO-015
_SELECT_ANOTHER = (
    "Select another program than RMI_MOVE on the pendant; if that does not help, abort all programs there "
    "(FCTN, ABORT ALL) or switch the controller off and on, then confirm."
)


def refusal(error_id: int, device: str, command: str, raw: bytes = b"") -> AcquisitionError:
    """Return the error for an `ErrorID`."""
    number = error_id - _RMIT
    if error_id in _SELECTED:
        return ProgramNotReady(
            "the TP program RMI_MOVE is selected or still runs",
            device=device,
            command=command,
            raw=raw,
            what_to_do=_SELECT_ANOTHER,
        )
    kind, text = _CLASSES.get(number, (CommandRefused, "refused"))
    name = f"RMIT-{number:03d}" if 0 < number < 256 else f"ErrorID {error_id}"
    return kind(f"{text} ({name})", device=device, command=command, raw=raw)


class RmiLink:
    """A session with an RMI server: one command at a time, at most one motion.

    Attributes
    ----------
    version
        Major and minor version of RMI on the controller.
    """

    def __init__(self, door: TcpLink, deadlines: FanucDeadlines) -> None:
        self._door = door
        self.deadlines = deadlines
        self.device = door.device
        self.version = (0, 0)
        self._session: TcpLink | None = None
        self._lock = threading.RLock()
        self._last = ""
        self._pending: int | None = None
        self._answer: Packet | None = None
        self._fault = False
        beside(door.address, "session", door.address.port, door.device)  # refuses a wrong option at once

    # -- session ------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Request a session and enter it; only FRC_Connect is sent.

        Raises
        ------
        LinkError
            The connection failed.
        Busy
            Another program has the session.
        """
        with self._lock:
            self.close()
            port = self._handed_over()
            address = beside(self._door.address, "session", port, self.device)
            session = TcpLink(address, self.device, wire=self._door.wire, clock=self._door.clock)
            end = self._door.clock() + self.deadlines.connect_s
            while True:
                try:
                    session.open(connect_s=self.deadlines.connect_s)
                    break
                except LinkLost:  # the controller may need a moment to listen there
                    if self._door.clock() >= end:
                        raise
                    time.sleep(_RETRY_S)
            self._session, self._last, self._pending = session, "", None
            self._answer, self._fault = None, False

    def _handed_over(self) -> int:
        """Return the port of the session; a session that was just lost may take a while to end."""
        end = self._door.clock() + self.deadlines.takeover_s
        while True:
            self._door.open(connect_s=self.deadlines.connect_s)
            try:
                with self._door.question("connect"):
                    self._send(self._door, "connect", {"Communication": "FRC_Connect"})
                    packet = self._packet(self._door, "connect", "reply_s", self.deadlines.reply_s)
                    self._same(packet, "Communication", "FRC_Connect", "connect")
                    error = self.whole(packet, "ErrorID", "connect")
                    if not error:
                        port = self.whole(packet, "PortNumber", "connect")
                        self.version = (
                            self.whole(packet, "MajorVersion", "connect"),
                            self.whole(packet, "MinorVersion", "connect"),
                        )
                        if not 0 < port < 65536:
                            raise self._no_answer("is not a port", "connect", packet)
                        return port
            finally:
                self._door.close()
            if error != _CONNECTED or self._door.clock() >= end:
                raise refusal(error, self.device, "connect", raw_of(packet))
            time.sleep(_RETRY_S)

    def close(self) -> None:
        """Close the session without a word; never raises, safe from any thread."""
        session, self._session = self._session, None
        self._door.close()
        if session is not None:
            session.close()

    def leave(self) -> None:
        """End the session as the protocol asks for and close it; never raises, safe from any thread."""
        if self._session is not None and self._lock.acquire(timeout=self.deadlines.reply_s):
            try:
                self.ask("FRC_Disconnect", kind="Communication")
            except AcquisitionError:
                pass
            finally:
                self._lock.release()
        self.close()

    # -- questions ----------------------------------------------------------------------------------------

    def ask(
        self,
        name: str,
        *,
        kind: str = "Command",
        deadline: str = "reply_s",
        accept: Collection[int] = (0,),
        **fields: object,
    ) -> Packet:
        """Send a command and return its answer.

        Parameters
        ----------
        accept
            Values of `ErrorID` that are an answer; all others are raised as the class of their refusal.

        Raises
        ------
        LinkError
            The connection failed, or the answer is not one to this command.
        AcquisitionError
            The controller refused; the class tells why.
        """
        seconds: float = getattr(self.deadlines, deadline)
        with self._lock:
            if name == self._last:
                self.ask(JOINTS_READ if name == STATUS else STATUS)
            session = self._open_session(name)
            with session.question(name, unread_allowed=True):
                self._send(session, name, {kind: name, **fields})
                self._last = name
                end = session.clock() + seconds
                packet = self._packet(session, name, deadline, seconds)
                while self._aside(packet, name):
                    packet = self._packet(session, name, deadline, max(0.0, end - session.clock()))
                self._same(packet, kind, name, name)
                error = self.whole(packet, "ErrorID", name)
        if error not in accept:
            raise refusal(error, self.device, name, raw_of(packet))
        return packet

    def begin(self, number: int, move: JointMove) -> None:
        """Send a joint motion that ends FINE; its answer comes by `heard`.

        Raises
        ------
        LinkError
            The connection failed.
        MotionStopped
            A stop has overtaken the motion; it was not sent.
        """
        joints = {f"J{i}": round(q, 4) + 0.0 for i, q in enumerate(move.target, start=1)}
        with self._lock:
            if move.stopped.is_set():
                raise MotionStopped("stopped before it began", device=self.device, command="move_to")
            session = self._open_session("move_to")
            with session.question("move_to", unread_allowed=True):
                self._pending, self._answer, self._fault = number, None, False
                self._send(
                    session,
                    "move_to",
                    {
                        "Instruction": MOTION,
                        "SequenceID": number,
                        "JointAngle": joints,
                        "SpeedType": "Percent",
                        "Speed": move.percent,
                        "TermType": "FINE",
                        "TermValue": 0,
                    },
                )

    def heard(self) -> Packet | None:
        """Return the answer to the motion if it has come; does not wait.

        Raises
        ------
        LinkError
            The connection failed.
        """
        with self._lock:
            session = self._open_session("move_to")
            with session.question("move_to", unread_allowed=True):
                while self._answer is None and not self._fault:
                    try:
                        packet = self._packet(session, "move_to", "move_s", _THERE_S)
                    except LinkTimeout:
                        break
                    if not self._aside(packet, "move_to"):
                        raise self._no_answer("was not asked for", "move_to", packet)
            return self._answer

    @property
    def faulted(self) -> bool:
        """Whether the controller has reported that the motion ended in a fault."""
        return self._fault

    # -- packets ------------------------------------------------------------------------------------------

    def whole(self, packet: Packet, key: str, command: str) -> int:
        """Return a whole number of a packet.

        Raises
        ------
        ProtocolError
            It is missing, or something else.
        """
        value = packet.get(key)
        if not isinstance(value, int) or isinstance(value, bool):
            raise self._broken(f"has no whole number {key}", command, packet)
        return value

    def real(self, packet: Packet, key: str, command: str) -> float:
        """Return a finite number of a packet.

        Raises
        ------
        ProtocolError
            It is missing, or something else.
        """
        value = packet.get(key)
        if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
            raise self._broken(f"has no number {key}", command, packet)
        return float(value)

    def _aside(self, packet: Packet, command: str) -> bool:
        """Keep what comes without a question; True if the packet was such a one."""
        if "Instruction" in packet:
            number = self.whole(packet, "SequenceID", command)
            if packet["Instruction"] != MOTION or number != self._pending:
                raise self._no_answer("belongs to no motion under way", command, packet)
            self.whole(packet, "ErrorID", command)
            self._answer, self._pending = packet, None
            return True
        push = packet.get("Communication")
        if push == "FRC_Terminate":
            raise LinkLost("the controller has ended the session", device=self.device, command=command)
        if push == "FRC_SystemFault":
            self._fault = True
        return push in ("FRC_SystemFault", "FRC_AsbnReady")

    def _same(self, packet: Packet, kind: str, name: str, command: str) -> None:
        if packet.get(kind) == name:
            return
        if packet.get("Command") == "Unknown" and name == "FRC_Connect":
            raise ProtocolError(
                "the controller does not know FRC_Connect here",
                device=self.device,
                command=command,
                raw=raw_of(packet),
                what_to_do="Check that the address has port 16001 and that the controller has option R912.",
            )
        if packet.get("Command") == "Unknown":
            raise refusal(self.whole(packet, "ErrorID", command), self.device, command, raw_of(packet))
        raise self._no_answer("answers another question", command, packet)

    def _send(self, link: TcpLink, command: str, packet: Packet) -> None:
        link.send(json.dumps(packet).encode() + b"\r\n", command=command, send_s=self.deadlines.send_s)

    def _packet(self, link: TcpLink, command: str, deadline: str, seconds: float) -> Packet:
        line = link.read_until(b"\n", command=command, deadline=deadline, seconds=seconds, limit=_LONGEST)
        try:
            packet = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise ProtocolError("no JSON packet", device=self.device, command=command, raw=line) from error
        if not isinstance(packet, dict):
            raise ProtocolError("no JSON object", device=self.device, command=command, raw=line)
        return packet

    def _open_session(self, command: str) -> TcpLink:
        session = self._session
        if session is None:
            raise LinkLost("not connected", device=self.device, command=command)
        return session

    def _no_answer(self, why: str, command: str, packet: Packet) -> ProtocolError:
        return ProtocolError(f"a packet {why}", device=self.device, command=command, raw=raw_of(packet))

    def _broken(self, why: str, command: str, packet: Packet) -> ProtocolError:
        self.close()
        return self._no_answer(why, command, packet)


def raw_of(packet: Packet) -> bytes:
    """Return a packet as bytes for a record."""
    return json.dumps(packet).encode()

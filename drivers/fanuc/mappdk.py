"""MAPPDK text dialect of a Fanuc (torayeff/fanucpy, KAREL server on TCP 18735 and 18736).

A request is one line with LF. An answer is `0:<data>` or `1:<error>` without end mark (`drivers.fanuc.mappdk_link`).
The server greets with `0:success`. A stock move begins on one request. It is answered after the robot's motion program,
which ends in CNT, and cannot be stopped; meanwhile the second port still answers. A target that is damaged on its way
moves the robot, and only the read-back shows it, as `weakness` states.

Our own server (`robot_side`: CALSRV.kl, CALLOG.kl) answers numbered questions with a sum. It is detected by asking
`calname`. It offers state, stop and watchdog, and a move in two steps that ends FINE and reports why it ended
elsewhere:

    calset:NNNN:VVVV:<six joints>     0:c=NNNN,v=VVVV,j=...,k=SSS;   the target as understood there; nothing moves
    calgo:NNNN:SSS                    0:c=NNNN,r=R,k=SSS;            the sum of that request lets the robot go
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Sequence
from typing import Unpack

from drivers.errors import (
    AcquisitionError,
    CommandRefused,
    LinkError,
    MotionStopped,
    ProtectiveStop,
    ProtocolError,
)
from drivers.fanuc.controller import (
    JOINTS,
    UNFIT,
    VERSION,
    WIDEST_DEG,
    FanucDeadlines,
    JointMove,
    MovePoller,
    ended,
    other_version,
    raise_if_unfit,
)
from drivers.fanuc.mappdk_link import (
    BEAT,
    DONE,
    ENDED,
    MOVED,
    NAME,
    SEEN,
    SHOWN,
    STATE,
    AnswerFormat,
    MappdkLink,
    sealed,
    sum_of,
)
from drivers.interfaces import Identity, JointReading, RobotStatus, apart_deg
from drivers.link import TcpLink, beside
from drivers.wait import Waiting

_WATCHDOG_MS = 2000
_MOVED_DEG = 0.01  # between two looks; less is rest
_ECHO_DEG = 4e-5  # a KAREL REAL has single precision: 3e-5 at 360 deg
_WEAKNESS = (
    "a stock MAPPDK server moves on a request at once and has no checksum: a target that is damaged on its way moves "
    "the robot there, and is seen only afterwards, from 0.003 deg on"
)


class MappdkController:
    """Both connections to a controller: the first moves the robot, the second reads its state."""

    def __init__(self, link: TcpLink, deadlines: FanucDeadlines) -> None:
        self.name = link.device
        self._clock = link.clock
        self._main = MappdkLink(link, deadlines)
        behind = beside(link.address, "logger", link.address.port + 1, self.name)
        logger = TcpLink(behind, f"{self.name}-logger", wire=link.wire, clock=link.clock)
        self._logger = MappdkLink(logger, deadlines)
        self._numbers = itertools.cycle(range(1, 10000))
        self._ours: Identity | None = None  # of our own server, None for a stock one

    @property
    def deadlines(self) -> FanucDeadlines:
        return self._main.deadlines

    @deadlines.setter
    def deadlines(self, deadlines: FanucDeadlines) -> None:
        self._main.deadlines = self._logger.deadlines = deadlines

    @property
    def can_stop(self) -> bool:
        return self._ours is not None

    @property
    def dialect(self) -> str:
        return "mappdk" if self._ours is None else "mappdk-cal"

    @property
    def weakness(self) -> str:
        return _WEAKNESS if self._ours is None else ""

    def open(self) -> None:
        """Open both connections and detect our server.

        Raises
        ------
        LinkError
            The connection failed.
        """
        self._ours = None
        self._main.open()
        self._logger.open()
        try:
            found = self._numbered(self._logger, self._request(b"calname"), NAME)
        except CommandRefused:
            return
        if int(found[2]) != VERSION:
            raise other_version("CALLOG", int(found[2]), self.name)
        model, version = (part.decode("latin-1").strip() for part in found.groups()[2:4])
        self._ours = Identity("Fanuc", model, "", version, "mappdk-cal")

    def close(self) -> None:
        self._main.link.close()
        self._logger.link.close()

    def identity(self) -> Identity:
        """Return the identity; a stock server reports none."""
        self.joints()
        return self._ours or Identity("Fanuc", "", "", "", "mappdk")

    def prepare(self) -> None:
        """Set the watchdog of our server; a stock one needs no preparation."""
        if self._ours is not None:
            found = self._numbered(self._logger, self._request(b"calbeat", b"%05d" % _WATCHDOG_MS), BEAT)
            self._compare((int(found[2]),), (_WATCHDOG_MS,), found[0])

    def joints(self) -> JointReading:
        return self._joints(self._main)

    def _joints(self, talk: MappdkLink) -> JointReading:
        found = talk.ask(b"curjpos", SEEN)
        joints = tuple(float(field) for field in found.groups()[:JOINTS])
        if not all(math.isfinite(q) and abs(q) < WIDEST_DEG for q in joints):
            talk.link.close()
            raise ProtocolError(
                "joint angle out of range", device=talk.link.device, command="curjpos", raw=found[0]
            )
        return JointReading(joints, 1e-3, found[0])

    def move(self, move: JointMove) -> None:
        """Move; a stock server begins at once.

        It moves with CNT 0, which is the nearest to a stop point that it has.
        """
        joints = b":".join(b"%c%013.6f" % (b"-" if q < 0 else b"+", abs(q)) for q in move.target)
        look = MovePoller(self._look_for(move), self._clock)
        if self._ours is not None:
            self._confirmed_move(move, joints, look)
        else:
            request = b"movej:%04d:0100:000:0:%d:%s" % (move.percent, JOINTS, joints)
            self._main.ask(request, MOVED, deadline="move_s", seconds=move.seconds, meanwhile=look)

    def _confirmed_move(self, move: JointMove, joints: bytes, look: Callable[[], None]) -> None:
        request = self._request(b"calset", b"%04d:%s" % (move.percent, joints))
        found = self._numbered(self._main, request, SHOWN)
        shown = [float(field) for field in found.groups()[1 : 2 + JOINTS]]
        self._compare(shown, (move.percent, *move.target), found[0])
        if move.stopped.is_set():
            raise MotionStopped("stopped before it began", device=self.name, command="move_to")
        go = self._request(b"calgo", b"%03d" % sum_of(request))
        found = self._numbered(self._main, go, ENDED, deadline="move_s", seconds=move.seconds, meanwhile=look)
        status = int(found[2])
        if status == UNFIT:  # our motion program knows that it cannot move; the state knows why
            raise_if_unfit(self.status(), self.name, "move_to")
        if status:
            raise self._failed(status, found[0])

    def _failed(self, status: int, raw: bytes) -> AcquisitionError:
        kind, text = ended(status)
        return kind(text, device=self.name, command="move_to", raw=raw)

    def _compare(self, shown: Sequence[float], wanted: Sequence[float], raw: bytes) -> None:
        if apart_deg(shown, wanted) > _ECHO_DEG:
            self.close()
            raise ProtocolError(
                "the controller understood another request; nothing moved",
                device=self.name,
                command="calset",
                raw=raw,
            )

    def _look_for(self, move: JointMove) -> Callable[[], None]:
        """Return a function that observes the robot while the answer to a move is outstanding.

        Our server reports its state. A stock one only reports the joints. A robot that rests during a move was then
        stopped, by an emergency stop, the supervision or a person, and the answer will not come.
        """
        since, last = self._clock(), None

        def at_state() -> None:
            if move.stopped.is_set():  # the stop may have overtaken the move: say it again
                self.halt()
            else:
                raise_if_unfit(self.status(), self.name, "move_to")

        def at_joints() -> None:
            nonlocal since, last
            now = self._joints(self._logger).joints_deg
            if last is None or apart_deg(now, last) > _MOVED_DEG:
                since, last = self._clock(), now
            away = apart_deg(now, move.target)
            if away > _MOVED_DEG and self._clock() - since > self.deadlines.still_s:
                raise ProtectiveStop(
                    f"is {away:.3f} deg from its target for still_s = {self.deadlines.still_s:g} s "
                    "(emergency stop, supervision, hold)",
                    device=self.name,
                    command="move_to",
                )

        return at_joints if self._ours is None else at_state

    def halt(self) -> None:
        """Halt the robot.

        Raises
        ------
        LinkError
            The stop was not answered, also not on a new connection.
        """
        try:
            self._numbered(self._logger, self._request(b"calstop"), DONE)
        except LinkError:  # a stop is worth a second try on a fresh connection
            self._logger.open()
            self._numbered(self._logger, self._request(b"calstop"), DONE)

    def status(self) -> RobotStatus:
        """Return the state; a stock server only shows that its second port answers.

        Raises
        ------
        LinkError
            The connection failed.
        """
        if self._ours is None:
            raw = self._joints(self._logger).raw
            return RobotStatus("unknown", None, None, None, raw=raw)
        found = self._numbered(self._logger, self._request(b"calstat"), STATE)
        auto, power, stop, moving, number = (int(field) for field in found.groups()[1:6])
        mode = "auto" if auto else "manual"
        return RobotStatus(mode, bool(power), bool(stop), bool(moving), number or None, found[0])

    def _request(self, what: bytes, *rest: bytes) -> bytes:
        """Return a question of our server, with the next number."""
        return b":".join((what, b"%04d" % next(self._numbers), *rest))

    def _numbered(
        self, talk: MappdkLink, request: bytes, form: AnswerFormat, **waiting: Unpack[Waiting]
    ) -> re.Match[bytes]:
        """Ask our server a numbered question and return its answer.

        Raises
        ------
        LinkError
            The connection failed, or the answer has another number or a wrong sum.
        CommandRefused, JointLimit
            The server refused.
        """
        found = talk.ask(request, form, **waiting)
        what, number, *_ = request.split(b":")
        if found[1] != number or not sealed(found[0]):
            talk.link.close()
            raise ProtocolError(
                f"answer does not carry number {number.decode()}, or a wrong sum",
                device=talk.link.device,
                command=what.decode(),
                raw=found[0],
            )
        return found

"""MAPPDK text dialect of a Fanuc (torayeff/fanucpy, KAREL server on TCP 18735, the same again on 18736).

Request: one line, LF. Answer: `0:<data>` or `1:<error>` without end mark, complete when it has exactly its form.
The server greets with `0:success`. A move is answered after the robot's motion program, which a stock server ends
in CNT, and cannot be stopped; meanwhile the second port goes on answering. Answers carry no number, so every
question is followed by `curpos`, whose answer no other question has: whatever a late or doubled answer left on the
wire then meets the wrong form and closes the link.

Our own server (`robot_side/fanuc`: CALSRV.kl, CALLOG.kl) adds numbered questions on the second port, detected by
asking `calname`: state, stop, watchdog; their answers carry a sum. Its moves end FINE and say why they ended elsewhere.
"""

from __future__ import annotations

import itertools
import math
import re
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import NamedTuple

from drivers.errors import (
    AcquisitionError,
    CommandRefused,
    ConfigError,
    JointLimit,
    LinkError,
    LinkTimeout,
    NotReady,
    ProtectiveStop,
    ProtocolError,
)
from drivers.fanuc_controller import (
    JOINTS,
    OUT_OF_RANGE,
    SILENCE,
    STOPPED_BY_CLIENT,
    UNFIT,
    WIDEST_DEG,
    FanucDeadlines,
    Looker,
    Move,
    ended,
    raise_if_unfit,
)
from drivers.interfaces import Identity, JointReading, RobotStatus
from drivers.link import Address, TcpLink, WireSink

_LONGEST = 254  # KAREL STRING[254]
_WATCHDOG_MS = 2000
_MOVED_DEG = 0.01  # between two looks; less is standing
_FIXED = rb" *-?\d{0,4}\.\d{3}"  # CNV_REAL_STR(x, 8, 3): padded with blanks
_REFUSALS: dict[bytes, tuple[type[AcquisitionError], str]] = {
    b"1:position-is-not-reachable": (JointLimit, "position not reachable"),
    b"1:error-in-joint-values": (JointLimit, "error in the joint values"),
    b"1:motion-stopped": ended(STOPPED_BY_CLIENT),
    b"1:out-of-range": ended(OUT_OF_RANGE),
    b"1:watchdog": ended(SILENCE),
    b"1:not-ready": ended(UNFIT),
    **{
        b"1:" + text: (CommandRefused, text.decode())
        for text in (
            b"wrong-command",
            b"R[81]-was-not-set",
            b"R[82]-was-not-set",
            b"R[83]-was-not-set",
            b"PR[81]-was-not-set",
            b"cannot-convert-joint-vals",
            b"motion-failed",
        )
    },
}


class Form(NamedTuple):
    """What may answer a question: its first bytes, and the whole."""

    heads: tuple[bytes, ...]
    whole: re.Pattern[bytes]


def _form(head: bytes, rest: bytes = b"", *, refusable: bool = True) -> Form:
    heads = (head, *_REFUSALS) if refusable else (head,)
    return Form(heads, re.compile(b"|".join([re.escape(head) + rest, *map(re.escape, heads[1:])])))


def _fields(names: Iterable[bytes], forms: Iterable[bytes]) -> bytes:
    return b",".join(name + b"=(" + form + b")" for name, form in zip(names, forms, strict=True))


_GREETING = _form(b"0:success", refusable=False)
_MOVED = _form(b"0:success")
_JOINTS = _form(b"0:j", _fields([b"", *[b"j"] * 8], [_FIXED] * JOINTS + [_FIXED + b"|none"] * 3))
_POSE = _form(b"0:x", _fields([b"", b"y", b"z", b"w", b"p", b"r"], [_FIXED] * 6), refusable=False)
_NAME = _form(b"0:c=", rb"(\d{4}),v=(\d+),([^,;]*),([^,;]*),k=\d{3};")
_DONE = _form(b"0:c=", rb"(\d{4}),k=\d{3};")
_STATE = _form(b"0:c=", rb"(\d{4}),a=([01]),p=([01]),e=([01]),m=([01]),n=(\d{1,5}),k=\d{3};")


def sealed(answer: bytes) -> bool:
    """Whether `<text>,k=NNN;` carries the sum of the codes of its text, modulo 1000."""
    text, _, sum_of = answer.rpartition(b",k=")
    return sum_of == b"%03d;" % (sum(text) % 1000)


class MappdkLink:
    """One connection; one question at a time, from any thread."""

    def __init__(self, link: TcpLink, deadlines: FanucDeadlines) -> None:
        self.link = link
        self.deadlines = deadlines
        self._lock = threading.RLock()

    def open(self) -> None:
        """Connect and be greeted. Raises LinkError."""
        with self._lock:
            self.link.open(connect_s=self.deadlines.connect_s)
            try:
                with self.link.question("connect", unread_allowed=True):  # the greeting may be there already
                    self._read("connect", _GREETING, "connect_s", self.deadlines.connect_s)
            except LinkTimeout as error:
                error.what_to_do = (
                    "Check that the KAREL programs run and that no other program is connected to the robot."
                )
                raise

    def ask(
        self,
        request: bytes,
        form: Form,
        *,
        deadline: str = "reply_s",
        seconds: float | None = None,
        meanwhile: Callable[[], None] | None = None,
    ) -> re.Match[bytes]:
        """One question and the `curpos` behind it. Raises LinkError, and what a refusal means."""
        limit = self.deadlines.reply_s if seconds is None else seconds
        command = request.split(b":")[0].decode()
        with self._lock:
            with self.link.question(command):
                self.link.send(request + b"\n", command=command, send_s=self.deadlines.send_s)
                found = self._read(command, form, deadline, limit, meanwhile)
            with self.link.question("curpos"):
                self.link.send(b"curpos\n", command="curpos", send_s=self.deadlines.send_s)
                self._read("curpos", _POSE, "reply_s", self.deadlines.reply_s)
        if found[0] in _REFUSALS:
            kind, text = _REFUSALS[found[0]]
            raise kind(text, device=self.link.device, command=command, raw=found[0])
        return found

    def _read(
        self,
        command: str,
        form: Form,
        deadline: str,
        seconds: float,
        meanwhile: Callable[[], None] | None = None,
    ) -> re.Match[bytes]:
        def possible(received: bytes) -> bool:
            begins_well = any(received.startswith(head) or head.startswith(received) for head in form.heads)
            return begins_well and len(received) <= _LONGEST and not form.whole.match(received)

        return self.link.read_reply(
            form.whole,
            command=command,
            deadline=deadline,
            seconds=seconds,
            possible=possible,
            meanwhile=meanwhile,
        )


class MappdkController:
    """Both connections of a controller: the first moves, the second looks."""

    def __init__(
        self,
        address: Address,
        name: str,
        deadlines: FanucDeadlines,
        *,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        second = address.options.get("logger", str(address.port + 1))
        if not second.isdecimal():
            raise ConfigError(f"logger={second!r} is not a port", device=name)
        self.name = name
        self._clock = clock
        self._main = MappdkLink(TcpLink(address, name, wire=wire, clock=clock), deadlines)
        behind = replace(address, port=int(second))
        self._logger = MappdkLink(TcpLink(behind, f"{name}-logger", wire=wire, clock=clock), deadlines)
        self._numbers = itertools.cycle(range(1, 10000))
        self._ours: Identity | None = None  # of our own server; None: a stock one

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

    def open(self) -> None:
        """Both connections; is it our server? Raises LinkError."""
        self._ours = None
        self._main.open()
        self._logger.open()
        try:
            found = self._numbered(b"calname", _NAME)
        except CommandRefused:
            return
        if found[2] != b"1":
            raise ProtocolError(
                "CALLOG of another version", device=self.name, command="calname", raw=found[0]
            )
        model, version = (part.decode("latin-1").strip() for part in found.groups()[2:4])
        self._ours = Identity("Fanuc", model, "", version, "mappdk-cal")

    def close(self) -> None:
        self._main.link.close()
        self._logger.link.close()

    def identity(self) -> Identity:
        """A stock server cannot say which robot it is; that it answers is all that is known."""
        self.joints()
        return self._ours or Identity("Fanuc", "", "", "", "mappdk")

    def prepare(self) -> None:
        """Our server gets its watchdog; a stock one has nothing to prepare."""
        if self._ours is not None:
            self._numbered(b"calbeat", _DONE, b":%05d" % _WATCHDOG_MS)

    def joints(self) -> JointReading:
        return self._joints(self._main)

    def _joints(self, talk: MappdkLink) -> JointReading:
        found = talk.ask(b"curjpos", _JOINTS)
        joints = tuple(float(field) for field in found.groups()[:JOINTS])
        if not all(math.isfinite(q) and abs(q) < WIDEST_DEG for q in joints):
            talk.link.close()
            raise ProtocolError(
                "joint angle out of range", device=talk.link.device, command="curjpos", raw=found[0]
            )
        return JointReading(joints, 1e-3, found[0])

    def move(self, move: Move) -> None:
        """CNT 0: as near to a stop point as a stock server comes."""
        joints = b"".join(b":%c%013.6f" % (b"-" if q < 0 else b"+", abs(q)) for q in move.target)
        request = b"movej:%04d:0100:000:0:%d%s" % (move.percent, JOINTS, joints)
        look = Looker(self._look_for(move), self._clock)
        try:
            self._main.ask(request, _MOVED, deadline="move_s", seconds=move.seconds, meanwhile=look)
        except NotReady as error:  # our motion program knows that it cannot move; the state knows why
            raise_if_unfit(self.status(), self.name, "move_to")
            error.what_to_do = (
                "Clear the alarm on the pendant, start the robot's programs again, then confirm."
            )
            raise

    def _look_for(self, move: Move) -> Callable[[], None]:
        """What is looked at while the answer to a move is outstanding.

        Our server tells its state. Of a stock one only the joints are seen: a robot that stands on its way was
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
            if last is None or max(abs(a - b) for a, b in zip(now, last, strict=True)) > _MOVED_DEG:
                since, last = self._clock(), now
            away = max(abs(a - b) for a, b in zip(now, move.target, strict=True))
            if away > _MOVED_DEG and self._clock() - since > self.deadlines.still_s:
                raise ProtectiveStop(
                    f"stands {away:.3f} deg from its target for still_s = {self.deadlines.still_s:g} s "
                    "(emergency stop, supervision, hold)",
                    device=self.name,
                    command="move_to",
                )

        return at_joints if self._ours is None else at_state

    def halt(self) -> None:
        """Raises LinkError."""
        try:
            self._numbered(b"calstop", _DONE)
        except LinkError:  # a stop is worth a second try on a fresh connection
            self._logger.open()
            self._numbered(b"calstop", _DONE)

    def status(self) -> RobotStatus:
        """Stock: only that the second port answers. Raises LinkError."""
        if self._ours is None:
            raw = self._joints(self._logger).raw
            return RobotStatus("unknown", None, None, None, raw=raw)
        found = self._numbered(b"calstat", _STATE)
        auto, power, stop, moving, number = (int(field) for field in found.groups()[1:6])
        mode = "auto" if auto else "manual"
        return RobotStatus(mode, bool(power), bool(stop), bool(moving), number or None, found[0])

    def _numbered(self, what: bytes, form: Form, rest: bytes = b"") -> re.Match[bytes]:
        """A question of our server on the second port. Raises LinkError, CommandRefused."""
        number = b"%04d" % next(self._numbers)
        found = self._logger.ask(what + b":" + number + rest, form)
        if found[1] != number or not sealed(found[0]):
            self._logger.link.close()
            raise ProtocolError(
                f"answer does not carry number {number.decode()}, or a wrong sum",
                device=self._logger.link.device,
                command=what.decode(),
                raw=found[0],
            )
        return found

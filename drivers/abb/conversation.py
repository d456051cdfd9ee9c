"""Questions and answers of the two ABB dialects over one connection.

open_abb: request `<code> <p1> ... <pn> #`, answer `<code> <ok> <data>` without end mark or number. An answer is
complete when it has exactly its form. Every question is followed by a ping: a late or doubled answer left on the wire
then meets the wrong code and closes the link.

CALSRV, codes from 200 on: `<code> 1 <seq> <data> #` LF, or `<code> 0 <errno> <seq> #` LF when refused.
"""

from __future__ import annotations

import itertools
import re
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from drivers.errors import CommandRefused, LinkTimeout, ProtocolError, naming
from drivers.link import TcpLink

_LONGEST = 120
_LOG_RECORDS = 8  # they alternate between pose and joints
_LOG_JOINTS = re.compile(rb" 1 \S+ \S+ \S+((?: -?\d{1,3}\.\d{1,2}){6}) ?")
_PING = re.compile(rb"0 1 ")
_PROBE = re.compile(rb"200 (?:0 |1 CAL (\d) (\d) #\n)")
VERSION, DECIMALS = 2, 5  # of CALSRV, and of the joint angles in its answers
_OTHER_VERSION = (
    "Load CALSRV.mod and CALBACK.mod of this program (drivers/abb/robot_side) into the controller."
)
_NUMBERED = re.compile(rb"(\d{3}) ([01])((?: -?\d+(?:\.\d+)?)+)")


@dataclass(frozen=True, slots=True)
class AbbDeadlines:
    """Named waits in seconds.

    A move may take `move_factor` x its predicted time + `move_margin_s`. `settle_s` is the time from the reported end
    of a move to a read-back at its target, which is checked every `gap_s`.

    The second channel (`drivers.abb.second_channel`) is asked every `rws_every_s`, four questions each time; a
    controller answers 20 per second. A question may take `rws_s`, a stop `rws_stop_s`. No move is allowed after
    `rws_silent_s` without an answer.
    """

    connect_s: float = 3.0
    send_s: float = 1.0
    ping_s: float = 1.0
    reply_s: float = 2.0
    quiet_s: float = 0.1
    stop_s: float = 1.0
    move_factor: float = 2.0
    move_margin_s: float = 10.0
    settle_s: float = 1.0
    gap_s: float = 0.05
    rws_s: float = 2.0
    rws_every_s: float = 0.5
    rws_silent_s: float = 5.0
    rws_stop_s: float = 3.0


@dataclass(frozen=True, slots=True)
class Numbered:
    """An answer of CALSRV to `request`.

    `errno` is 0 with data fields, or the number of a refusal.
    """

    errno: int
    fields: tuple[bytes, ...]
    raw: bytes
    request: bytes = b""


def parse_numbered(raw: bytes, code: int, number: int) -> Numbered:
    """Parse a line without its ` #` LF.

    Raises
    ------
    ProtocolError
        The line is not an answer to exactly this question.
    """
    found = _NUMBERED.fullmatch(raw)
    if not found or int(found[1]) != code:
        raise ProtocolError("answer to another question, or not an answer", raw=raw)
    fields = tuple(found[3].split())
    if found[2] == b"1":
        echo, errno, data = fields[:1], b"0", fields[1:]
    else:
        echo, errno, data = fields[1:], fields[0], ()
    if echo != (b"%d" % number,) or not errno.isdigit():
        raise ProtocolError(f"answer does not carry number {number}", raw=raw)
    return Numbered(int(errno), data, raw)


class AbbConversation:
    """A connection to the controller: one question at a time, from any thread."""

    def __init__(self, link: TcpLink, deadlines: AbbDeadlines) -> None:
        self.link = link
        self.deadlines = deadlines
        self.lock = threading.RLock()
        self._numbers = itertools.cycle(range(1, 10000))  # four digits keep a reply within 80 characters

    def ping(self, *, again: bool = False) -> None:
        """Send a ping and wait for its answer.

        With `again`, it is sent twice if needed: servers before open_abb's pull request 15 lose the first answer of a
        connection.
        """
        ask = (b"0 #", b"0 ", _PING, "ping_s", self.deadlines.ping_s)
        with self.lock, self.link.question("0"):
            try:
                self._exchange(*ask)
            except LinkTimeout:
                if not again:
                    raise
                self._exchange(*ask)

    def probe(self) -> bool:
        """Check whether CALSRV answers here.

        Raises
        ------
        LinkError
            The connection failed.
        ProtocolError
            The controller runs another version of CALSRV.
        """
        with self.lock, self.link.question("200"):
            found = self._exchange(b"200 #", b"200 ", _PROBE, "ping_s", self.deadlines.ping_s)
            if found[1] is None:
                return False
            if (int(found[1]), int(found[2])) != (VERSION, DECIMALS):
                raise ProtocolError(
                    f"CALSRV on the controller is program version {int(found[1])}, needed {VERSION}",
                    device=self.link.device,
                    command="200",
                    raw=found[0],
                    what_to_do=_OTHER_VERSION,
                )
            return True

    def ask(
        self,
        code: int,
        values: Sequence[float] = (),
        complete: re.Pattern[bytes] | None = None,
        *,
        deadline: str = "reply_s",
        seconds: float | None = None,
        quiet_s: float = 0.0,
        sure: re.Pattern[bytes] | None = None,
        meanwhile: Callable[[], None] | None = None,
    ) -> re.Match[bytes]:
        """Ask an open_abb question, followed by a ping, and return the data of its answer.

        Parameters
        ----------
        complete
            Form of the complete answer.
        quiet_s, sure
            Determine the end of an answer without a recognisable end (`drivers.link`).
        meanwhile
            Called while waiting; may raise.

        Raises
        ------
        LinkError
            The connection failed.
        CommandRefused
            The controller answered 0.
        """
        head = b"%d " % code
        pattern = complete or re.compile(rb"%d (?:0 |1 ())" % code)
        request = " ".join([str(code), *(f"{value:.4f}" for value in values), "#"]).encode()
        limit = self.deadlines.reply_s if seconds is None else seconds
        with self.lock:
            with self.link.question(str(code)):
                found = self._exchange(request, head, pattern, deadline, limit, quiet_s, sure, meanwhile)
            self.ping()
        if found[1] is None:
            raise CommandRefused(
                "controller answered 0", device=self.link.device, command=str(code), raw=found[0]
            )
        return found

    def ask_numbered(
        self,
        code: int,
        values: Sequence[float] = (),
        *,
        deadline: str = "reply_s",
        seconds: float | None = None,
        meanwhile: Callable[[], None] | None = None,
    ) -> Numbered:
        """Ask CALSRV one question and return its answer, which may be a refusal.

        Raises
        ------
        LinkError
            The connection failed.
        """
        limit = self.deadlines.reply_s if seconds is None else seconds
        command = str(code)
        with self.lock:
            number = next(self._numbers)
            texts = (str(v) if isinstance(v, int) else f"{v:.{DECIMALS}f}" for v in values)
            request = " ".join([command, str(number), *texts, "#"]).encode()
            with self.link.question(command):
                self.link.send(request, command=command, send_s=self.deadlines.send_s)
                raw = self.link.read_until(
                    b" #\n", command=command, deadline=deadline, seconds=limit, limit=80, meanwhile=meanwhile
                )
                with naming(self.link.device, command):
                    return replace(parse_numbered(raw, code, number), request=request)

    def log_joints(self) -> tuple[float, ...]:
        """Return the joint angles (deg) from the stream on the log port of a stock controller.

        Records have no end mark, each begins with `#`: `# 1 <date> <time> <t> j1..j6`.

        Raises
        ------
        LinkError
            The connection failed, or the stream has no joints.
        """
        with self.lock, self.link.question("log", unread_allowed=True):
            for _ in range(_LOG_RECORDS):
                raw = self.link.read_until(
                    b"#", command="log", deadline="reply_s", seconds=self.deadlines.reply_s
                )
                found = _LOG_JOINTS.fullmatch(raw)
                if found:
                    return tuple(float(field) for field in found[1].split())
            raise ProtocolError("no joints in the log stream", device=self.link.device, command="log")

    def _exchange(
        self,
        request: bytes,
        head: bytes,
        complete: re.Pattern[bytes],
        deadline: str,
        seconds: float,
        quiet_s: float = 0.0,
        sure: re.Pattern[bytes] | None = None,
        meanwhile: Callable[[], None] | None = None,
    ) -> re.Match[bytes]:
        def possible(received: bytes) -> bool:
            begins_well = received.startswith(head) or head.startswith(received)
            return begins_well and len(received) <= _LONGEST and not complete.match(received)

        command = head.decode().strip()
        self.link.send(request, command=command, send_s=self.deadlines.send_s)
        return self.link.read_reply(
            complete,
            command=command,
            deadline=deadline,
            seconds=seconds,
            possible=possible,
            quiet_s=quiet_s,
            sure=sure,
            meanwhile=meanwhile,
        )

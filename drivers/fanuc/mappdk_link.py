"""A connection to a MAPPDK server: questions, the forms of their answers, and refusals.

Answers have no end mark and no number: an answer is complete when it has exactly its form. Every question is followed
by `curpos`, whose answer no other question has. A late or doubled answer left on the wire then meets the wrong form and
closes the link.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterable
from typing import NamedTuple

from drivers.errors import AcquisitionError, CommandRefused, JointLimit, LinkTimeout
from drivers.fanuc.controller import JOINTS, FanucDeadlines
from drivers.link import TcpLink

_LONGEST = 254  # KAREL STRING[254]
_FIXED = rb" *-?\d{0,4}\.\d{3}"  # CNV_REAL_STR(x, 8, 3): padded with blanks
_REFUSALS: dict[bytes, tuple[type[AcquisitionError], str]] = {
    b"1:position-is-not-reachable": (JointLimit, "position not reachable"),
    b"1:error-in-joint-values": (JointLimit, "error in the joint values"),
    **{
        b"1:" + text: (CommandRefused, text.decode())
        for text in (
            b"wrong-command",
            b"R[81]-was-not-set",
            b"R[82]-was-not-set",
            b"R[83]-was-not-set",
            b"PR[81]-was-not-set",
            b"cannot-convert-joint-vals",
        )
    },
}


class AnswerFormat(NamedTuple):
    """The form of an answer to a question: its first bytes, and the whole."""

    heads: tuple[bytes, ...]
    whole: re.Pattern[bytes]


def _form(head: bytes, rest: bytes = b"", *, refusable: bool = True) -> AnswerFormat:
    heads = (head, *_REFUSALS) if refusable else (head,)
    return AnswerFormat(heads, re.compile(b"|".join([re.escape(head) + rest, *map(re.escape, heads[1:])])))


def _fields(names: Iterable[bytes], forms: Iterable[bytes]) -> bytes:
    return b",".join(name + b"=(" + form + b")" for name, form in zip(names, forms, strict=True))


GREETING = _form(b"0:success", refusable=False)
MOVED = _form(b"0:success")
SEEN = _form(b"0:j", _fields([b"", *[b"j"] * 8], [_FIXED] * JOINTS + [_FIXED + b"|none"] * 3))
_POSE = _form(b"0:x", _fields([b"", b"y", b"z", b"w", b"p", b"r"], [_FIXED] * 6), refusable=False)

# Of our own server: each echoes the number of its question and ends in a sum.
NAME = _form(b"0:c=", rb"(\d{4}),v=(\d+),([^,;]*),([^,;]*),k=\d{3};")
DONE = _form(b"0:c=", rb"(\d{4}),k=\d{3};")
BEAT = _form(b"0:c=", rb"(\d{4}),w=(\d{5}),k=\d{3};")
STATE = _form(b"0:c=", rb"(\d{4}),a=([01]),p=([01]),e=([01]),m=([01]),n=(\d{1,5}),k=\d{3};")
SHOWN = _form(b"0:c=", rb"(\d{4}),v=(\d{4})" + rb",j=( *-?\d{0,4}\.\d{6})" * JOINTS + rb",k=\d{3};")
ENDED = _form(b"0:c=", rb"(\d{4}),r=(\d),k=\d{3};")


def sum_of(text: bytes) -> int:
    """Compute the sum of the codes of a text, modulo 1000: any one wrong byte changes it."""
    return sum(text) % 1000


def sealed(answer: bytes) -> bool:
    """Check that `<text>,k=NNN;` has the sum of the codes of its text, modulo 1000."""
    text, _, given = answer.rpartition(b",k=")
    return given == b"%03d;" % sum_of(text)


class MappdkLink:
    """A connection to a MAPPDK server: one question at a time, from any thread."""

    def __init__(self, link: TcpLink, deadlines: FanucDeadlines) -> None:
        self.link = link
        self.deadlines = deadlines
        self._lock = threading.RLock()

    def open(self) -> None:
        """Connect and wait for the greeting.

        Raises
        ------
        LinkError
            The connection failed.
        """
        with self._lock:
            self.link.open(connect_s=self.deadlines.connect_s)
            try:
                with self.link.question("connect", unread_allowed=True):  # the greeting may be there already
                    self._read("connect", GREETING, "connect_s", self.deadlines.connect_s)
            except LinkTimeout as error:
                error.what_to_do = (
                    "Check that the KAREL programs run and that no other program is connected to the robot."
                )
                raise

    def ask(
        self,
        request: bytes,
        form: AnswerFormat,
        *,
        deadline: str = "reply_s",
        seconds: float | None = None,
        meanwhile: Callable[[], None] | None = None,
    ) -> re.Match[bytes]:
        """Ask a question, followed by `curpos`, and return its answer.

        A refusal is raised as its error class.

        Raises
        ------
        LinkError
            The connection failed.
        """
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
        form: AnswerFormat,
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

"""The sender of an outbox: it sends each waiting document until the server acknowledges it.

    waiting time after the n-th failure in a row: between half and all of min(FIRST_S 2^(n-1), LONGEST_S)

The time is random, so that two hundred cells do not ask at once when a server comes back. A server that does not answer
delays all documents. A document whose own uploads fail delays no other, because it has separate waiting times. No
document is abandoned after a time limit: an outbox without a network waits for weeks. Clock, chance and pauses come
from outside.
"""

from __future__ import annotations

import hashlib
import random
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from typing import Protocol

from fleet.outbox.link import UploadAnswer
from fleet.outbox.queue import Outbox
from fleet.store import Document, utc_now

FIRST_S, LONGEST_S = 1.0, 600.0
PATIENCE_S = 3600.0  # the longest that a server may ask for
IN_A_ROW = 3  # uploads that fail one after another: then the document is not the cause
DAMAGED = 20  # times that a document may arrive damaged, before it is set aside


class Upload(Protocol):
    """A link as a sender uses it."""

    def put(self, document: Document) -> UploadAnswer:
        """Upload a document."""
        ...


@dataclass(frozen=True)
class SendRound:
    """The result of one round.

    Attributes
    ----------
    trouble
        Reason why it ended early; empty if it did not.
    barred
        Whether a person must change something.
    wait_s
        Time until the next attempt, s; None if no document waits.
    """

    kept: int = 0
    refused: int = 0
    waiting: int = 0
    trouble: str = ""
    barred: bool = False
    wait_s: float | None = None


@dataclass
class _Patience:
    """Failures in a row, and the end of the wait after the last one."""

    failures: int = 0
    until: float = 0.0


@dataclass
class Sender:
    """A sender of the documents that wait in an outbox.

    Attributes
    ----------
    monotonic
        Returns seconds that only increase.
    now
        Returns the time for entries.
    say
        Called for every rejected document.
    """

    outbox: Outbox
    link: Upload
    monotonic: Callable[[], float] = time.monotonic
    now: Callable[[], datetime] = utc_now
    chance: random.Random = field(default_factory=random.Random)
    say: Callable[[str], None] = lambda text: None
    _server: _Patience = field(default_factory=_Patience)
    _documents: dict[str, _Patience] = field(default_factory=dict)

    def round(self, ended: Callable[[], bool] = lambda: False) -> SendRound:
        """Try to send each document that is due, once.

        Documents without failures go first, oldest first, so that a document that always fails does not block the
        others. `ended` returns True to stop between two documents.
        """
        waiting = sorted((entry.hash for entry in self.outbox.entries("waiting")), key=self._failures)
        kept = refused = in_a_row = 0
        trouble, barred = "", False
        for hash_ in waiting:
            if ended() or self._server.until > self.monotonic():
                break
            own = self._documents.get(hash_)
            if own is not None and own.until > self.monotonic():
                continue
            answer = self._try(hash_)
            if answer.kind in ("kept", "refused"):
                self._server, in_a_row = _Patience(), 0
                self._documents.pop(hash_, None)
                kept += answer.kind == "kept"
                refused += answer.kind == "refused"
                continue
            of_server = answer.kind in ("away", "barred")
            if not of_server:
                in_a_row += 1
                self._fail(self._documents.setdefault(hash_, _Patience()))
            if of_server or in_a_row >= IN_A_ROW:
                trouble, barred = answer.said, answer.kind == "barred"
                self._fail(self._server, answer.after_s)
        left = len(waiting) - kept - refused
        return SendRound(kept, refused, left, trouble, barred, self._wait(left))

    def _try(self, hash_: str) -> UploadAnswer:
        """Upload one document and store the result before anything else is done."""
        document = self.outbox.document(hash_)
        if hashlib.sha256(document.content).hexdigest() != hash_:
            answer = UploadAnswer(
                "refused", "The outbox holds another content than it took in: its disk is failing."
            )
        else:
            answer = self.link.put(document)
        if answer.kind == "damaged":
            tries = self._failures(hash_) + 1
            if tries >= DAMAGED:
                answer = UploadAnswer("refused", f"It arrived damaged {tries} times. {answer.said}")
        if answer.kind == "kept":
            self.outbox.acknowledged(hash_, self.now())
        elif answer.kind == "refused":
            self.outbox.set_aside(hash_, answer.said, self.now())
            self.say(f"set aside: {document.kind} {document.identity}: {answer.said}")
        else:
            self.outbox.tried(hash_, answer.said)
        return answer

    def _failures(self, hash_: str) -> int:
        patience = self._documents.get(hash_)
        return 0 if patience is None else patience.failures

    def _fail(self, patience: _Patience, asked_s: float | None = None) -> None:
        patience.failures += 1
        longest = min(FIRST_S * 2.0 ** min(patience.failures - 1, 30), LONGEST_S)
        wait = longest * self.chance.uniform(0.5, 1.0)
        if asked_s is not None:
            wait = max(wait, min(asked_s, PATIENCE_S))
        patience.until = self.monotonic() + wait

    def _wait(self, left: int) -> float | None:
        if not left:
            return None
        now = self.monotonic()
        waits = [max(0.0, each.until - now) for each in self._documents.values()]
        # One that was not tried yet in this round can be, as soon as the server's time has come.
        soonest = min(waits) if waits and len(waits) >= left else 0.0
        return max(soonest, self._server.until - now, 0.0)

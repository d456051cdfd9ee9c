"""`Idempotency-Key`: the same request sent twice does its work once.

Every key is written to a journal before the work and again, with the answer, after it; both are synced. If the
program ended during the work of a key, the key is refused, because the progress of the work is unknown. A robot
is never moved a second time on a guess.
"""

from __future__ import annotations

import hashlib
import json
import os
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fastapi.responses import JSONResponse
from pydantic import BaseModel

from calib.errors import DataError
from calib.text import parse_json
from service.http.wire.problems import Problem
from service.refusals import REFUSALS

JOURNAL = "idempotency.jsonl"


@dataclass
class _Entry:
    fingerprint: str
    reply: dict[str, Any] | None = None
    done: threading.Event = field(default_factory=threading.Event)


def reply(status: int, content: dict[str, Any], *, location: str = "", retry_after: int = 0) -> JSONResponse:
    """Return a response with the headers that resources of this service have."""
    headers = {"Location": location} if location else {}
    if retry_after:
        headers["Retry-After"] = str(retry_after)
    return JSONResponse(content, status, headers)


def begun(collection: str, job: dict[str, Any]) -> JSONResponse:
    """Return 202 with a job of a collection, and the place of its state."""
    return reply(202, job, location=f"{collection}/{job['id']}", retry_after=1)


def fingerprint(request: Sequence[object]) -> str:
    """Return the hash of a request, from its destination and content.

    A large request takes as long as reading it.
    """
    text = json.dumps(request, sort_keys=True, default=_plain)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _plain(part: object) -> object:
    return part.model_dump() if isinstance(part, BaseModel) else str(part)


class IdempotencyKeys:
    """The keys of one record directory. Thread-safe."""

    def __init__(self, folder: Path) -> None:
        self._mutex = threading.Lock()
        self._syncing = threading.Lock()
        self._written = self._synced = 0  # lines
        self._entries: dict[str, _Entry] = {}
        path = folder / JOURNAL
        if path.is_file():
            for line in path.read_bytes().splitlines():
                self._read(line)
        self._journal = path.open("ab")
        if self._journal.tell():
            self._journal.write(b"\n")  # ends a line that was cut off; empty lines are skipped

    def _read(self, line: bytes) -> None:
        try:
            entry_read = parse_json(line, JOURNAL)
        except DataError:
            return  # the last line of a program that was killed while it wrote
        match entry_read:
            case {"what": "freed", "key": str(key)}:
                self._entries.pop(key, None)
            case {"what": "begun" | "done", "key": str(key), "fingerprint": str(request)}:
                self._entries[key] = entry = _Entry(request, entry_read.get("reply"))
                entry.done.set()

    def once(self, key: str, request: Sequence[object], work: Callable[[], JSONResponse]) -> JSONResponse:
        """Return the answer of `work`, which is done at most once per key.

        Without a key, it is always done. `request` is the destination and content; another request with the same key
        is refused.

        Raises
        ------
        Problem
            422 if the key was used for another request, 409 if the outcome of its work is unknown.
        """
        if not key:
            return work()
        asked = fingerprint(request)
        with self._mutex:
            entry = self._entries.get(key)
            mine = entry is None
            if entry is None:
                entry = self._entries[key] = _Entry(asked)
        if mine:
            return self._work(key, entry, work)
        if entry.fingerprint != asked:
            raise Problem(
                422,
                "This Idempotency-Key belongs to another request.",
                "Use a new key for a new request, and the same key only to repeat the same one.",
                code=8106,
            )
        entry.done.wait()
        if entry.reply is None:
            raise Problem(
                409,
                "This request was begun and its outcome is not known.",
                "Look at what there is (GET), then send it again with a new key if it is still needed.",
                code=8107,
            )
        reply = entry.reply
        return JSONResponse(
            reply["content"], reply["status"], {**reply["headers"], "Idempotent-Replay": "true"}
        )

    def _work(self, key: str, entry: _Entry, work: Callable[[], JSONResponse]) -> JSONResponse:
        try:
            self._write(what="begun", key=key, fingerprint=entry.fingerprint)
            answer = work()
            names = ("location", "retry-after")
            reply = {
                "status": answer.status_code,
                "headers": {name: answer.headers[name] for name in names if name in answer.headers},
                "content": json.loads(bytes(answer.body)),
            }
            entry.reply = reply
            with suppress(OSError):  # the work is done: a repeated request is answered from memory
                self._write(what="done", key=key, fingerprint=entry.fingerprint, reply=reply)
        except (Problem, OSError, *REFUSALS):
            # Refused, or the disk was full: nothing was made, so the key may be used again.
            try:
                self._write(what="freed", key=key)
            except OSError:
                pass
            finally:  # on a full disk, too: after freeing space, a client asks with this key again
                with self._mutex:
                    self._entries.pop(key)
            raise
        finally:
            entry.done.set()
        return answer

    def _write(self, **entry: Any) -> None:
        """Durable on return. Lines that come while the disk is busy share the next sync: none waits for many."""
        line = json.dumps(entry).encode() + b"\n"
        with self._mutex:
            self._journal.write(line)
            self._journal.flush()
            self._written += 1
            mine = self._written
        with self._syncing:
            if self._synced < mine:
                written = self._written
                os.fsync(self._journal.fileno())
                self._synced = written

    def close(self) -> None:
        self._journal.close()

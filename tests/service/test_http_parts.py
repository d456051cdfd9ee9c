"""Parts of the service by themselves: the keys, the gate of addresses, plain values."""

from __future__ import annotations

import json
import math
import os
import threading
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from fastapi.responses import JSONResponse
from pydantic import ValidationError
from starlette.types import Receive, Scope, Send

from acquisition.errors import StorageError
from calib.text import no_formula
from drivers.errors import ConfigError
from service.http.access.gate import AccessGate
from service.http.access.roles import ServiceSettings, Tokens
from service.http.wire.bodies.requests import LeaseRequest
from service.http.wire.problems import Problem, not_found
from service.http.work.idempotency import JOURNAL, IdempotencyKeys, fingerprint, reply
from service.ids import new_id, safe_id
from service.json_values import finite, utc_text
from service.refusals import cause
from tests.drivers.waiting import PATIENCE_S, in_thread, until


def test_the_work_of_a_key_is_done_once_by_however_many_ask(tmp_path: Path) -> None:
    done: list[int] = []
    go = threading.Event()

    def work() -> JSONResponse:
        go.wait(PATIENCE_S)
        done.append(1)
        return reply(202, {"id": "one"}, location="/one")

    with closing(IdempotencyKeys(tmp_path)) as keys:
        asked = [in_thread(lambda: keys.once("k", "print", work)) for _ in range(5)]
        go.set()
        answers = [each.result(PATIENCE_S) for each in asked]
    assert len(done) == 1
    assert {bytes(answer.body) for answer in answers} == {b'{"id":"one"}'}
    assert {answer.headers["location"] for answer in answers} == {"/one"}


def test_keys_outlive_the_program_and_work_cut_off_is_never_repeated(tmp_path: Path) -> None:
    with closing(IdempotencyKeys(tmp_path)) as keys:
        keys.once("done", "a", lambda: reply(201, {"id": "x"}))
        with pytest.raises(ConfigError):
            keys.once("refused", "a", _refuse)
        with pytest.raises(ZeroDivisionError):
            keys.once("fault", "a", lambda: reply(201, {"id": 1 // 0}))
    with (tmp_path / JOURNAL).open("a", encoding="utf-8") as journal:
        begun = {"what": "begun", "key": "cut off", "fingerprint": fingerprint("a")}
        journal.write(json.dumps(begun) + '\n{"what": "beg')
    for _ in range(2):  # the second program reads what the first has written after the broken line
        with closing(IdempotencyKeys(tmp_path)) as keys:
            assert json.loads(bytes(keys.once("done", "a", _never).body)) == {"id": "x"}
            for key in ("cut off", "fault"):
                with pytest.raises(Problem, match="outcome is not known"):
                    keys.once(key, "a", _never)
            with pytest.raises(Problem, match="another request"):
                keys.once("done", "b", _never)
            assert keys.once("refused", "a", lambda: reply(201, {"id": "y"})).status_code == 201


def test_a_key_that_cannot_be_written_lets_nobody_wait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with closing(IdempotencyKeys(tmp_path)) as keys:
        monkeypatch.setattr(os, "fsync", _no_space)
        with pytest.raises(OSError, match="No space"):
            keys.once("k", "a", _never)
        again = in_thread(lambda: keys.once("k", "a", _never))
        with pytest.raises(OSError, match="No space"):
            again.result(PATIENCE_S)
        monkeypatch.undo()  # there is room again
        assert keys.once("k", "a", lambda: reply(201, {"id": "made"})).status_code == 201


def test_a_disk_that_is_full_within_or_after_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing was made: the key may be used again. All was made: it never is done twice."""

    def full(*_: Any) -> JSONResponse:
        raise StorageError("record: database or disk is full")

    def made_then_full() -> JSONResponse:
        monkeypatch.setattr(os, "fsync", _no_space)
        return reply(201, {"id": "once"})

    with closing(IdempotencyKeys(tmp_path)) as keys:
        with pytest.raises(StorageError):
            keys.once("within", "a", full)
        assert keys.once("within", "a", lambda: reply(201, {})).status_code == 201
        assert keys.once("after", "a", made_then_full).status_code == 201
        assert json.loads(bytes(keys.once("after", "a", _never).body)) == {"id": "once"}


def _no_space(_: int) -> None:
    raise OSError(28, "No space left on device")


def test_lines_that_come_while_the_disk_is_busy_share_a_sync(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An answer to a prompt does not wait for the syncs of a hundred uploads before it."""
    synced: list[int] = []
    busy, go = threading.Event(), threading.Event()
    fsync = os.fsync

    def slow(handle: int) -> None:
        synced.append(handle)
        busy.set()
        go.wait(PATIENCE_S)
        fsync(handle)

    with closing(IdempotencyKeys(tmp_path)) as keys:
        monkeypatch.setattr(os, "fsync", slow)
        first = in_thread(lambda: keys.once("first", "a", lambda: reply(201, {})))
        busy.wait(PATIENCE_S)
        others = [
            in_thread(lambda n=n: keys.once(f"k{n}", "a", lambda: reply(201, {"id": n}))) for n in range(20)
        ]
        until(lambda: keys._written == 21)
        go.set()
        assert [each.result(PATIENCE_S).status_code for each in (first, *others)] == [201] * 21
        assert len(synced) < 42  # each line by itself
        written = len((tmp_path / JOURNAL).read_bytes().splitlines())
    assert written == 42


def _refuse() -> JSONResponse:
    raise ConfigError("no")


def _never() -> JSONResponse:
    raise AssertionError("done twice")


def test_a_key_is_on_the_disk_before_its_work_and_the_answer_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[int] = []
    monkeypatch.setattr("os.fsync", lambda handle: synced.append(os.fstat(handle).st_size))
    journal = tmp_path / JOURNAL

    def work() -> JSONResponse:
        assert synced == [journal.stat().st_size]
        assert b'"begun"' in journal.read_bytes()
        return reply(200, {})

    with closing(IdempotencyKeys(tmp_path)) as keys:
        keys.once("key", "request", work)
        assert synced[1:] == [journal.stat().st_size]


def test_fingerprints_tell_requests_apart() -> None:
    assert fingerprint(("/a", {"x": 1, "y": 2})) == fingerprint(("/a", {"y": 2, "x": 1}))
    assert fingerprint(("/a", {"x": 1})) != fingerprint(("/a", {"x": True}))
    assert fingerprint(("/a", {"x": 1})) != fingerprint(("/b", {"x": 1}))
    fingerprint(("/a", {"x": math.nan, "y": "\ud800"}))


@pytest.mark.parametrize(
    ("bound", "host", "good"),
    [
        ("127.0.0.1", "127.0.0.1:80", True),
        ("127.0.0.1", "localhost:80", True),
        ("127.0.0.1", "[::1]:80", True),
        ("127.0.0.1", "192.168.1.5", False),
        ("127.0.0.1", "localhost.evil.example", False),
        ("127.0.0.1", "127.0.0.1.evil.example", False),
        ("127.0.0.1", "", False),
        ("127.0.0.1", "[", False),
        ("0.0.0.0", "192.168.1.5:80", True),
        ("0.0.0.0", "evil.example", False),
        ("cell-pc", "cell-pc:80", True),
        ("cell-pc", "other-pc:80", False),
    ],
)
def test_which_hosts_are_ours(tmp_path: Path, bound: str, host: str, good: bool) -> None:
    async def nothing(scope: Scope, receive: Receive, send: Send) -> None: ...

    gate = AccessGate(nothing, ServiceSettings(record=tmp_path, tokens=Tokens("o", "v"), host=bound))
    assert gate._ours(host) is good


def test_several_of_what_is_not_there() -> None:
    told = [not_found(what, "x").do.split()[2] for what in ("run", "diagnosis", "watch")]
    assert told == ["runs", "diagnoses", "watches"]


def test_plain_values() -> None:
    assert finite({"a": [math.nan, 1.0, (math.inf, "x")], "b": None}) == {
        "a": [None, 1.0, [None, "x"]],
        "b": None,
    }
    assert utc_text(0.0) == "1970-01-01T00:00:00.000Z"


@pytest.mark.parametrize(
    "text", ["=1+1", "+A1", "-A1", "@SUM(A1)", "\t=1", "\r=1", "-", '=HYPERLINK("x")', "--1"]
)
def test_a_spreadsheet_works_out_no_cell(text: str) -> None:
    assert no_formula(text) == f"'{text}"


@pytest.mark.parametrize("text", ["", "a=1", "-1.5", "+2", "-1e-3", "17", "T1", " =1", "a-b"])
def test_numbers_and_plain_text_stay_as_they_are(text: str) -> None:
    assert no_formula(text) == text


def test_ids() -> None:
    ids = [new_id() for _ in range(1000)]
    assert all(safe_id(name) for name in ids)
    assert len(set(ids)) == 1000
    order = sorted(range(1000), key=lambda i: (ids[i][:21], i))
    assert order == list(range(1000))  # by time, to the microsecond
    for name in ("", ".", "..", "a/b", "-a", "a\n", ".hidden", "a" * 65, "a\x00"):
        assert not safe_id(name)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("/home/anna/cell/rec/record.sqlite3: is full", "rec/record.sqlite3: is full"),
        ("C:\\Users\\anna\\rec\\record.sqlite3: is full", "rec\\record.sqlite3: is full"),
        ("tcp://192.168.0.1:5000/a/b/c: no answer", "tcp://192.168.0.1:5000/a/b/c: no answer"),
        ("Ask POST /api/v1/cell/lease for it, 3/4 of it.", "Ask POST /api/v1/cell/lease for it, 3/4 of it."),
    ],
)
def test_refusals_do_not_tell_where_the_service_keeps_its_files(text: str, told: str) -> None:
    assert cause(StorageError(text)) == told + ("" if told.endswith(".") else ".")


@pytest.mark.parametrize("name", ["a\x00b", "a\nb", "a\x1b[2J"])
def test_names_hold_no_control_characters_and_numbers_are_numbers(name: str) -> None:
    with pytest.raises(ValidationError, match="control characters"):
        LeaseRequest.model_validate({"holder": name, "seconds": 30})
    with pytest.raises(ValidationError, match="valid number"):
        LeaseRequest.model_validate({"holder": "anna", "seconds": "300"})

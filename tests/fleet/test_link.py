"""The link to a fleet's server: the meaning of each answer.

These would catch: an answer of a proxy taken for an acknowledgement, a full server that sets documents aside, and a
refusal that is requested again for ever.
"""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import pytest

from calib.errors import DataError
from fleet.outbox import ServerLink, UploadAnswer
from fleet.store import Document
from tests.drivers.nobody import nobody_listens
from tests.fleet import documents

DOCUMENT = documents.model({"d1": 0.25})
KEPT = {"hash": DOCUMENT.hash, "state": "new"}


class Server:
    """Server that reads requests until `reads` accepts them, answers with bytes, and hangs up."""

    def __init__(self, answers: list[bytes], *, reads: Callable[[bytes], bool]) -> None:
        self.requests: list[bytes] = []
        self._answers, self._reads = answers, reads
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        for answer in self._answers:
            connection, _ = self._listener.accept()
            with connection:
                data = b""
                while not self._reads(data) and (piece := connection.recv(65536)):
                    data += piece
                self.requests.append(data)
                connection.sendall(answer)

    def close(self) -> None:
        self._thread.join()
        self._listener.close()


@contextmanager
def serving(*answers: bytes, reads: Callable[[bytes], bool] | None = None) -> Iterator[Server]:
    server = Server(list(answers), reads=reads or (lambda data: data.endswith(DOCUMENT.content)))
    try:
        yield server
    finally:
        server.close()


def http(status: int, body: bytes | Mapping[str, object] = b"", *headers: str) -> bytes:
    content = body if isinstance(body, bytes) else json.dumps(body).encode()
    lines = [
        f"HTTP/1.1 {status} Some reason",
        f"Content-Length: {len(content)}",
        "Connection: close",
        *headers,
    ]
    return "\r\n".join([*lines, "", ""]).encode() + content


def put(server: Server, document: Document = DOCUMENT) -> UploadAnswer:
    return ServerLink(f"http://127.0.0.1:{server.port}", "a-token-of-the-tests", timeout_s=20.0).put(document)


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        (http(201, KEPT), "kept"),
        (http(200, KEPT), "kept"),
        (http(200, {"hash": "0" * 64}), "barred"),  # the acknowledgement of something else
        (http(200, b"<html>Please log in</html>"), "barred"),  # a portal
        (http(200), "barred"),
        (http(200, b"[" * 100_000), "barred"),
        (http(204), "failed"),
        (http(302, b"", "Location: http://elsewhere/"), "barred"),
        (http(400, {"operator_text": "has another hash"}), "damaged"),
        (http(401), "barred"),
        (http(403), "barred"),
        (http(404), "barred"),
        (http(408), "failed"),
        (http(409, {"operator_text": "Another content."}), "refused"),
        (http(413), "refused"),
        (http(422), "refused"),
        (http(429), "away"),
        (http(500), "failed"),
        (http(502), "failed"),
        (http(503), "away"),
        (http(507), "away"),
        (b"", "failed"),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 500\r\n\r\n{", "failed"),
        (b"220 mail.example ESMTP\r\n", "failed"),
    ],
)
def test_what_an_answer_means(answer: bytes, kind: str) -> None:
    with serving(answer) as server:
        assert put(server).kind == kind


def test_what_is_sent() -> None:
    named = documents.of("watch", {"format": "truepose-watch/1"}, identity="Prüfung 7 & mehr/heute")
    with serving(http(201, {"hash": named.hash}), reads=lambda data: data.endswith(named.content)) as server:
        assert put(server, named).kind == "kept"
    head = server.requests[0].partition(b"\r\n\r\n")[0].decode("ascii")
    assert head.startswith(
        f"PUT /api/v1/documents/{named.hash}?kind=watch&serial=120-4711&model=irb120&cell=cell-1"
    )
    assert "identity=Pr%C3%BCfung+7+%26+mehr%2Fheute" in head
    assert "measured_at=2026-03-02T09%3A15%3A00%2B00%3A00" in head
    assert "Authorization: Bearer a-token-of-the-tests" in head


def test_the_server_says_when_and_why() -> None:
    problem = {"operator_text": "The store has no room left.", "what_to_do": "Make room."}
    with serving(http(507, problem, "Retry-After: 120")) as server:
        assert put(server) == UploadAnswer("away", "The store has no room left. Make room.", 120.0)
    with serving(http(503, b"", "Retry-After: Fri, 31 Dec 2027 23:59:59 GMT")) as server:
        assert put(server).after_s is None


def test_nobody_there() -> None:
    with nobody_listens() as port:
        answer = ServerLink(f"http://127.0.0.1:{port}", "token").put(DOCUMENT)
    assert answer.kind == "away"
    assert "does not answer" in answer.said


def test_a_refusal_before_the_body_is_read_is_heard() -> None:
    """The server answers 413 and disconnects while megabytes are still to come.

    Its answer counts, not the broken pipe.
    """
    large = Document("dataset", documents.ROBOT, "cell-1", "large", documents.BEGAN, b"x" * 8_000_000)
    with serving(http(413), reads=lambda data: b"\r\n\r\n" in data) as server:
        assert put(server, large).kind in ("refused", "failed")  # the system may have thrown the answer away
    with serving(
        http(401), reads=lambda data: data.endswith(b"x" * 1000) and len(data) > 8_000_000
    ) as server:
        assert put(server, large).kind == "barred"


def test_a_connection_that_was_kept_open_and_has_ended_is_no_failure() -> None:
    kept_open = http(201, KEPT).replace(b"Connection: close", b"Connection: keep-alive")
    with serving(kept_open, http(200, KEPT)) as server:
        link = ServerLink(f"http://127.0.0.1:{server.port}", "token", timeout_s=20.0)
        assert link.put(DOCUMENT).kind == "kept"
        assert link.put(DOCUMENT).kind == "kept"
    assert len(server.requests) == 2


@pytest.mark.parametrize(
    "url", ["", "plant", "ftp://plant:80", "http://", "http://plant:99999", "http://a?b"]
)
def test_what_is_no_address_is_refused(url: str) -> None:
    with pytest.raises(DataError, match="--to"):
        ServerLink(url, "token")

"""The link to a fleet's server: one upload, and what its answer means for the document.

    kept      the server acknowledges the same hash
    refused   it will not take this document, whatever is tried (409, 413, 415, 422; 403 of a robot that the token does
              not name)
    damaged   what arrived was not what was sent (400)
    failed    this try came to nothing: no answer, or a fault of the server
    away      nobody answers there, or the server says that it cannot take anything now (429, 503, 507)
    barred    it answers and will never take anything so: token, address, or not a fleet's server

An upload may be sent any number of times: what arrives twice is kept once. Standard library alone.
"""

from __future__ import annotations

import http.client
import io
import json
import ssl
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal
from urllib.parse import urlencode, urlsplit

from calib.errors import DataError
from fleet.store import Document

TIMEOUT_S = 60.0  # of one step of a request: to connect, to send a piece, to wait for the answer
LONGEST_ANSWER = 256 * 1024  # bytes
_REFUSED = (409, 413, 415, 422)
_OTHER_ROBOT = 8612  # code of a 403 that is of this document alone
_AWAY = (429, 503, 507)
_BARRED = (401, 403, 404, 405, 406, 411, 421, 426, 451)


@dataclass(frozen=True)
class UploadAnswer:
    """A server's answer to an upload.

    `said` is its text, for the person at the cell. `after_s` states when to try again, None if the server does not
    state it.
    """

    kind: Literal["kept", "refused", "damaged", "failed", "away", "barred"]
    said: str = ""
    after_s: float | None = None


class _Nobody(Exception):
    """The server cannot be reached: another document would fail as well."""


class ServerLink:
    """The connection to one server, kept open between uploads.

    Parameters
    ----------
    url
        Address as `truepose fleet serve` prints it; its path precedes `/api/v1`.

    Raises
    ------
    DataError
        The address is not valid.
    """

    def __init__(self, url: str, token: str, *, timeout_s: float = TIMEOUT_S) -> None:
        parts = urlsplit(url)
        try:
            port = parts.port
        except ValueError:
            port = 0
        if (
            parts.scheme not in ("http", "https")
            or not parts.hostname
            or port == 0
            or parts.query
            or parts.fragment
        ):
            raise DataError(
                f"{url!r} is not the address of a server.", do="Give http://ADDRESS:PORT.", key="--to"
            )
        self.place = f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}"
        self._base = parts.path.rstrip("/") + "/api/v1/documents/"
        self._token = token
        if parts.scheme == "https":
            self._connection: http.client.HTTPConnection = http.client.HTTPSConnection(
                parts.hostname, port, timeout=timeout_s, context=ssl.create_default_context()
            )
        else:
            self._connection = http.client.HTTPConnection(parts.hostname, port, timeout=timeout_s)

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    def put(self, document: Document) -> UploadAnswer:
        """Upload a document."""
        try:
            answer, data = self._exchange(document)
        except _Nobody as error:
            return UploadAnswer("away", f"{self.place} does not answer ({error}).")
        except ssl.SSLError as error:  # before OSError, which it is
            self._connection.close()
            return UploadAnswer("barred", f"{self.place} cannot be trusted ({_words(error)}).")
        except (OSError, http.client.HTTPException) as error:
            self._connection.close()
            return UploadAnswer(
                "failed", f"{self.place} was cut off before it had acknowledged ({_words(error)})."
            )
        return self._meaning(answer, data, document.hash)

    def _exchange(self, document: Document) -> tuple[http.client.HTTPResponse, bytes]:
        """Send a request and read its answer.

        Raises
        ------
        _Nobody
            There is no connection.
        OSError, HTTPException
            The connection failed later.
        """
        if self._connection.sock is not None:
            with suppress(ConnectionError):  # it was kept open, and may have ended meanwhile
                return self._send(document)
            self._connection.close()
        try:
            self._connection.connect()
        except ssl.SSLError:
            raise
        except OSError as error:
            raise _Nobody(_words(error)) from error
        return self._send(document)

    def _send(self, document: Document) -> tuple[http.client.HTTPResponse, bytes]:
        said = {
            "kind": document.kind,
            "serial": document.robot.serial,
            "model": document.robot.model,
            "cell": document.cell,
            "identity": document.identity,
            "measured_at": document.measured_at.isoformat(),
        }
        headers = {
            "Authorization": f"Bearer {self._token}",
            "Content-Type": "application/octet-stream",
            "Content-Length": str(len(document.content)),
            "Accept": "application/json",
        }
        body = io.BytesIO(
            document.content
        )  # sent piece by piece: the timeout is of a piece, on a slow line too
        with suppress(
            ConnectionError
        ):  # a server may refuse before it has received everything: its answer states it
            self._connection.request("PUT", f"{self._base}{document.hash}?{urlencode(said)}", body, headers)
        answer = self._connection.getresponse()
        data = answer.read(LONGEST_ANSWER)
        if answer.length and len(data) < LONGEST_ANSWER:  # cut off, of which such a `read` says nothing
            raise http.client.IncompleteRead(data, answer.length)
        if answer.will_close or not answer.isclosed():
            self._connection.close()
        return answer, data

    def _meaning(self, answer: http.client.HTTPResponse, data: bytes, hash_: str) -> UploadAnswer:
        status, document = answer.status, _document(data)
        if status in (200, 201):
            if document.get("hash") == hash_:
                return UploadAnswer("kept")
            return UploadAnswer(
                "barred", f"{self.place} answers, but not as a fleet's server: is a proxy between?"
            )
        said = f"{document.get('operator_text', '')} {document.get('what_to_do', '')}".strip()
        said = said or f"{self.place} answers {status} {answer.reason}"
        if status in _REFUSED or (status == 403 and document.get("code") == _OTHER_ROBOT):
            return UploadAnswer("refused", said)
        if status == 400:
            return UploadAnswer("damaged", said)
        if status in _AWAY:
            return UploadAnswer("away", said, _seconds(answer.getheader("Retry-After", "")))
        if status in _BARRED or 300 <= status < 400:
            return UploadAnswer("barred", said)
        return UploadAnswer("failed", said)


def _document(data: bytes) -> Mapping[str, Any]:
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return document if isinstance(document, dict) else {}


def _seconds(text: str) -> float | None:
    """Parse Retry-After in seconds; dates, which a fleet server does not send, are ignored."""
    return float(text) if text.isdecimal() and len(text) < 8 else None


def _words(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error) or type(error).__name__

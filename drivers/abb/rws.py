"""Robot Web Services 2 (RWS 2) of an ABB OmniCore controller, RobotWare 7, over HTTPS.

It reads states and joints, and stops the program, one question at a time. Its facts come from public clients that were
run against RobotWare 7: Meraj Safari's `abb-rws-client` (`src/rws2/*.ts` and its recorded answers), and a `node-red`
palette for GoFa. States and modes come from ABB's manual of RWS 1 (developercenter.robotstudio.com/api/rwsApi).

- HTTP Basic authentication, where RWS 1 of RobotWare 6 has Digest; the certificate is made by the controller itself.
- `Accept: application/hal+json;v=2.0`; forms are `application/x-www-form-urlencoded;v=2.0`. Other types are answered
  with 406. A resource is an object of the list `state` with `_type`, and its numbers are texts.
- The first answer sets the cookies of a session, which lasts 300 s beyond the last question. A client that forgets its
  cookies opens a session per question, and beyond some 70 of them, or 20 questions a second, the controller answers
  503.
- `POST /rw/rapid/execution/stop` ends every normal task, needs no mastership on RobotWare 7, and leaves SEMISTATIC
  tasks running.

The certificate is pinned: its SHA-256 is compared before the first byte of a question, so a password reaches no other
controller. The driver has not been tried on a controller.
"""

from __future__ import annotations

import base64
import hashlib
import http.client
import json
import math
import os
import re
import socket
import ssl
import stat
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlencode

from drivers.errors import (
    Busy,
    CommandRefused,
    ConfigError,
    ErrorPlace,
    LinkLost,
    LinkTimeout,
    ProtocolError,
    naming,
)
from drivers.interfaces import RobotStatus
from drivers.link import WireSink

FACTORY_USER, _FACTORY_PASSWORD = "Default User", "robotics"  # of every controller, as ABB delivers it
CONTROLLER, MODE, EXECUTION = "/rw/panel/ctrl-state", "/rw/panel/opmode", "/rw/rapid/execution"
JOINTS, SYSTEM, STOP = "/rw/motionsystem/mechunits/ROB_1/jointtarget", "/rw/system", f"{EXECUTION}/stop"
_HAL, _FORM = "application/hal+json;v=2.0", "application/x-www-form-urlencoded;v=2.0"
_MOST_BYTES = 65536
_WIDEST_DEG = 1000.0
_NUMBER = re.compile(r"-?\d{1,12}(?:\.\d{1,20})?(?:[eE][+-]?\d{1,3})?")
_FINGERPRINT = re.compile(r"[0-9a-f]{64}")
_MODES = {"AUTO": "auto", "MANR": "reduced", "MANF": "manual", "MANF_CH": "manual", "AUTO_CH": "manual"}
_STATES = {"init", "motoroff", "motoron", "guardstop", "emergencystop", "emergencystopreset", "sysfail"}
_WITHOUT = "Or leave rws out of the address: the robot is then driven without the second channel."
_PIN = (
    "Compare it with the fingerprint that a browser shows for the controller on its service port, then write it into "
    "the cell file as rws_fingerprint."
)
_OLDER = (
    "The second channel needs RWS 2 of RobotWare 7 (OmniCore). On RobotWare 6 (IRC5) leave rws out of the address; "
    "CALBACK on the next port reports the same states there."
)


@dataclass(frozen=True, slots=True)
class RwsAccess:
    """The address of Robot Web Services, the certificate that it must show, and who asks.

    `fingerprint` is the SHA-256 of the certificate, 64 hexadecimal digits without colons; empty if it is not known.
    """

    host: str
    port: int
    fingerprint: str
    user: str = FACTORY_USER
    password: str = field(default=_FACTORY_PASSWORD, repr=False)


@dataclass(frozen=True, slots=True)
class RwsState:
    """State of the controller according to Robot Web Services."""

    mode: str  # as in RobotStatus
    controller: str  # "motoron", "guardstop", ...
    runs: bool  # the normal RAPID tasks, T_ROB1 among them
    joints_deg: tuple[float, ...]
    raw: bytes

    @property
    def status(self) -> RobotStatus:
        """The same as the status of a robot; an emergency stop counts until it is confirmed."""
        stopped = self.controller in ("emergencystop", "emergencystopreset")
        return RobotStatus(self.mode, self.controller == "motoron", stopped, None, None, self.raw)


def pinned(text: str, device: str) -> str:
    """Return a fingerprint without colons and in small letters.

    Raises
    ------
    ConfigError
        It is not a SHA-256.
    """
    plain = text.replace(":", "").strip().lower()
    if text and not _FINGERPRINT.fullmatch(plain):
        raise ConfigError(
            f"rws_fingerprint {text!r} is not a SHA-256 of 64 hexadecimal digits",
            device=device,
            what_to_do="Copy the SHA-256 fingerprint of the controller's certificate; 'truepose doctor' shows it.",
        )
    return plain


def password_in(file: str, device: str) -> str:
    """Read a password from the first line of a file that no other user may read.

    Raises
    ------
    ConfigError
        The file cannot be read, is empty, or others can read it.
    """
    path = Path(file).expanduser()
    try:
        others = os.name == "posix" and path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO)
        text = path.read_text(encoding="utf-8").partition("\n")[0].strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"rws_password_file {path} cannot be read: {getattr(error, 'strerror', None) or 'not UTF-8 text'}",
            device=device,
            what_to_do="Give the path of a text file, from / or ~ on, with the password in its first line.",
        ) from error
    if others or not text:
        wrong = "can be read by other users" if others else "is empty"
        raise ConfigError(
            f"rws_password_file {path} {wrong}",
            device=device,
            what_to_do=f"Write the password into its first line, then: chmod 600 {path}",
        )
    return text


def texts_of(raw: bytes, kind: str, *names: str) -> tuple[str, ...]:
    """Return texts of the one resource of type `kind` in an answer.

    Raises
    ------
    ProtocolError
        There is not exactly one, or it lacks a text.
    """
    try:
        (found,) = [each for each in json.loads(raw)["state"] if each["_type"] == kind]
        texts = tuple(found[name] for name in names)
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ProtocolError(f"the answer has no {kind} with {', '.join(names)}", raw=raw) from error
    if not all(isinstance(text, str) for text in texts):
        raise ProtocolError(f"{', '.join(names)} of {kind} are not texts", raw=raw)
    return texts


def parse_joints(raw: bytes) -> tuple[float, ...]:
    """Return the six joint angles (deg) of a jointtarget.

    Raises
    ------
    ProtocolError
        The answer has another form.
    """
    texts = texts_of(raw, "ms-jointtarget", *(f"rax_{i}" for i in range(1, 7)))
    if not all(_NUMBER.fullmatch(text) for text in texts):
        raise ProtocolError("joint angles are not numbers", raw=raw)
    joints = tuple(float(text) for text in texts)
    if not all(math.isfinite(q) and abs(q) < _WIDEST_DEG for q in joints):
        raise ProtocolError("joint angle out of range", raw=raw)
    return joints


class RwsSession:
    """A session with Robot Web Services.

    It is not shared between threads, except `abort`. A question that the controller answers on a dead connection is put
    again on a new one, since all of them can be repeated.

    Parameters
    ----------
    limit_s
        Longest duration of a question, s, however slowly the answer comes.
    """

    def __init__(
        self,
        access: RwsAccess,
        device: str,
        limit_s: float,
        *,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.access = access
        self.device = device
        self.limit_s = limit_s
        self.cookies: dict[str, str] = {}
        self._wire = wire
        self._clock = clock
        self._connection: http.client.HTTPSConnection | None = None
        self._said: dict[str, bytes] = {}  # the last answer to each question on record

    # -- questions ----------------------------------------------------------------------------------------

    def version(self) -> str:
        """Return the version of RobotWare.

        Raises
        ------
        LinkError
            The connection failed, or another service answers; the message names it.
        ConfigError
            The certificate is not pinned, or user and password are wrong.
        """
        return self._text(SYSTEM, "sys-system", "rwversion")[0]

    def state(self) -> RwsState:
        """Return states and joint angles, asked one after the other; errors are those of `version`."""
        controller, raw = self._text(CONTROLLER, "pnl-ctrlstate", "ctrlstate")
        mode, _ = self._text(MODE, "pnl-opmode", "opmode")
        runs = self.runs()
        if controller not in _STATES:
            raise self._damaged(f"unknown state {controller!r}", CONTROLLER, raw)
        return RwsState(_MODES.get(mode, "unknown"), controller, runs, self.joints(), raw)

    def runs(self) -> bool:
        """Return whether the normal RAPID tasks run; errors are those of `version`."""
        found, raw = self._text(EXECUTION, "rap-execution", "ctrlexecstate")
        if found not in ("running", "stopped"):
            raise self._damaged(f"unknown execution state {found!r}", EXECUTION, raw)
        return found == "running"

    def joints(self) -> tuple[float, ...]:
        """Return the joint angles, deg; errors are those of `version`."""
        raw = self._ask("GET", JOINTS)
        with self._understood(JOINTS):
            return parse_joints(raw)

    def halt(self) -> None:
        """Order the normal RAPID tasks to stop; the answer does not mean that the robot is at rest.

        Raises
        ------
        LinkError
            The connection failed.
        CommandRefused
            The user may not stop programs.
        """
        self._ask("POST", STOP, {"stopmode": "stop", "usetsp": "normal"})

    def close(self) -> None:
        """End the session, so that the controller can give its place to another one; never raises."""
        if self._connection is not None and self.cookies:
            with suppress(Exception):
                self._exchange("GET", "/logout", None)
        self._drop()
        self.cookies = {}

    def abort(self) -> None:
        """Break the connection; a question under way ends. From any thread; never raises."""
        sock = None if self._connection is None else self._connection.sock
        if sock is not None:
            with suppress(OSError):
                socket.socket.shutdown(sock, socket.SHUT_RDWR)  # wakes its reader, who closes it

    def _drop(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            with suppress(OSError):
                connection.close()

    # -- HTTP ---------------------------------------------------------------------------------------------

    def _text(self, path: str, kind: str, name: str) -> tuple[str, bytes]:
        raw = self._ask("GET", path)
        with self._understood(path):
            return texts_of(raw, kind, name)[0], raw

    @contextmanager
    def _understood(self, path: str) -> Iterator[None]:
        """Name the device in an error of parsing, and close the connection."""
        try:
            with naming(self.device, path):
                yield
        except ProtocolError:
            self._drop()
            raise

    def _ask(self, method: str, path: str, form: dict[str, str] | None = None) -> bytes:
        reused = self._connection is not None
        try:
            return self._exchange(method, path, form)
        except LinkLost:
            if not reused:
                raise
        return self._exchange(method, path, form)  # it closes a connection that it finds idle

    def _exchange(self, method: str, path: str, form: dict[str, str] | None) -> bytes:
        with self._within(f"{method} {path}"):
            connection = self._connection or self._open()
            body = None if method == "GET" else urlencode(form or {})
            connection.request(method, path, body, self._headers(method))
            answer = connection.getresponse()
            data = answer.read(_MOST_BYTES + 1)
            if answer.length and len(data) <= _MOST_BYTES:  # a limited read does not complain
                raise http.client.IncompleteRead(data, answer.length)
            for cookie in answer.headers.get_all("Set-Cookie") or ():
                name, _, value = cookie.partition(";")[0].partition("=")
                self.cookies[name.strip()] = value.strip()
        self._record(method, path, answer.status, data)
        self._judge(path, answer, data)
        return data

    def _headers(self, method: str) -> dict[str, str]:
        who = f"{self.access.user}:{self.access.password}".encode()
        headers = {"Accept": _HAL, "Authorization": f"Basic {base64.b64encode(who).decode()}"}
        if self.cookies:
            headers["Cookie"] = "; ".join(f"{name}={value}" for name, value in self.cookies.items())
        return headers if method == "GET" else headers | {"Content-Type": _FORM}

    def _judge(self, path: str, answer: http.client.HTTPResponse, data: bytes) -> None:
        """Raise the error of an answer that is none to a question of RWS 2."""
        status, kind = answer.status, answer.headers.get("Content-Type", "")
        challenge = answer.headers.get("WWW-Authenticate", "").lower()
        if status == 401 and challenge.startswith("digest"):
            raise self._damaged(
                "RWS 1 of RobotWare 6 answers (Digest authentication)", path, data, what_to_do=_OLDER
            )
        if status == 401:
            raise ConfigError(
                f"Robot Web Services refuse the user {self.access.user!r} or the password",
                device=self.device,
                command=path,
                what_to_do="Correct rws_user, or the password in rws_password_file, in the cell file.",
            )
        if status == 403:
            raise CommandRefused(
                f"Robot Web Services refuse this to the user {self.access.user!r}",
                device=self.device,
                command=path,
                raw=data,
                what_to_do="Give the user the right to execute programs, and to stop them remotely in automatic mode.",
            )
        if status == 503:
            raise Busy(
                "Robot Web Services have no free session, or too many questions",
                device=self.device,
                command=path,
                what_to_do="End other programs that use them. A session that was left open ends after 300 s.",
            )
        if status == 406 or (status == 200 and "json" not in kind):
            raise self._damaged(
                f"the controller does not answer in {_HAL}",
                path,
                data,
                what_to_do=f"Update RobotWare 7. {_WITHOUT}",
            )
        if status not in (200, 204):
            raise self._damaged(f"HTTP status {status}", path, data)
        if len(data) > _MOST_BYTES:
            raise self._damaged(f"an answer longer than {_MOST_BYTES} bytes", path, data[:200])

    def _damaged(
        self, message: str, path: str, raw: bytes, *, what_to_do: str | None = None
    ) -> ProtocolError:
        self._drop()
        return ProtocolError(message, device=self.device, command=path, raw=raw[:500], what_to_do=what_to_do)

    @contextmanager
    def _within(self, command: str) -> Iterator[None]:
        """Enclose an exchange: it ends within `limit_s`, and an error closes the connection."""
        late = threading.Event()

        def end() -> None:
            late.set()
            self.abort()

        timer = threading.Timer(self.limit_s, end)
        timer.daemon = True
        timer.start()
        try:
            yield
        except (OSError, http.client.HTTPException, ValueError) as error:
            self._drop()
            where: ErrorPlace = {"device": self.device, "command": command}
            if late.is_set() or isinstance(error, TimeoutError):
                raise LinkTimeout(f"no complete answer within rws_s = {self.limit_s:g} s", **where) from error
            words = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise LinkLost(f"Robot Web Services not reachable: {words}", **where) from error
        except BaseException:
            self._drop()
            raise
        finally:
            timer.cancel()

    def _open(self) -> http.client.HTTPSConnection:
        """Connect and compare the certificate; nothing is asked before it is the right one.

        Raises
        ------
        ConfigError
            No certificate is pinned.
        ProtocolError
            It shows another certificate, or it does not speak TLS.
        """
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname, context.verify_mode = (
            False,
            ssl.CERT_NONE,
        )  # no authority signs them; see below
        address = self.access.host, self.access.port
        connection = http.client.HTTPSConnection(*address, timeout=self.limit_s, context=context)
        connection.auto_open = 0  # by itself it would connect again, and ask whoever answers
        plain = socket.create_connection(address, timeout=self.limit_s)
        plain.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        tls = context.wrap_socket(plain, do_handshake_on_connect=False)
        connection.sock, self._connection = tls, connection
        try:
            tls.do_handshake()
        except ssl.SSLError as error:
            raise self._without_tls(error) from error
        shown = hashlib.sha256(tls.getpeercert(binary_form=True) or b"").hexdigest()
        self._log("!", f"open {address[0]}:{address[1]} {shown}".encode())
        if not self.access.fingerprint:
            raise ConfigError(
                f"rws_fingerprint is missing; this controller shows a certificate with the SHA-256 {shown}",
                device=self.device,
                command="connect",
                what_to_do=_PIN,
            )
        if shown != self.access.fingerprint:
            raise self._damaged(
                f"Robot Web Services show another certificate, with the SHA-256 {shown}",
                "connect",
                b"",
                what_to_do=f"If the controller was renewed or exchanged: {_PIN[0].lower()}{_PIN[1:]}",
            )
        return connection

    def _without_tls(self, error: ssl.SSLError) -> ProtocolError | LinkLost:
        """Return an error that names the server without TLS, asked without user and password."""
        plain = http.client.HTTPConnection(self.access.host, self.access.port, timeout=self.limit_s)
        challenge = ""
        with suppress(OSError, http.client.HTTPException):
            plain.request("GET", CONTROLLER, headers={"Accept": _HAL})
            challenge = plain.getresponse().headers.get("WWW-Authenticate", "").lower()
        plain.close()
        where: ErrorPlace = {"device": self.device, "command": "connect"}
        if challenge.startswith("digest"):
            return ProtocolError(
                "RWS 1 of RobotWare 6 answers (HTTP with Digest authentication)", **where, what_to_do=_OLDER
            )
        if challenge.startswith("basic"):
            do = f"Use the port of HTTPS, 443: without TLS the password could be read by anybody. {_WITHOUT}"
            return ProtocolError("Robot Web Services answer without TLS", **where, what_to_do=do)
        return LinkLost(f"no TLS connection: {error.reason or error}", **where)

    # -- record -------------------------------------------------------------------------------------------

    def _record(self, method: str, path: str, status: int, data: bytes) -> None:
        """Record a question and its answer, without user and password, if the answer is new."""
        said = b"%d %b" % (status, data)
        if self._said.get(path) != said:
            self._said[path] = said
            self._log(">", f"{method} {path}".encode())
            self._log("<", said)

    def _log(self, direction: str, data: bytes) -> None:
        if self._wire is not None:
            self._wire.record(self.device, direction, data)

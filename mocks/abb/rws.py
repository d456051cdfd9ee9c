"""Simulated Robot Web Services of ABB: RWS 2 of an OmniCore, or RWS 1 of an IRC5.

Written from public descriptions and recorded answers, not from the driver. RWS 2 is HTTPS with a certificate that is
made when the simulator starts, Basic authentication and HAL JSON. RWS 1 is HTTP with Digest authentication, and JSON
if `json=1` requests it, otherwise XHTML. These properties are kept on purpose:

- A client without the cookies of its session opens another one. Beyond 70 the controller answers 503, until a session
  was not used for 300 s or is ended by `/logout`.
- Without `v=2.0` in `Accept`, or in the type of a form, RWS 2 answers 406. Paths of the other version are 404.
- A stop of the program leaves the sockets of RAPID open and silent, as an emergency stop does.
- Joints have seven significant digits.
"""

from __future__ import annotations

import asyncio
import base64
import datetime
import hashlib
import json
import re
import secrets
import ssl
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import parse_qs, urlsplit

import h11
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from mocks.shared.arm_device import ArmDevice
from mocks.world.robots import Robot

MOST_SESSIONS, SESSION_S = 70, 300.0
_HAL, _FORM = "application/hal+json;v=2.0", "application/x-www-form-urlencoded;v=2.0"
_REALM = "validusers@robapi.abb"
_OPMODES = {"auto": "AUTO", "manual": "MANR", "manual_full": "MANF"}
_GOOD, _NO_SUCH, _NOT_ALLOWED = 294912, -1073445879, -1073445867  # as recorded of RobotWare 7.21
_STOP_MODES, _TASKS = {"cycle", "instr", "stop", "qstop"}, {"normal", "alltsk"}

Answer = tuple[int, str, str, dict[str, str]]  # status, type, body, further headers


def _certificate(folder: Path) -> tuple[Path, Path]:
    """Write a new key, and a certificate that it signs itself."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "simulated OmniCore")])
    now = datetime.datetime.now(datetime.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))
        .not_valid_after(now + datetime.timedelta(days=3650))
        .sign(key, hashes.SHA256())
    )
    files = folder / "certificate.pem", folder / "key.pem"
    files[0].write_bytes(made.public_bytes(serialization.Encoding.PEM))
    plain, form = serialization.NoEncryption(), serialization.PrivateFormat.PKCS8
    files[1].write_bytes(key.private_bytes(serialization.Encoding.PEM, form, plain))
    return files


class RwsServer:
    """Web server of a controller.

    Attributes
    ----------
    users
        Passwords by user.
    fingerprint
        SHA-256 of the certificate.
    asked
        Method and path of every request that was let in.
    """

    def __init__(self, arm: ArmDevice, robot: Robot) -> None:
        self.arm = arm
        self.robot = robot
        self.old = False  # RWS 1
        self.users = {"Default User": "robotics"}
        self.version = "7.13.0+294"
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.fingerprint = ""
        self.renew()
        self.asked: list[str] = []
        self.sessions: dict[str, float] = {}  # last use, s
        self.busy = False  # always 503
        self.may_stop = True
        self.off_deg = 0.0  # by which joint 1 is told wrongly
        self.closes = False  # every connection after one answer
        self.mode = ""  # that is told instead of the true one
        self.version_of_json = "2.0"
        self._heard = asyncio.Event()  # cleared: it does not answer
        self._heard.set()
        self._nonce = secrets.token_hex(16)

    def renew(self) -> None:
        """Take a new certificate, as a controller that was set up again."""
        with TemporaryDirectory() as folder:
            files = _certificate(Path(folder))
            self.context.load_cert_chain(*files)
            der = ssl.PEM_cert_to_DER_cert(files[0].read_text("ascii"))
        self.fingerprint = hashlib.sha256(der).hexdigest()

    def orders(self) -> dict[str, Callable[[dict[str, Any]], None]]:
        """Return the orders of the back door: `{"do": "rws", "busy": true, "silent": true, ...}`."""
        return {"rws": self._order}

    def _order(self, order: dict[str, Any]) -> None:
        known = {"busy", "closes", "may_stop", "off_deg", "mode", "version_of_json"}
        for name, value in order.items():
            if name in known:
                setattr(self, name, value)
            elif name == "silent":
                self._heard.clear() if value else self._heard.set()
            elif name == "renew":
                self.renew()
            elif name != "do":
                raise ValueError(f"{name} is not one of {', '.join(sorted(known))}, silent, renew")

    # -- HTTP ---------------------------------------------------------------------------------------------

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        wire = h11.Connection(h11.SERVER)
        try:
            while (asked := await self._next(wire, reader)) is not None:
                await self._heard.wait()
                status, kind, body, more = self._answered(*asked)
                data = body.encode()
                headers = [("Content-Length", str(len(data))), ("Server", "simulated"), *more.items()]
                if self.closes:
                    headers.append(("Connection", "close"))
                if kind:
                    headers.append(("Content-Type", kind))
                writer.write(wire.send(h11.Response(status_code=status, headers=headers)) or b"")
                writer.write((wire.send(h11.Data(data=data)) or b"") + (wire.send(h11.EndOfMessage()) or b""))
                await writer.drain()
                if wire.our_state is h11.MUST_CLOSE:
                    return
                wire.start_next_cycle()
        except h11.RemoteProtocolError:
            return

    async def _next(
        self, wire: h11.Connection, reader: asyncio.StreamReader
    ) -> tuple[str, str, dict[str, str], str] | None:
        request, body = None, b""
        while True:
            event = wire.next_event()
            if event is h11.NEED_DATA:
                wire.receive_data(await reader.read(4096))
            elif isinstance(event, h11.Request):
                request = event
            elif isinstance(event, h11.Data):
                body += bytes(event.data)
            elif isinstance(event, h11.EndOfMessage) and request is not None:
                headers = {name.decode().lower(): value.decode("latin-1") for name, value in request.headers}
                return request.method.decode(), request.target.decode(), headers, body.decode("latin-1")
            else:
                return None

    def _answered(self, method: str, target: str, headers: Mapping[str, str], body: str) -> Answer:
        return (self._rws1 if self.old else self._rws2)(method, target, headers, body)

    # -- RWS 2 --------------------------------------------------------------------------------------------

    def _rws2(self, method: str, target: str, headers: Mapping[str, str], body: str) -> Answer:
        path = urlsplit(target).path
        found = self._session(headers)
        if len(found) == 4:
            return found
        session, more = found
        accept = headers.get("accept", "*/*")
        wanted = f"application/hal+json;v={self.version_of_json}"
        if wanted not in accept.replace(" ", "") and "*/*" not in accept:
            return self._bad(406, "Not acceptable", more)
        if method == "POST" and headers.get("content-type", "").replace(" ", "") != _FORM:
            return self._bad(406, "Not acceptable", more)
        self.asked.append(f"{method} {path}")
        if path == "/logout":
            self.sessions.pop(session, None)
            return 204, "", "", {}
        if method == "POST":
            return self._posted(path, parse_qs(body), more)
        states: dict[str, Callable[[], dict[str, str]]] = {
            "/rw/panel/ctrl-state": self._controller,
            "/rw/panel/opmode": self._opmode,
            "/rw/rapid/execution": self._execution,
            "/rw/motionsystem/mechunits/ROB_1/jointtarget": self._jointtarget,
            "/rw/system": self._system,
        }
        if path not in states:
            return self._bad(404, f"rws.cpp ERROR: {path} does not exist", more)
        links = {"base": {"href": f"https://127.0.0.1{path}/"}, "self": {"href": ""}}
        told = {"_links": links, "status": {"code": _GOOD}, "state": [states[path]()]}
        return 200, _HAL, json.dumps(told), more

    def _session(self, headers: Mapping[str, str]) -> tuple[str, dict[str, str]] | Answer:
        """Return the session of a request and the headers that begin it, or a refusal."""
        now = time.monotonic()
        self.sessions = {name: used for name, used in self.sessions.items() if now - used < SESSION_S}
        known = re.search(r"-http-session-=([^;]+)", headers.get("cookie", ""))
        if known and known[1] in self.sessions and not self.busy:
            self.sessions[known[1]] = now
            return known[1], {}
        scheme, _, given = headers.get("authorization", "").partition(" ")
        user, _, password = base64.b64decode(given if scheme == "Basic" else b"").decode().partition(":")
        if not password or self.users.get(user) != password:
            return 401, "", "", {"WWW-Authenticate": f'Basic realm="{_REALM}"'}
        if self.busy or len(self.sessions) >= MOST_SESSIONS:
            return 503, "", "", {}
        session = f"{len(self.sessions) + 1}::http.session::{secrets.token_hex(16)}"
        self.sessions[session] = now
        return session, {"Set-Cookie": f"-http-session-={session}; path=/; secure; httponly"}

    def _posted(self, path: str, form: Mapping[str, list[str]], more: dict[str, str]) -> Answer:
        if path != "/rw/rapid/execution/stop":
            return self._bad(404, f"rws.cpp ERROR: {path} does not exist", more)
        mode, tasks = form.get("stopmode", [""])[0], form.get("usetsp", ["normal"])[0]
        if mode not in _STOP_MODES or tasks not in _TASKS:
            return self._bad(400, "Invalid value in form data", more)
        if not self.may_stop:
            return self._bad(403, "The user is not allowed access", more, _NOT_ALLOWED)
        self.arm.supervise()
        return 204, "", "", more

    @staticmethod
    def _bad(status: int, text: str, more: dict[str, str], code: int = _NO_SUCH) -> Answer:
        told = {"_links": {"base": {"href": "https://127.0.0.1/"}}, "status": {"code": code, "msg": text}}
        return status, _HAL, json.dumps(told), more

    # -- states -------------------------------------------------------------------------------------------

    def _controller(self) -> dict[str, str]:
        arm = self.arm
        held = "motoron" if arm.motors_on else "guardstop" if arm.mode != "auto" else "motoroff"
        state = "emergencystop" if arm.emergency_stop else held
        return {"_type": "pnl-ctrlstate", "_title": "ctrl-state", "ctrlstate": state}

    def _opmode(self) -> dict[str, str]:
        return {"_type": "pnl-opmode", "_title": "opmode", "opmode": self.mode or _OPMODES[self.arm.mode]}

    def _execution(self) -> dict[str, str]:
        state = "stopped" if self.arm.hung else "running"
        return {"_type": "rap-execution", "_title": "execution", "ctrlexecstate": state, "cycle": "forever"}

    def _jointtarget(self) -> dict[str, str]:
        joints = list(self.robot.counting.counted(self.arm.joints_deg()))
        joints[0] += self.off_deg
        told = {f"rax_{i}": f"{q:.7g}" for i, q in enumerate(joints, start=1)}
        return {"_type": "ms-jointtarget", "_title": "ROB_1", **told, **{f"eax_{a}": "0" for a in "abcdef"}}

    def _system(self) -> dict[str, str]:
        return {"_type": "sys-system", "_title": "system", "name": "simulated", "rwversion": self.version}

    # -- RWS 1 --------------------------------------------------------------------------------------------

    def _rws1(self, method: str, target: str, headers: Mapping[str, str], body: str) -> Answer:
        if not self._digested(method, headers.get("authorization", "")):
            challenge = f'Digest realm="{_REALM}", qop="auth", nonce="{self._nonce}", algorithm=MD5'
            return 401, "", "", {"WWW-Authenticate": challenge}
        url = urlsplit(target)
        self.asked.append(f"{method} {url.path}")
        states: dict[str, Callable[[], dict[str, str]]] = {
            "/rw/panel/ctrlstate": self._controller,
            "/rw/panel/opmode": self._opmode,
            "/rw/rapid/execution": self._execution,
            "/rw/motionsystem/mechunits/ROB_1/jointtarget": self._jointtarget,
        }
        if url.path not in states:
            return 404, "", "", {}
        told = states[url.path]()
        if parse_qs(url.query).get("json") == ["1"]:
            return 200, "application/json", json.dumps({"_embedded": {"_state": [told]}}), {}
        spans = "".join(f'<span class="{k}">{v}</span>' for k, v in told.items() if not k.startswith("_"))
        item = f'<li class="{told["_type"]}" title="{told["_title"]}">{spans}</li>'
        return (
            200,
            "application/xhtml+xml",
            f'<html><body><div class="state"><ul>{item}</ul></div></body></html>',
            {},
        )

    def _digested(self, method: str, given: str) -> bool:
        if not given.startswith("Digest "):
            return False
        said = {
            name: quoted or plain
            for name, quoted, plain in re.findall(r'(\w+)=(?:"([^"]*)"|([^,\s]+))', given)
        }
        user = said.get("username", "")
        one = _md5(f"{user}:{_REALM}:{self.users.get(user)}")
        two = _md5(f"{method}:{said.get('uri')}")
        middle = f"{said.get('nonce')}:{said.get('nc')}:{said.get('cnonce')}:{said.get('qop')}"
        return said.get("nonce") == self._nonce and said.get("response") == _md5(f"{one}:{middle}:{two}")


def _md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()

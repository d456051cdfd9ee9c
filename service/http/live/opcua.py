"""OPC UA server of live values, with asyncua.

Clients read its variables and subscribe to them, and cannot write. It has its own thread and event loop. Clients name
a user, `viewer` or `operator`, whose password is the token of that role; anonymous ones are refused. On an address
that other computers reach every connection is signed and encrypted, with a certificate that is made in the record.
Sources: OPC 10000-4 (sessions), 10000-8, 5.6.4.3 (the number of a unit is its UNECE code as bytes), 10000-5
(variables).
"""

# asyncua exports by names that it does not list, and takes Python's types where its annotations have those of OPC UA.
# pyright: reportArgumentType=false, reportPrivateImportUsage=false

from __future__ import annotations

import asyncio
import functools
import json
import logging
import socket
import threading
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from asyncua import Server, ua
from asyncua.crypto.cert_gen import setup_self_signed_certificate
from asyncua.crypto.permission_rules import User, UserRole
from cryptography.x509.oid import ExtendedKeyUsageOID

from calib.errors import DataError
from service.http.access.connections import ConnectionLog, is_loopback
from service.http.access.roles import Tokens
from service.http.wire.bodies import RunResponse
from service.http.wire.bodies.fields import ResponseBody
from service.http.wire.bodies.runs import LastReading, PromptShown

logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # it has a line for each client that it refuses

NAMESPACE = "urn:truepose:live"
APPLICATION = "urn:truepose:service"
CLIENTS = 20
_POINTS = ("reading_tracker_mm", "reading_world_mm")  # x, y, z
START_S = 60.0
END_S = 5.0
_UNITS = {"mm": ("MMT", "millimetre"), "s": ("SEC", "second"), "degC": ("CEL", "degree Celsius")}
_ENCRYPTED = [
    ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
]


@dataclass(frozen=True)
class LiveNode:
    """A variable: its name, the topic and the member that it shows, its type, and its unit.

    `of` is the class that describes the member, where a class has it.
    """

    name: str
    topic: str
    path: tuple[str, ...]
    kind: ua.VariantType
    unit: str = ""
    of: type[ResponseBody] | None = None
    about: str = ""

    @property
    def description(self) -> str:
        """Description of the member, from OpenAPI."""
        return self.about or (self.of and self.of.model_fields[self.path[-1]].description) or ""


_T = ua.VariantType
NODES = (
    *(
        LiveNode(name, "state", (name,), kind, unit, RunResponse)
        for name, kind, unit in (
            ("id", _T.String, ""), ("name", _T.String, ""), ("state", _T.String, ""), ("state_code", _T.Int32, ""),
            ("reason", _T.String, ""), ("done", _T.Int32, ""), ("total", _T.Int32, ""), ("skipped", _T.Int32, ""),
            ("seconds_left", _T.Double, "s"), ("simulated", _T.Boolean, ""),
        )
    ),
    *(
        LiveNode(f"prompt_{name}", "state", ("prompt", name), _T.String, "", PromptShown)
        for name in ("id", "text")
    ),
    *(
        LiveNode(f"reading_{name}", "state", ("last_reading", name), kind, unit, LastReading)
        for name, kind, unit in (
            ("name", _T.String, ""), ("set", _T.String, ""), ("target", _T.String, ""), ("t_air_c", _T.Double, "degC"),
            ("tracker_mm", _T.Double, "mm"), ("world_mm", _T.Double, "mm"), ("length_mm", _T.Double, "mm"),
        )
    ),
    LiveNode("result_id", "result", ("id",), _T.String, about="Id of the last diagnosis, loop or verification."),
    LiveNode("result_kind", "result", ("kind",), _T.String, about="Whether it is a diagnosis, loop or verification."),
    LiveNode("result_verdict", "result", ("result", "verdict"), _T.String, about="The verdict of the diagnosis."),
    LiveNode(
        "result_error_before_mm", "result", ("result", "error_before_mm", "rms"), _T.Double, "mm",
        about="RMS error on readings held out before the correction, mm.",
    ),
    LiveNode(
        "result_error_after_mm", "result", ("result", "error_after_mm", "rms"), _T.Double, "mm",
        about="RMS error on readings held out after the correction, mm.",
    ),
    LiveNode(
        "result_error_verified_mm", "result", ("result", "verification", "error_verified_mm", "rms"), _T.Double, "mm",
        about="RMS error on the robot at new poses with the correction, mm.",
    ),
)  # fmt: skip


class OpcuaServer:
    """The server of one service. `offer` is thread-safe and never waits."""

    def __init__(self, cell: str, host: str, port: int, tokens: Tokens, folder: Path) -> None:
        self._cell, self._tokens, self._folder = cell, tokens, folder
        self._host, self._listener = host, _listener(host, port)
        shown = f"[{host}]" if ":" in host else host
        self.address = f"opc.tcp://{shown}:{self._listener.getsockname()[1]}"
        self.log = ConnectionLog("opcua", self.address)
        self._lock = threading.Lock()
        self._waiting: dict[str, bytes] = {}
        self._loop: asyncio.AbstractEventLoop | None = None
        self._wake, self._ready, self._over = asyncio.Event(), threading.Event(), False
        self._refusal: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="opcua", daemon=True)

    def __enter__(self) -> OpcuaServer:
        self._thread.start()
        self._ready.wait(START_S)
        if self._refusal is not None:
            raise DataError(
                f"cannot be opened ({self._refusal}).", do="Give another address and port.", key="--opcua"
            ) from self._refusal
        return self

    def __exit__(self, *_: object) -> None:
        self._over = True
        self._awake()
        self._thread.join(END_S)

    def offer(self, topic: str, payload: bytes, *, retained: bool) -> None:
        """Take a value; of those that wait, the newest of each topic is shown."""
        if retained:
            with self._lock:
                self._waiting[topic] = payload
            self._awake()

    def _awake(self) -> None:
        if (loop := self._loop) is not None and not loop.is_closed():
            loop.call_soon_threadsafe(self._wake.set)

    def get_user(
        self, iserver: Any, username: str | None = None, password: Any = None, certificate: Any = None
    ) -> User | None:
        """Return the user of a session, or None to refuse it, as asyncua asks for it."""
        given = password.decode("utf-8", "replace") if isinstance(password, bytes) else password or ""
        role = self._tokens.role_of(given)
        return User(UserRole.User, username) if role is not None and username == role.value else None

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except (OSError, ValueError, ua.UaError) as error:  # ValueError: the key in the record is none
            self._refusal = error
            self.log.note("failed", f"The server has ended: {error}.")
        finally:
            self._listener.close()
            self._ready.set()

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        server = Server(user_manager=self)  # type: ignore[arg-type]
        await server.init()
        server.set_server_name("TruePose")
        await server.set_application_uri(APPLICATION)
        server.set_identity_tokens([ua.UserNameIdentityToken])
        server.iserver.max_connections = CLIENTS
        if is_loopback(self._host):
            server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        else:
            await self._encrypt(server)
        nodes = await self._nodes(server)
        server.set_endpoint(self.address)
        self._listener.close()  # it has kept the port until now
        async with server:
            for topic in {each.topic for each in NODES}:
                await _show(server, nodes, topic, None)
            self.log.note("listening", "It serves clients.")
            self._ready.set()
            while not self._over:
                await self._wake.wait()
                self._wake.clear()
                with self._lock:
                    waiting, self._waiting = self._waiting, {}
                for topic, payload in waiting.items():
                    await _show(server, nodes, topic, json.loads(payload))

    async def _encrypt(self, server: Server) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        key, certificate = self._folder / "key.pem", self._folder / "certificate.der"
        usage, about = [ExtendedKeyUsageOID.SERVER_AUTH], {"commonName": "TruePose"}
        await setup_self_signed_certificate(key, certificate, APPLICATION, socket.gethostname(), usage, about)
        await server.load_certificate(str(certificate))
        await server.load_private_key(str(key))
        server.set_security_policy(_ENCRYPTED)

    async def _nodes(self, server: Server) -> dict[LiveNode, ua.NodeId]:
        """Make the variables; a folder has the name of the cell."""
        space = await server.register_namespace(NAMESPACE)
        folder = await server.nodes.objects.add_folder(
            ua.NodeId("TruePose", space), ua.QualifiedName(self._cell, space)
        )
        nodes = {}
        for each in NODES:
            variable = await folder.add_variable(
                ua.NodeId(each.name, space),
                ua.QualifiedName(each.name, space),
                ua.Variant(None, ua.VariantType.Null),
                datatype=ua.NodeId(each.kind.value),
            )
            await variable.write_attribute(
                ua.AttributeIds.Description, ua.DataValue(ua.Variant(ua.LocalizedText(each.description)))
            )
            if each.unit:
                code, name = _UNITS[each.unit]
                unit = ua.EUInformation(
                    "http://www.opcfoundation.org/UA/units/un/cefact",
                    int.from_bytes(code.encode(), "big"),
                    ua.LocalizedText(each.unit),
                    ua.LocalizedText(name),
                )
                await variable.add_property(0, "EngineeringUnits", unit)
            if each.name in _POINTS:
                await variable.write_value_rank(ua.ValueRank.OneDimension)
                await variable.write_array_dimensions([3])
            nodes[each] = variable.nodeid
        return nodes


async def _show(server: Server, nodes: dict[LiveNode, ua.NodeId], topic: str, document: Any) -> None:
    now = datetime.now(UTC)
    for each, node in nodes.items():
        if each.topic == topic:
            value = functools.reduce(
                lambda at, key: at.get(key) if isinstance(at, dict) else None, each.path, document
            )
            kind = ua.VariantType.Null if value is None else each.kind
            code = ua.StatusCodes.BadNoData if value is None else ua.StatusCodes.Good
            shown = ua.DataValue(
                ua.Variant(value, kind), ua.StatusCode(code), SourceTimestamp=now, ServerTimestamp=now
            )
            await server.write_attribute_value(node, shown)


def _listener(host: str, port: int) -> socket.socket:
    """Return a socket that is bound to the address.

    Raises
    ------
    DataError
        The address cannot be used.
    """
    listener = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
    except OSError as error:
        listener.close()
        raise DataError(
            f"{port} of {host} cannot be opened: {error.strerror}.",
            do="Give another address and port; another service may be running there.",
            key="--opcua",
        ) from error
    return listener

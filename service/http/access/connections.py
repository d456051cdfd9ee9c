"""Connections to other programs by MQTT and OPC UA.

It has their addresses, their users and their states. The rules are those of HTTP: without a token of one's own nothing
beyond this computer is opened. A broker on another computer needs TLS and credentials.
"""

from __future__ import annotations

import ipaddress
import logging
import re
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal
from urllib.parse import unquote, urlsplit

from calib.errors import DataError
from service.json_values import utc_text

_log = logging.getLogger("service.live")
_HOST = re.compile(r"(?:[A-Za-z0-9_-]{1,63}\.){0,10}[A-Za-z][A-Za-z0-9-]{0,62}")  # its last part is no number
State = Literal["connecting", "connected", "listening", "failed"]


def refuse_host(host: str, key: str = "--host") -> None:
    """Refuse a host that is neither an address nor a name.

    The system takes '' and '0' for all its addresses.

    Raises
    ------
    DataError
        The host is neither.
    """
    try:
        ipaddress.ip_address(host.removeprefix("[").removesuffix("]"))
    except ValueError as error:
        if not _HOST.fullmatch(host):
            raise DataError(
                f"{host!r} is not an address.",
                do="Give an address or a name of this computer, or 0.0.0.0 for all of its addresses.",
                key=key,
            ) from error


def is_loopback(host: str) -> bool:
    """Return whether only this computer can reach the address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True)
class Broker:
    """An MQTT broker, and the credentials of this service there.

    Attributes
    ----------
    authority : Path, optional
        Certificate of the authority that has signed the broker's; None for those that the system trusts.
    """

    host: str
    port: int
    tls: bool
    user: str = ""
    password: str = field(default="", repr=False)
    authority: Path | None = None

    @property
    def address(self) -> str:
        """Address of the connection, without the credentials."""
        return f"mqtt{'s' if self.tls else ''}://{self.host}:{self.port}"


def broker_at(url: str, password: str, authority: Path | None) -> Broker:
    """Return the broker with this address, `mqtt://[USER@]HOST[:PORT]` or `mqtts://...`.

    Raises
    ------
    DataError
        It is no such address, holds a password, or is on another computer and lacks TLS or credentials.
    """
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError:
        parts, port = urlsplit(""), None
    if parts.scheme not in ("mqtt", "mqtts") or not parts.hostname or parts.path.strip("/") or parts.query:
        raise DataError(
            "is not the address of a broker.",
            do="Give mqtts://USER@HOST:PORT, or mqtt://127.0.0.1.",
            key="--mqtt",
        )
    if parts.password is not None:
        raise DataError(
            "holds a password, which others on this computer can read.",
            do="Put it into a file and give --mqtt-password.",
            key="--mqtt",
        )
    host, tls = parts.hostname, parts.scheme == "mqtts"
    refuse_host(host, "--mqtt")
    broker = Broker(
        host, port or (8883 if tls else 1883), tls, unquote(parts.username or ""), password, authority
    )
    if not is_loopback(host) and not tls:
        raise DataError("is on another computer and has no TLS.", do="Use mqtts://.", key="--mqtt")
    if not is_loopback(host) and not (broker.user and password):
        raise DataError(
            "is on another computer and has no credentials.",
            do="Name the user in the address, and give --mqtt-password.",
            key="--mqtt",
        )
    if authority is not None and not tls:
        raise DataError("goes with mqtts:// only.", do="Use mqtts://, or leave it out.", key="--mqtt-ca")
    if bool(password) != bool(broker.user):
        raise DataError(
            "has a user without a password, or the reverse.",
            do="Name the user in the address, and give --mqtt-password.",
            key="--mqtt",
        )
    return broker


def listener_at(text: str) -> tuple[str, int]:
    """Return host and port of `[HOST:]PORT`; the host is this computer alone if it is left out.

    Raises
    ------
    DataError
        It is no such address.
    """
    host, _, port = text.rpartition(":")
    if not port.isascii() or not port.isdecimal() or int(port) > 65535:
        raise DataError("has no port.", do="Give [HOST:]PORT, such as 4840 or 0.0.0.0:4840.", key="--opcua")
    host = host or "127.0.0.1"
    refuse_host(host, "--opcua")
    return host.strip("[]"), int(port)


class ConnectionLog:
    """State of a connection. Thread-safe.

    A new state is logged once, however often it is met.
    """

    def __init__(self, kind: Literal["mqtt", "opcua"], address: str) -> None:
        self.kind, self.address = kind, address
        self._lock = threading.Lock()
        self._state: State = "connecting"
        self._says, self._since_utc = "It is being connected.", time.time()

    def note(self, state: State, says: str) -> None:
        """Note the state and its description."""
        with self._lock:
            if state == self._state and says == self._says:
                return
            new, self._state, self._says, self._since_utc = state != self._state, state, says, time.time()
        if new:
            level = logging.INFO if state in ("connected", "listening") else logging.WARNING
            _log.log(level, "%s: %s", self.address, says)

    def document(self) -> dict[str, Any]:
        """Return the members of `ConnectionShown`."""
        with self._lock:
            return {
                "kind": self.kind,
                "address": self.address,
                "state": self._state,
                "says": self._says,
                "since_utc": utc_text(self._since_utc),
            }

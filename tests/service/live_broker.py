"""An MQTT broker for the tests, and a client that collects what is published there."""

from __future__ import annotations

import datetime
import ipaddress
import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import paho.mqtt.client as paho
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from paho.mqtt.enums import CallbackAPIVersion
from pwdlib import PasswordHash
from pwdlib.hashers.argon2 import Argon2Hasher

from tests.drivers.waiting import PATIENCE_S, until


@contextmanager
def broker(
    port: int, *, password_file: Path | None = None, tls: tuple[Path, Path] | None = None
) -> Iterator[None]:
    """Run a broker on this computer, and kill it after the block.

    `tls` holds the files of the private key and of the certificate.
    """
    auth: dict[str, dict[str, Any]] = {
        "amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}
    }
    if password_file is not None:
        auth = {"amqtt.plugins.authentication.FileAuthPlugin": {"password_file": str(password_file)}}
    listener: dict[str, Any] = {"type": "tcp", "bind": f"127.0.0.1:{port}"}
    if tls is not None:
        listener |= {"ssl": True, "keyfile": str(tls[0]), "certfile": str(tls[1])}
    config = json.dumps({"listeners": {"default": listener}, "plugins": auth})
    command = [sys.executable, "-c", _BROKER, config]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            yield
        finally:
            process.kill()


_BROKER = """
import asyncio, json, sys
from amqtt.broker import Broker
from amqtt.contexts import BrokerConfig
async def run():
    its = Broker(BrokerConfig.from_dict(json.loads(sys.argv[1])))
    await its.start()
    print("ready", flush=True)
    await asyncio.Event().wait()
asyncio.run(run())
"""


def password_file(path: Path, user: str, password: str) -> Path:
    """Write the file of a broker that admits one user."""
    path.write_text(f"{user}:{PasswordHash((Argon2Hasher(),)).hash(password)}\n", "utf-8")
    return path


class Collector:
    """A client that keeps every message below `truepose`."""

    def __init__(self, port: int, user: str = "", password: str = "") -> None:
        self.messages: list[tuple[str, bytes, bool]] = []
        self._client = client = paho.Client(CallbackAPIVersion.VERSION2)
        client.username_pw_set(user or None, password or None)
        client.on_message = lambda _, __, each: self.messages.append(
            (each.topic, bytes(each.payload), each.retain)
        )
        subscribed = threading.Event()
        client.on_subscribe = lambda *_: subscribed.set()
        connected = threading.Event()
        client.on_connect = lambda *_: connected.set()
        client.connect("127.0.0.1", port)
        client.loop_start()
        assert connected.wait(PATIENCE_S)
        client.subscribe("truepose/#", qos=1)
        assert subscribed.wait(PATIENCE_S)

    def __enter__(self) -> Collector:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.disconnect()
        self._client.loop_stop()

    def newest(self, topic: str) -> bytes | None:
        return next((payload for name, payload, _ in self.messages[::-1] if name == topic), None)

    def wait(self, topic: str, payload: bytes) -> None:
        until(lambda: self.newest(topic) == payload)


def self_signed(folder: Path, name: str) -> tuple[Path, Path]:
    """Write key and certificate of a broker at 127.0.0.1; the certificate is its own authority."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    now = datetime.datetime.now(datetime.UTC)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))
        .not_valid_after(now + datetime.timedelta(days=1))
        .add_extension(
            x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]), False
        )
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), True)
        .sign(key, hashes.SHA256())
    )
    files = folder / f"{name}.key", folder / f"{name}.pem"
    pem = serialization.Encoding.PEM
    files[0].write_bytes(
        key.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    files[1].write_bytes(certificate.public_bytes(pem))
    return files

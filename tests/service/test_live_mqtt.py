"""Test live values over MQTT: messages to a broker, which can delay or order nothing.

These would catch: a value that differs from HTTP, a topic that a name breaks, and a message to a broker whose
certificate is not known. They would also catch a password that is sent without TLS, and a broker that makes a run wait.
"""

from __future__ import annotations

import logging
import socket
import threading
import time
from pathlib import Path

import pytest

from calib.errors import DataError
from service.http.access.connections import Broker, broker_at, listener_at
from service.http.live.mqtt import EVENTS, MqttPublisher, level_of, mqtt_publisher
from tests.drivers.waiting import PATIENCE_S, until
from tests.service.live_broker import Collector, broker, password_file, self_signed
from tests.service.test_http_support import lasting_port


def at(port: int, **more: object) -> Broker:
    return Broker("127.0.0.1", port, tls=False, **more)  # type: ignore[arg-type]


def state_of(publisher: MqttPublisher) -> str:
    return publisher.log.document()["state"]


@pytest.mark.parametrize("cell", ["irb120-cell", "Halle 3/Zelle #1 + 50 %", "焊接 ä", "a\x00b"])
def test_values_are_retained_under_the_name_of_the_cell_and_events_are_not(cell: str) -> None:
    port = lasting_port()
    place = f"truepose/{level_of(cell)}"
    assert place.count("/") == 1
    with broker(port):
        with mqtt_publisher(at(port), cell) as publisher, Collector(port) as early:
            publisher.offer("state", b'{"done":1}', retained=True)
            publisher.offer("event", b'{"id":1}', retained=False)
            early.wait(f"{place}/event", b'{"id":1}')
            early.wait(f"{place}/state", b'{"done":1}')
            with Collector(port) as late:
                late.wait(f"{place}/state", b'{"done":1}')
                late.wait(f"{place}/status", b"online")
                assert all(retained for _, _, retained in late.messages)
                assert late.newest(f"{place}/event") is None
            assert state_of(publisher) == "connected"
        with Collector(port) as after:
            after.wait(f"{place}/status", b"offline")


def test_a_burst_of_values_holds_nobody_up_while_the_broker_confirms_others() -> None:
    port = lasting_port()
    with broker(port), mqtt_publisher(at(port), "cell") as publisher, Collector(port) as found:
        until(lambda: state_of(publisher) == "connected")

        def burst() -> None:
            for n in range(300):
                publisher.offer("state", str(n).encode(), retained=True)
                publisher.offer("event", str(n).encode(), retained=False)

        offering = threading.Thread(target=burst, daemon=True)
        offering.start()
        offering.join(PATIENCE_S)
        assert not offering.is_alive()
        found.wait("truepose/cell/state", b"299")
        found.wait("truepose/cell/event", b"299")
        told = [int(payload) for topic, payload, _ in found.messages if topic.endswith("/event")]
        assert told == list(range(300))


def test_a_broker_that_comes_back_gets_the_newest_values(caplog: pytest.LogCaptureFixture) -> None:
    port = lasting_port()
    caplog.set_level(logging.INFO, "service.live")
    with mqtt_publisher(at(port), "cell") as publisher:
        publisher._client.reconnect_delay_set(1, 1)
        until(lambda: state_of(publisher) == "failed")
        begun = time.monotonic()
        for n in range(20 * EVENTS):
            publisher.offer("state", str(n).encode(), retained=True)
            publisher.offer("event", str(n).encode(), retained=False)
        assert time.monotonic() - begun < 5.0
        assert len(publisher._events) <= EVENTS
        for _ in range(2):
            with broker(port), Collector(port) as found:
                found.wait("truepose/cell/state", str(20 * EVENTS - 1).encode())
                until(lambda: state_of(publisher) == "connected")
            until(lambda: state_of(publisher) != "connected")
    told = [record.getMessage() for record in caplog.records if record.name == "service.live"]
    assert sum("cannot be reached" in each for each in told) <= 3  # once for every time that it went away
    assert sum("has the connection" in each for each in told) == 2


def test_wrong_credentials_are_told_and_the_right_ones_taken(tmp_path: Path) -> None:
    port = lasting_port()
    with broker(port, password_file=password_file(tmp_path / "users", "cell", "right-password")):
        with mqtt_publisher(at(port, user="cell", password="wrong"), "cell") as publisher:
            until(lambda: state_of(publisher) == "failed")
            assert "password" in publisher.log.document()["says"]
        with mqtt_publisher(at(port, user="cell", password="right-password"), "cell") as publisher:
            until(lambda: state_of(publisher) == "connected")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # paho closes no such socket
def test_only_a_broker_of_the_named_authority_gets_anything(tmp_path: Path) -> None:
    port, own, other = lasting_port(), self_signed(tmp_path, "own"), self_signed(tmp_path, "other")
    with broker(port, tls=own):
        safe = {"host": "127.0.0.1", "port": port, "tls": True}
        with mqtt_publisher(Broker(**safe, authority=own[1]), "cell") as publisher:
            until(lambda: state_of(publisher) == "connected")
        for authority in (other[1], None):
            with mqtt_publisher(Broker(**safe, authority=authority), "cell") as publisher:
                until(lambda: state_of(publisher) == "failed")
                assert "certificate" in publisher.log.document()["says"].lower()
                assert "--mqtt-ca" in publisher.log.document()["says"]


@pytest.mark.parametrize("content", [b"", b"no certificate", None])
def test_an_authority_that_is_none_is_refused(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "ca.pem"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(DataError, match="authority") as refused:
        MqttPublisher(Broker("127.0.0.1", 1, tls=True, authority=file), "cell")
    assert refused.value.key == "--mqtt-ca"


def test_a_broker_that_never_answers_holds_nothing_up() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        begun = time.monotonic()
        with mqtt_publisher(at(silent.getsockname()[1]), "cell") as publisher:
            for n in range(5000):
                publisher.offer("state", b"x" * 1000, retained=True)
                publisher.offer("event", str(n).encode(), retained=False)
        assert time.monotonic() - begun < 10.0


@pytest.mark.parametrize(
    ("url", "password", "says"),
    [
        ("", "", "broker"), ("http://127.0.0.1", "", "broker"), ("mqtt://", "", "broker"), ("mqtt://h:x", "", "broker"),
        ("mqtt://127.0.0.1/topic", "", "broker"), ("mqtt://broker.example", "", "no TLS"),
        ("mqtt://u@broker.example", "secret", "no TLS"), ("mqtts://broker.example", "", "no credentials"),
        ("mqtts://u@broker.example", "", "no credentials"), ("mqtts://u:secret@broker.example", "", "holds a password"),
        ("mqtt://127.0.0.1", "secret", "user"), ("mqtt://u@127.0.0.1", "", "user"), ("mqtts://0", "", "not an address"),
        ("mqtts://mün.example", "", "not an address"),
    ],
)  # fmt: skip
def test_addresses_of_brokers_that_are_refused(url: str, password: str, says: str) -> None:
    with pytest.raises(DataError, match=says) as refused:
        broker_at(url, password, None)
    assert refused.value.key == "--mqtt"
    assert refused.value.do


def test_addresses_that_are_taken() -> None:
    assert broker_at("mqtt://localhost", "", None) == Broker("localhost", 1883, False)
    far = broker_at("mqtts://a%40b@broker.example", "secret", None)
    assert (far.address, far.user) == ("mqtts://broker.example:8883", "a@b")
    assert "secret" not in repr(far)
    assert listener_at("4840") == ("127.0.0.1", 4840)
    assert listener_at("[::1]:0") == ("::1", 0)
    for wrong in ("", "x", "0:4840", "host:", "127.0.0.1:99999", "127.0.0.1"):
        with pytest.raises(DataError):
            listener_at(wrong)

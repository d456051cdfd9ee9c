"""Publisher of live values to an MQTT broker (3.1.1), with paho-mqtt.

Topics are `truepose/CELL/state` and so on, retained and with QoS 1; events are not retained. `truepose/CELL/status` is
`online`, or `offline` by the last will of the connection. Nothing is subscribed to: a broker can order nothing. Paho's
own thread connects, also again. A second one hands it the messages, because paho calls back while it holds its locks.
Source: MQTT 3.1.1 (OASIS), 3.1.2.5 (will), 3.3.1.3 (retained), 4.7 (topics).
"""

from __future__ import annotations

import secrets
import ssl
import sys
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode
from paho.mqtt.reasoncodes import ReasonCode

from calib.errors import DataError
from service.http.access.connections import Broker, ConnectionLog

IN_HAND = 100
"""Messages that the broker has not confirmed yet; behind them only the newest of every topic is kept."""

EVENTS = 1000
"""Events that wait; beyond them the oldest is dropped."""

END_S = 2.0
_TOPIC = str.maketrans({each: f"%{ord(each):02X}" for each in "/+#%" + "".join(map(chr, (*range(32), 127)))})


def level_of(name: str) -> str:
    """Return a name as one level of a topic, with special characters written like `%2F`."""
    return name.translate(_TOPIC)


@contextmanager
def mqtt_publisher(broker: Broker, cell: str) -> Iterator[MqttPublisher]:
    """Publish to a broker during the block. The broker need not be there.

    Raises
    ------
    DataError
        The file of the authority cannot be used.
    """
    publisher = MqttPublisher(broker, cell)
    try:
        yield publisher
    finally:
        publisher.close()


class MqttPublisher:
    """Connection to a broker. Thread-safe; no call waits for the network, except `close` for `END_S`."""

    def __init__(self, broker: Broker, cell: str) -> None:
        self._place = f"truepose/{level_of(cell)}"
        self.log = ConnectionLog("mqtt", broker.address)
        self._changed = threading.Condition()  # never held while paho is called: it calls back with its locks
        self._values: dict[str, bytes] = {}
        self._unsent: dict[str, None] = {}  # topics whose newest value is not sent yet
        self._events = deque[bytes](maxlen=EVENTS)
        self._in_hand = 0  # messages that the broker has not confirmed
        self._connected = self._over = False
        self._client = client = paho.Client(
            CallbackAPIVersion.VERSION2, client_id=f"truepose-{secrets.token_hex(6)}", protocol=paho.MQTTv311
        )
        client.suppress_exceptions = False
        client.username_pw_set(broker.user or None, broker.password or None)
        if broker.tls:
            context = ssl.create_default_context()
            if broker.authority is not None:
                try:
                    context = ssl.create_default_context(cafile=str(broker.authority))
                except (OSError, ssl.SSLError) as error:
                    raise DataError(
                        f"is no certificate of an authority in PEM ({error}).",
                        do="Give the certificate that has signed the broker's.",
                        file=broker.authority,
                        key="--mqtt-ca",
                    ) from error
            client.tls_set_context(context)
        client.will_set(f"{self._place}/status", "offline", qos=1, retain=True)
        client.reconnect_delay_set(1, 60)
        client.max_inflight_messages_set(20)
        client.max_queued_messages_set(2 * IN_HAND)
        client.on_connect, client.on_disconnect = self._on_connect, self._on_disconnect
        client.on_connect_fail, client.on_publish = self._on_connect_fail, self._on_publish
        client.connect_async(broker.host, broker.port, keepalive=30)
        client.loop_start()
        self._sender = threading.Thread(target=self._send, name="mqtt sender", daemon=True)
        self._sender.start()

    def offer(self, topic: str, payload: bytes, *, retained: bool) -> None:
        """Take a value, to be sent as soon as the broker takes it."""
        with self._changed:
            if retained:
                self._values[topic] = payload
                self._unsent[topic] = None
            else:
                self._events.append(payload)
            self._changed.notify_all()

    def _send(self) -> None:
        """Send what waits, in the thread of the sender, until the publisher is closed."""
        while (message := self._next()) is not None:
            topic, payload = message
            sent = self._client.publish(f"{self._place}/{topic}", payload, qos=1, retain=topic != "event")
            if sent.rc == MQTTErrorCode.MQTT_ERR_QUEUE_SIZE:  # it was not taken
                with self._changed:
                    self._in_hand -= 1
                    if topic in self._values:
                        self._unsent[topic] = None

    def _next(self) -> tuple[str, bytes] | None:
        """Return the topic and content of the next message, once it can be sent.

        None once the publisher is closed.
        """
        with self._changed:
            self._changed.wait_for(
                lambda: (
                    self._over
                    or (self._connected and self._in_hand < IN_HAND and (self._unsent or self._events))
                )
            )
            if self._over:
                return None
            self._in_hand += 1
            if self._unsent:
                topic = next(iter(self._unsent))
                del self._unsent[topic]
                return topic, self._values[topic]
            return "event", self._events.popleft()

    def _on_connect(self, client: Any, _: Any, flags: Any, code: ReasonCode, more: Any) -> None:
        if code.is_failure:
            self.log.note("failed", f"The broker refuses the connection: {code}. Correct user and password.")
            return
        self.log.note("connected", "The broker has the connection.")
        with self._changed:
            self._connected = True
            self._values["status"] = b"online"
            self._unsent = dict.fromkeys(self._values)  # it may be another one, or have lost them
            self._changed.notify_all()

    def _on_disconnect(self, client: Any, _: Any, flags: Any, code: ReasonCode, more: Any) -> None:
        with self._changed:
            was, self._connected = self._connected, False
        if was:
            self.log.note("connecting", f"The connection was lost ({code}); it is tried again.")

    def _on_connect_fail(self, client: Any, _: Any) -> None:
        why = sys.exc_info()[1]  # paho calls this while it handles the error, and does not pass it on
        do = (
            "Check address, port and --mqtt-ca."
            if isinstance(why, ssl.SSLError)
            else "Check address and port."
        )
        self.log.note("failed", f"The broker cannot be reached ({why}). {do} It is tried again.")

    def _on_publish(self, client: Any, _: Any, mid: int, code: Any, more: Any) -> None:
        with self._changed:
            self._in_hand -= 1
            self._changed.notify_all()

    def close(self) -> None:
        """Say that the cell is offline, and end the connection."""
        with self._changed:
            connected, self._over = self._connected, True
            self._changed.notify_all()
        self._sender.join(END_S)
        if connected:
            sent = self._client.publish(f"{self._place}/status", b"offline", qos=1, retain=True)
            sent.wait_for_publish(END_S)
        self._client.disconnect()
        ending = threading.Thread(target=self._client.loop_stop, daemon=True)  # it may wait for a connection
        ending.start()
        ending.join(END_S)

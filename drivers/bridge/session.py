"""A session with one MBP/1 bridge: greeting, heartbeat, questions, stop.

All drivers of bridges share it. It has the common rules of trackers, cameras and ballbars:

- The bridge must be of the right kind.
- The bridge drops a client that is silent for 30 s.
- A stop may come from any thread in the middle of a question.
- An answer that is complete but impossible ends the connection.

The clock of a device only orders its readings and events; it may be set, step back and forth, or restart. A reading
stamped before the last one of this connection is refused once; the next one is then compared with its stamp. A stamp
that came before is always refused, also on a new connection, because it is the same reading again. An event between the
acknowledgement and the answer voids the reading independently of its stamp.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from itertools import zip_longest
from typing import TypedDict

from drivers.bridge import mbp
from drivers.deadlines import InstrumentDeadlines
from drivers.errors import (
    AcquisitionError,
    Busy,
    EmergencyStop,
    LinkError,
    MotionStopped,
    NotArmed,
    NotReady,
    ProtocolError,
    naming,
)
from drivers.interfaces import Identity, InstrumentStatus
from drivers.link import Address, WireSink, parse_url
from drivers.serial_link import SerialLink

_LOG = logging.getLogger(__name__)
_IMPOSSIBLE = (
    "That cannot be a measurement: look at the instrument's own program, connect again and repeat it."
)
_ELSEWHERE = {
    "proto": "Update the bridge or this program: they speak different versions of MBP.",
    "kind": "Check that the address belongs to the bridge of this instrument.",
    "units": "Have the bridge convert to mm and deg, as its protocol says; its numbers are not used as they are.",
}
_UNITS = "mm", "deg"  # of length and turn, the first two of the greeting
_WEAKNESS = (
    "the bridge sends no checksums (no crc=1 in its greeting): an answer of which one digit is damaged on its way is "
    "taken for measured"
)
_STATES = ("OFF", "WARMING", "READY", "BUSY", "ERROR", "ESTOP")


class SessionArguments(TypedDict, total=False):
    """Arguments that a driver passes to the session with its bridge.

    Attributes
    ----------
    heartbeat_s
        Seconds between two signs of life while no question is open; None for no heartbeat.
    wire
        Receives every byte that is sent or received.
    clock
        Clock for waits, s.
    """

    heartbeat_s: float | None
    wire: WireSink | None
    clock: Callable[[], float]


class MbpSession:
    """The client of a bridge of `kind`.

    Questions block; `stop` may be called from any thread.
    """

    def __init__(
        self,
        url: str,
        name: str,
        kind: str,
        limits: Callable[[], InstrumentDeadlines],
        *,
        serial: bool = False,
        heartbeat_s: float | None = 4.0,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Prepare the session.

        With `serial`, a URL that is not tcp:// is that of a serial line.

        Raises
        ------
        ConfigError
            The URL is not an address.
        """
        line = (
            SerialLink(url, name, wire=wire, clock=clock) if serial and not url.startswith("tcp://") else None
        )
        address = parse_url(url) if line is None else Address(url, 0)
        self.client = mbp.MbpClient(address, name, limits().send_s, wire, clock, serial=line)
        self.armed = False
        self._name = name
        self._kind = kind
        self._limits = limits  # called every time: the driver's deadlines may be changed meanwhile
        self._heartbeat_s = heartbeat_s
        self._clock = clock
        self._lock = threading.RLock()
        self._stopping = threading.Event()
        self._hello: mbp.Message | None = None
        self._quit = threading.Event()
        self._heart: threading.Thread | None = None
        self._warned = False
        self._stamps: set[float] = set()  # of all readings
        self._last_t_s = -math.inf  # of this connection

    # -- connection ---------------------------------------------------------------------------------------

    def connect(self) -> None:
        """Open and greet; nothing moves.

        Raises
        ------
        LinkError
            The connection failed.
        ProtocolError
            Another device answers.
        Busy
            The bridge is in use.
        """
        first, self._warned = not self._warned, True
        if first:
            _LOG.warning("%s: this driver is UNVERIFIED ON HARDWARE: check its first readings", self._name)
        self.disconnect()
        with self._lock:
            hello = self._greet()
            with naming(self._name, "HELLO"):
                self._refuse_another_bridge(hello)
            self._hello = hello
            self._last_t_s = -math.inf
        if first and self.weakness:
            _LOG.warning("%s: %s", self._name, self.weakness)
        if self._heartbeat_s is not None:
            self._quit = threading.Event()
            self._heart = threading.Thread(target=self._beat, args=(self._quit,), daemon=True)
            self._heart.start()

    def _refuse_another_bridge(self, hello: mbp.Message) -> None:
        """Refuse a greeting with another protocol, kind of device, or units.

        Metres of a ballbar would be taken for a few mm.

        Raises
        ------
        ProtocolError
            The greeting differs.
        """
        needed = {"proto": "1", "kind": self._kind, "units": ",".join(_UNITS)}
        shown = {key: hello.fields.get(key) for key in needed}
        given = (hello.fields.get("units") or "").casefold().split(",")[: len(_UNITS)]
        # A unit that the greeting leaves out is that of the protocol; those of temperature and pressure are not used.
        shown["units"] = ",".join(one or other for one, other in zip_longest(given, _UNITS))
        for key, wanted in needed.items():
            if shown[key] != wanted:
                self.client.link.close()
                why = f"{key} is {shown[key]}, needed {wanted}"
                raise ProtocolError(why, raw=hello.raw, what_to_do=_ELSEWHERE[key])

    def _greet(self) -> mbp.Message:
        """Greet the bridge, and retry for `takeover_s`.

        A bridge notices late that its last client has disconnected.
        """
        limits = self._limits()
        end = self._clock() + limits.takeover_s
        while True:
            try:
                return self.client.open(connect_s=limits.connect_s, reply_s=limits.reply_s)
            except Busy:
                self.client.link.close()
                if self._clock() >= end:
                    raise
                threading.Event().wait(limits.takeover_s / 20)

    def disconnect(self) -> None:
        """Close and disarm; never raises."""
        self._quit.set()
        self.armed = False
        self._hello = None
        self.client.link.close()
        heart, self._heart = self._heart, None
        if heart is not None:
            heart.join()

    def _beat(self, quit_: threading.Event) -> None:
        """Keep the connection alive.

        A bridge drops a client that is silent for 30 s, and prompts take longer.
        """
        while not quit_.wait(self._heartbeat_s):
            with self._lock:
                if quit_.is_set() or not self.client.link.is_open:
                    return
                try:
                    self.client.ask("PING", {}, "reply_s", self._limits().reply_s)
                except AcquisitionError as error:  # if it broke the link, the next question shows it
                    _LOG.warning("%s", error)
                    return

    @property
    def weakness(self) -> str:
        """The errors that this bridge cannot detect; empty if it sends checksums. Once connected."""
        return "" if self.client.checksums else _WEAKNESS

    def identify(self) -> Identity:
        """Return the identity from the bridge's greeting.

        Raises
        ------
        LinkError
            The session is not connected.
        """
        with self._lock:
            if self._hello is None:
                self.ask("PING", {})  # raises "not connected"
                raise ProtocolError("no greeting", device=self._name, command="identify")
            said = self._hello.fields.get
            simulated = {"0": False, "1": True}.get(said("sim", ""))
            names = (said("vendor", ""), said("model", ""), said("serial", ""), said("fw", ""))
            return Identity(*names, "mbp1", simulated)

    # -- questions ----------------------------------------------------------------------------------------

    def ask(
        self,
        command: str,
        fields: Mapping[str, object],
        deadline: str = "reply_s",
        seconds: float | None = None,
    ) -> mbp.Message:
        """Ask a question and return the OK answer. Errors of the bridge are passed on.

        Raises
        ------
        LinkError
            The connection failed; the device is disarmed.
        MotionStopped
            `stop` was called.
        """
        with self._lock:
            try:
                return self.client.ask(
                    command, fields, deadline, self._limits().reply_s if seconds is None else seconds
                )
            except NotReady as error:
                if self._stopping.is_set():
                    raise MotionStopped(
                        "stopped", device=self._name, command=command, raw=error.raw
                    ) from error
                raise
            except LinkError:
                self.armed = False
                raise

    @contextmanager
    def measuring(self, command: str) -> Iterator[None]:
        """Enclose a whole measurement; events count from its beginning.

        An error inside that names no device is one of this device, during `command`.

        Raises
        ------
        NotArmed
            The device is not armed.
        """
        with self._lock, naming(self._name, command):
            if not self.armed:
                raise NotArmed("measurement without arming")
            self.client.events.clear()
            yield

    @contextmanager
    def understood(self) -> Iterator[None]:
        """Enclose the parsing of an answer: a ProtocolError disarms and closes the connection."""
        try:
            yield
        except ProtocolError as error:
            error.device, error.what_to_do = self._name, _IMPOSSIBLE
            self.armed = False
            self.client.link.close()
            raise

    def void_if_reported(
        self, kinds: Mapping[str, type[AcquisitionError]], since_s: float, raw: bytes
    ) -> None:
        """Raise the error of the first relevant event of a reading.

        Relevant are events of `kinds` that came during the last question, or happened at or after `since_s` (device
        clock).
        """
        acked = self.client.acked
        for i, event in enumerate(self.client.events):
            kind = kinds.get(event.event)
            during = acked is not None and i >= acked
            if kind is not None and (during or mbp.number(event, "t") >= since_s):
                raise kind(f"{event.event} during the reading", device=self._name, command="MEASURE", raw=raw)

    def advanced(self, t_s: float) -> bool:
        """Check whether a reading stamped `t_s` (device clock) can be a new one.

        The next reading is compared with it.
        """
        new = t_s > self._last_t_s and t_s not in self._stamps
        self._stamps.add(t_s)
        self._last_t_s = t_s
        return new

    # -- arming and stopping ------------------------------------------------------------------------------

    @contextmanager
    def arming(self) -> Iterator[None]:
        """Initialise the device if it is off, require READY, run the block, then arm.

        An error inside that names no device is one of this, during "arm".

        Raises
        ------
        NotReady
            The instrument is in another state.
        EmergencyStop
            The instrument is in an emergency stop.
        """
        with self._lock, naming(self._name, "arm"):
            if self.status().state == "OFF":
                self.ask("INIT", {}, "init_s", self._limits().init_s)
            state = self.status().state
            if state == "ESTOP":
                raise EmergencyStop("instrument is in an emergency stop")
            if state != "READY":
                raise NotReady(f"instrument is {state}")
            yield
            self._stopping.clear()
            self.armed = True

    def stop(self) -> None:
        """Abort the command in progress and disarm; from any thread, at any time.

        Raises
        ------
        LinkError
            The connection failed.
        """
        self.armed = False
        self._stopping.set()
        if self._lock.acquire(blocking=False):
            try:
                self.client.ask("ABORT", {}, "reply_s", self._limits().reply_s)
            finally:
                self._lock.release()
        else:
            self.client.shout("ABORT")  # the pending question then ends with an error

    def status(self) -> InstrumentStatus:
        """Return state and weather.

        Raises
        ------
        LinkError
            The connection failed.
        SafetyStop
            The bridge reports one.
        """
        reply = self.ask("STATUS", {})
        with self.understood():
            state = reply.fields.get("state", "")
            if state not in _STATES:
                raise ProtocolError(f"unknown state {state!r}", raw=reply.raw)
            weather = {
                key: mbp.number(reply, key) if key in reply.fields else None for key in ("T", "P", "H")
            }
            return InstrumentStatus(state, weather["T"], weather["P"], weather["H"], reply.raw)

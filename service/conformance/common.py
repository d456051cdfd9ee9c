"""The promises of every driver, whatever it moves or measures."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from drivers import AcquisitionError, ConfigError, Device, Identity, LinkError
from service.conformance.broken import hold, refused

SOON_S = 30.0
WRONG_ADDRESSES = ("http://127.0.0.1:1", "tcp://127.0.0.1", "tcp://127.0.0.1:99999", "tcp://127.0.0.1:x")


@dataclass
class Heard:
    """Counts the bytes that a driver puts on the record of its wire, by direction."""

    bytes: dict[str, int] = field(default_factory=dict)

    def record(self, device: str, direction: str, data: bytes) -> None:
        """Keep what goes over the wire, as a `drivers.WireSink`."""
        self.bytes[direction] = self.bytes.get(direction, 0) + len(data)


def refuses_wrong_addresses(make: Callable[[str], object]) -> None:
    """The promise that a wrong address is refused before anything is opened. Raises Broken."""
    for url in WRONG_ADDRESSES:
        refused(ConfigError, f"the address {url}", lambda url=url: make(url))


def nobody_there(make: Callable[[str], Device], url: Callable[[int], str]) -> None:
    """An address where nobody listens, and a device that is not connected, end in LinkError. Raises Broken."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # bound and not listening: nobody else answers there either
        device = make(url(taken.getsockname()[1]))
        refused(LinkError, "identify without a connection", device.identify)
        begin = time.monotonic()
        refused(LinkError, "connect where nobody listens", device.connect)
        hold(time.monotonic() - begin < SOON_S, f"connect took {time.monotonic() - begin:.0f} s to fail")
        device.disconnect()


def says_who_it_is(device: Device) -> None:
    """Identity in words, and none once it is disconnected; disconnecting twice does nothing. Raises Broken."""
    found = device.identify()
    hold(isinstance(found, Identity), f"identify gave {type(found).__name__}, not an Identity")
    for name in ("maker", "model", "serial", "protocol"):
        value = getattr(found, name)
        hold(isinstance(value, str) and bool(value), f"its {name} is {value!r}")
    device.disconnect()
    device.disconnect()
    refused(LinkError, "identify after disconnect", device.identify)


def puts_bytes_on_record(heard: Heard) -> None:
    """Both directions of the wire. Raises Broken."""
    for direction, words in ((">", "to the device"), ("<", "from it")):
        hold(heard.bytes.get(direction, 0) > 0, f"no byte {words} was given to `wire`")


def only_ours(what: str, act: Callable[[], object]) -> None:
    """It may be refused, in the words of `drivers.errors`; any other exception is passed on."""
    try:
        act()
    except AcquisitionError as error:
        hold(bool(error.what_to_do), f"{what}: {type(error).__name__} does not say what to do")

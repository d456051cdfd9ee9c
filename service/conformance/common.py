"""The promises of every driver, of a robot or an instrument.

A function raises `RequirementFailed` if its promise does not hold.

A rig of the conformance suite has one driver, its simulator, a fault proxy between them, and the truth. It asks
questions whose right answers all differ, so that an answer to another question shows.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from drivers import AcquisitionError, Busy, ConfigError, Device, Identity, LinkError
from mocks.faultproxy import FaultProxy  # knows no protocol and simulates nothing: CONTRIBUTING.md

SOON_S = 30.0
WRONG_ADDRESSES = ("http://127.0.0.1:1", "tcp://127.0.0.1", "tcp://127.0.0.1:99999", "tcp://127.0.0.1:x")
SLACK_S = 20.0  # what a loaded machine may add to a deadline
_ASK_AGAIN_S = 0.02  # no driver reports the end of a watchdog: it is asked until it agrees


@dataclass
class WireByteCount:
    """Counts the bytes that a driver puts on the record of its wire, by direction."""

    counts: dict[str, int] = field(default_factory=dict)

    def record(self, device: str, direction: str, data: bytes) -> None:
        """Keep what goes over the wire, as a `drivers.WireSink`."""
        self.counts[direction] = self.counts.get(direction, 0) + len(data)


def refuses_wrong_addresses(make: Callable[[str], object]) -> None:
    """Check that a wrong address is refused before anything is opened."""
    for url in WRONG_ADDRESSES:
        refused(ConfigError, f"the address {url}", lambda url=url: make(url))


def nobody_there(make: Callable[[str], Device], url: Callable[[int], str]) -> None:
    """Check that calls without a device or a connection end in LinkError.

    One device has an address at which no one listens; the other is not connected.
    """
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # bound and not listening: no other program answers there either
        device = make(url(taken.getsockname()[1]))
        refused(LinkError, "identify without a connection", device.identify)
        begin = time.monotonic()
        refused(LinkError, "connect where nobody listens", device.connect)
        hold(time.monotonic() - begin < SOON_S, f"connect took {time.monotonic() - begin:.0f} s to fail")
        device.disconnect()


def says_who_it_is(device: Device) -> None:
    """Check that the identity has its texts, and that there is none after disconnecting.

    Disconnecting twice does nothing.
    """
    found = device.identify()
    hold(isinstance(found, Identity), f"identify gave {type(found).__name__}, not an Identity")
    for name in ("maker", "model", "serial", "protocol"):
        value = getattr(found, name)
        known = name == "serial" or bool(value)  # not every protocol reports a serial number
        hold(isinstance(value, str) and known, f"its {name} is {value!r}")
    device.disconnect()
    device.disconnect()
    refused(LinkError, "identify after disconnect", device.identify)


def puts_bytes_on_record(heard: WireByteCount) -> None:
    """Check that bytes of both directions of the wire were recorded."""
    for direction, words in ((">", "to the device"), ("<", "from it")):
        hold(heard.counts.get(direction, 0) > 0, f"no byte {words} was given to `wire`")


def only_ours(what: str, act: Callable[[], object]) -> None:
    """Check that an action succeeds or is refused with an error of `drivers.errors`.

    The error must recommend an action. Any other exception is passed on.
    """
    try:
        act()
    except AcquisitionError as error:
        hold(bool(error.what_to_do), f"{what}: {type(error).__name__} does not say what to do")


class RequirementFailed(AssertionError):
    """A promise that does not hold, with the observation as a sentence."""


def hold(condition: bool, otherwise: str) -> None:
    """Raise RequirementFailed with the sentence `otherwise` unless the condition is true."""
    if not condition:
        raise RequirementFailed(otherwise)


def refused(
    kinds: type[AcquisitionError] | tuple[type[AcquisitionError], ...], what: str, act: Callable[[], object]
) -> AcquisitionError:
    """Return the error in which `act` ends.

    Raises
    ------
    RequirementFailed
        It ends without an error, or in one that is none of `kinds`.
    """
    wanted = kinds if isinstance(kinds, tuple) else (kinds,)
    right = " or ".join(kind.__name__ for kind in wanted)
    try:
        act()
    except wanted as error:
        return error
    except AcquisitionError as error:
        raise RequirementFailed(
            f"{what} ended in {type(error).__name__} ({error.message}), {right} is right"
        ) from error
    raise RequirementFailed(f"{what} was not refused, {right} is right")


@dataclass
class DriverRig:
    """A driver behind a proxy.

    Attributes
    ----------
    do : callable
        Gives an order to the simulator by its name (`restart`, `clock_step` with `by_s`).
    ask : callable
        Puts question i and returns the error of the answer.
    patient, hasty
        Values of the driver's `deadlines`, the second so short that a lost answer costs little time; None if the
        driver has none.
    hasty_requests
        As `hasty`, if requests are lost; None for the same as `hasty`.
    elsewhere : callable
        Returns the poses (deg, model angles) to which the arm was sent without an order.
    """

    driver: Any
    proxy: FaultProxy
    do: Callable[..., object]
    ask: Callable[[int], float]
    tolerance: float
    longest_s: float
    patient: object
    hasty: object
    elsewhere: Callable[[], list[tuple[float, ...]]] = list
    hasty_requests: object = None

    def start_again(self) -> None:
        """End all faults and start again.

        A person would check the robot and restart its program.
        """
        self.proxy.heal()
        self.be_patient()
        self.do("restart")
        self.restart()

    def restart(self) -> None:
        """Connect and arm.

        A robot whose watchdog has not stopped it yet is waited for, as a person would.
        """
        self.driver.connect()
        end = time.monotonic() + SLACK_S
        while True:
            try:
                self.driver.arm()
            except Busy:
                if time.monotonic() > end:
                    raise
                time.sleep(_ASK_AGAIN_S)
            else:
                return

    def hurry(self, *, requests: bool = False) -> None:
        hasty = self.hasty_requests if requests and self.hasty_requests is not None else self.hasty
        if hasty is not None:
            self.driver.deadlines = hasty

    def be_patient(self) -> None:
        if self.patient is not None:
            self.driver.deadlines = self.patient

"""Promises of an instrument driver beyond wire faults: when it measures, and which target.

A function raises `RequirementFailed` if its promise does not hold.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

from drivers import (
    InstrumentDriver,
    LengthMeter,
    LengthReading,
    LinkError,
    NotArmed,
    PointMeter,
    Refused,
    Unmeasurable,
    instrument_driver,
    open_instrument,
)
from mocks.faultproxy import FaultProxy
from service.conformance import common
from service.conformance.bench import InstrumentBench, SimulatedInstrument, StepsClock
from service.conformance.common import DriverRig, hold, refused

SAMPLES = 10


@dataclass
class InstrumentTrial:
    """A driver on its running simulator."""

    bench: InstrumentBench
    instrument: SimulatedInstrument
    stack: ExitStack

    @property
    def declared(self) -> InstrumentDriver:
        """Return the declaration of the driver.

        Raises
        ------
        ConfigError
            No package declares the driver.
        """
        return instrument_driver(self.bench.driver)

    def url(self, port: int) -> str:
        """Return the address of the simulator with this port."""
        return self.bench.url.format(port=port, device=self.instrument)

    def meter(self, url: str | None = None, **options: Any) -> Any:
        """Create the driver, not yet connected.

        Raises
        ------
        ConfigError
            The address or an option cannot be used.
        """
        meter = open_instrument(
            self.bench.driver, url or self.url(self.instrument.port), **{**self.bench.options, **options}
        )
        self.stack.callback(meter.disconnect)
        return meter

    def ready(self, **options: Any) -> Any:
        """Create the driver, connected and armed."""
        meter = self.meter(**options)
        meter.connect()
        meter.arm()
        return meter

    def miss(self, meter: Any, i: int) -> float:
        """Measure target i in turn and return the error of the reading, mm.

        It is infinite for a reading of another target.
        """
        at = i % len(self.bench.targets)
        target, base = (
            self.bench.targets[at],
            (self.bench.base_targets[at] if self.bench.base_targets else None),
        )
        reading = self.measure(meter, target, base)
        truth = [float(value) for value in self.instrument.truth_mm(target, base)]
        if isinstance(reading, LengthReading):
            named = (reading.target, reading.base_target) == (target, base)
            return abs(reading.length_mm - truth[0]) if named else math.inf
        return math.dist(reading.xyz_mm, truth) if reading.target == target else math.inf

    def measure(self, meter: Any, target: str, base: str | None) -> Any:
        """Take one reading."""
        if base is not None:
            return meter.measure(target, base_target=base, samples=SAMPLES)
        if self.declared.finds_by_name:
            return meter.measure(target, samples=SAMPLES)
        return meter.measure(target, samples=SAMPLES, near_mm=self.instrument.truth_mm(target, None))


@contextmanager
def trial(bench: InstrumentBench) -> Iterator[InstrumentTrial]:
    """Run the simulator."""
    with ExitStack() as stack:
        yield InstrumentTrial(bench, stack.enter_context(bench.simulate()), stack)


@contextmanager
def rig(bench: InstrumentBench) -> Iterator[DriverRig]:
    """Yield the driver behind a proxy.

    Question i is to measure one of its targets.
    """
    with trial(bench) as on:

        def do(order: str, **values: float) -> object:
            if order in ("restart", "reboot"):
                return on.instrument.restart()
            if order == "clock_step" and isinstance(on.instrument, StepsClock):
                return on.instrument.step_clock(values["by_s"])
            return None

        proxy = on.stack.enter_context(FaultProxy(on.instrument.port, boundary=bench.end, device=do))
        meter = on.meter(on.url(proxy.port))
        yield DriverRig(
            meter,
            proxy,
            do,
            lambda i: on.miss(meter, i),
            bench.tolerance_mm,
            bench.longest_s,
            bench.patient,
            bench.hasty,
        )


def has_every_verb(on: InstrumentTrial) -> None:
    """Check that the driver has the verbs of its kind."""
    wanted = LengthMeter if on.declared.measures_lengths else PointMeter
    meter = on.meter()
    hold(isinstance(meter, wanted), f"it lacks a verb of drivers.interfaces.{wanted.__name__}")
    hold(isinstance(meter.unverified_on_hardware, bool), "unverified_on_hardware is neither True nor False")


def refuses_what_it_cannot_use(on: InstrumentTrial) -> None:
    """Check that the driver refuses addresses that it cannot use."""
    common.refuses_wrong_addresses(on.meter)


def nobody_there(on: InstrumentTrial) -> None:
    """Check that the driver reports that no device answers at its address."""
    common.nobody_there(on.meter, on.url)


def says_who_it_is(on: InstrumentTrial) -> None:
    """Check that the driver names its device once connected."""
    meter = on.meter()
    meter.connect()
    common.says_who_it_is(meter)


def measures_only_armed(on: InstrumentTrial) -> None:
    """Check that the driver measures only while it is armed."""
    meter = on.meter()
    meter.connect()
    refused(NotArmed, "a reading before arm", partial(on.miss, meter, 0))
    meter.arm()
    meter.disarm()
    refused(NotArmed, "a reading after disarm", partial(on.miss, meter, 0))
    meter.disconnect()
    refused((NotArmed, LinkError), "a reading after disconnect", partial(on.miss, meter, 0))


def reads_the_truth(on: InstrumentTrial) -> None:
    """Check the readings of every target, twice."""
    meter = on.ready()
    for i in range(2 * len(on.bench.targets)):
        miss = on.miss(meter, i)
        hold(miss <= on.bench.tolerance_mm, f"reading {i} is {miss:.4g} mm off")


def refuses_what_is_not_there(on: InstrumentTrial) -> None:
    """Check that a target that cannot be measured is refused, and that the next one is measured."""
    meter = on.ready()
    base = on.bench.base_targets[0] if on.bench.base_targets else None
    if on.declared.finds_by_name:
        refused(
            (Unmeasurable, Refused, LinkError),
            f"target {on.bench.absent}",
            partial(on.measure, meter, on.bench.absent, base),
        )
        meter.connect()
        meter.arm()
    hold(on.miss(meter, 1) <= on.bench.tolerance_mm, "the reading after it is wrong")


def stops_at_any_time(on: InstrumentTrial) -> None:
    """Before a reading, twice, and without a connection: nothing but errors of the drivers."""
    meter = on.meter()
    common.only_ours("stop without a connection", meter.stop)
    meter.connect()
    meter.arm()
    common.only_ours("stop before any reading", meter.stop)
    common.only_ours("stop twice", meter.stop)


def puts_bytes_on_record(on: InstrumentTrial) -> None:
    """Check that the driver hands every byte of the wire to its record."""
    heard = common.WireByteCount()
    on.miss(on.ready(wire=heard), 0)
    common.puts_bytes_on_record(heard)


PROMISES: dict[str, Callable[[InstrumentTrial], None]] = {
    "has every verb of its kind": has_every_verb,
    "refuses wrong addresses": refuses_what_it_cannot_use,
    "says when nobody answers": nobody_there,
    "says who answers; disconnect is final": says_who_it_is,
    "measures only when armed": measures_only_armed,
    "reads the truth, of the target asked for": reads_the_truth,
    "refuses what is not there": refuses_what_is_not_there,
    "stop at any time": stops_at_any_time,
    "puts every byte on record": puts_bytes_on_record,
}

"""Clocks that step, stand still or restart behind a bridge, and samples that are no answer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import pytest

from drivers import BeamBroken, FaroTracker, NoisyMeasurement, Qc20w
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.shared.mbp import line
from tests.drivers.expected import MBP_MEASURE, ExpectedDevice, Pair

MODE: Pair = (line("5 MODE distance=IFM_ADM"), line("5 OK"))
ARMED = [*MBP_MEASURE, MODE]
BROKEN = line("! 1 BEAM_BROKEN t=100.0")


def measured(
    number: int, t_s: float, *, age_s: float = 0.0, before: bytes = b"", during: bytes = b""
) -> Pair:
    """Return a request and its answer with the time stamp `t_s`.

    Further lines may come before the acknowledgement and after it.
    """
    reply = (
        f"{number} OK x=300.0 y=400.0 z=0.0 sx=0.01 sy=0.02 sz=0.01 n=10 t={t_s!r} age={age_s!r} r=500.0 status=0 "
        "target=T1"
    )
    return (
        line(f"{number} MEASURE samples=10 rate=100.0 timeout=5.1 face=1 target=T1"),
        before + line(f"{number} ACK eta=1.0") + during + line(reply),
    )


@contextmanager
def tracker_with(*conversations: Sequence[Pair]) -> Iterator[FaroTracker]:
    with ExpectedDevice(*([*ARMED, *pairs] for pairs in conversations)) as device:
        tracker = FaroTracker(f"tcp://127.0.0.1:{device.port}", heartbeat_s=None)
        tracker.connect()
        tracker.arm()
        yield tracker
        tracker.disconnect()


def test_a_step_back_costs_one_reading() -> None:
    with tracker_with([measured(6, 5000.0), measured(7, 1400.0), measured(8, 1401.0)]) as tracker:
        assert tracker.measure("T1", samples=10).t_s == 5000.0
        with pytest.raises(NoisyMeasurement, match="did not advance"):
            tracker.measure("T1", samples=10)
        assert tracker.measure("T1", samples=10).t_s == 1401.0


def test_a_step_forth_costs_nothing() -> None:
    with tracker_with([measured(6, 5000.0), measured(7, 8600.0)]) as tracker:
        assert tracker.measure("T1", samples=10).t_s == 5000.0
        assert tracker.measure("T1", samples=10).t_s == 8600.0


def test_a_clock_that_stands_is_refused_always() -> None:
    with tracker_with([measured(6, 5000.0), measured(7, 5000.0), measured(8, 5000.0)]) as tracker:
        tracker.measure("T1", samples=10)
        for _ in range(2):
            with pytest.raises(NoisyMeasurement, match="did not advance"):
                tracker.measure("T1", samples=10)


def test_old_readings_by_turns_are_refused_always() -> None:
    with tracker_with(
        [measured(6 + i, t_s) for i, t_s in enumerate((5.0, 6.0, 5.0, 6.0, 5.0, 7.0))]
    ) as tracker:
        for t_s in (5.0, 6.0):
            assert tracker.measure("T1", samples=10).t_s == t_s
        for _ in range(3):
            with pytest.raises(NoisyMeasurement, match="did not advance"):
                tracker.measure("T1", samples=10)
        assert tracker.measure("T1", samples=10).t_s == 7.0


def test_a_bridge_that_begins_anew_is_believed_at_once_but_not_its_last_reading_again() -> None:
    with tracker_with(
        [measured(6, 5000.0)], [measured(6, 12.0)], [measured(6, 12.0), measured(7, 13.0)]
    ) as tracker:
        tracker.measure("T1", samples=10)
        tracker.connect()
        tracker.arm()
        assert tracker.measure("T1", samples=10).t_s == 12.0
        tracker.connect()
        tracker.arm()
        with pytest.raises(NoisyMeasurement, match="did not advance"):
            tracker.measure("T1", samples=10)
        assert tracker.measure("T1", samples=10).t_s == 13.0


def test_a_beam_broken_while_averaging_voids_whatever_the_clock_says() -> None:
    with tracker_with([measured(6, 8600.0, during=BROKEN)]) as tracker, pytest.raises(BeamBroken):
        tracker.measure("T1", samples=10)


def test_a_beam_broken_long_ago_voids_nothing() -> None:
    with tracker_with([measured(6, 8600.0, before=BROKEN)]) as tracker:
        assert tracker.measure("T1", samples=10).t_s == 8600.0


def test_an_age_below_zero_is_a_clock_that_stepped() -> None:
    with tracker_with([measured(6, 5000.0, age_s=-3600.0), measured(7, 1400.5)]) as tracker:
        with pytest.raises(NoisyMeasurement, match="old"):
            tracker.measure("T1", samples=10)
        with pytest.raises(NoisyMeasurement, match="did not advance"):
            tracker.measure("T1", samples=10)


def test_samples_are_counted_and_never_an_answer() -> None:
    sample = line("# 6 t=4999.0 x=1.0 y=2.0 z=3.0 status=0")
    with tracker_with([measured(6, 5000.0, before=3 * sample, during=sample)]) as tracker:
        assert tracker.measure("T1", samples=10).xyz_mm == (300.0, 400.0, 0.0)
        assert tracker.session.client.samples == 4
        assert tracker.session.client.strangers == 0


def test_stream_of_the_simulator() -> None:
    with CellThread(CellFile(time_scale=100.0, effects=("none",))) as cell:
        tracker = FaroTracker(cell.url("faro"), heartbeat_s=None)
        tracker.connect()
        tracker.arm()
        tracker.measure("T1", samples=10)
        ask = tracker.session.ask
        first = float(ask("PING", {}).fields["t"])
        ask("STREAM", {"on": 1, "rate": 10.0})
        while tracker.session.client.samples < 20:
            ask("PING", {})
        ask("STREAM", {"on": 0})
        last = float(ask("PING", {}).fields["t"])
        seen = tracker.session.client.samples
        assert seen <= 10.0 * (last - first) + 1
        tracker.measure("T1", samples=10)
        assert tracker.session.client.samples == seen
        tracker.disconnect()


def test_a_stream_left_running_on_a_serial_line() -> None:
    file = CellFile(time_scale=100.0, effects=("none",), nests={"B1": (100.0, 200.0, 300.0)})
    with CellThread(file, devices=("qc20w-serial",)) as cell:
        url = str(cell.endpoints[0].line()["url"])
        first = Qc20w(url, nominal_mm=300.0, heartbeat_s=None)
        first.connect()
        first.session.ask("STREAM", {"on": 1, "rate": 50.0, "base": "B1", "target": "T1"})
        while not first.session.client.samples:
            first.session.ask("PING", {})
        first.disconnect()
        second = Qc20w(url, nominal_mm=300.0, heartbeat_s=None)
        second.connect()
        second.arm()
        seen = second.session.client.samples
        for _ in range(20):
            second.session.ask("PING", {})
        assert second.session.client.samples == seen  # the greeting has ended it
        assert second.session.client.strangers == 0
        second.disconnect()

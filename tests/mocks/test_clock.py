"""Test that a simulated controller shows the true state of an instant, even if read late."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import numpy as np
import pytest

from mocks.shared.arm_device import ArmDevice
from mocks.shared.clock import MOST_LATE_S, QUICKEST_S, CellClock, Past
from mocks.ur.servo import COUNT_RAD, LAG_S, Servo

LIMITS = ((-360.0, 360.0),) * 6


class Wall:
    """A clock on the wall that a test puts forward."""

    def __init__(self) -> None:
        self.s = 0.0

    def __call__(self) -> float:
        return self.s


def moved() -> tuple[Wall, CellClock, Servo]:
    """Simulate an arm that was stopped on its way and sent on at once.

    It has been at rest for 100 s since it arrived.
    """
    wall = Wall()
    clock = CellClock(wall=wall)
    arm = ArmDevice(clock.now, LIMITS)
    servo = Servo(arm)
    for at_s, act in {
        1.0: lambda: arm.start((30.0, 0, 0, 0, 0, 0), rate_deg_s=10.0, tool_mm_s=np.inf),
        3.0: arm.halt,
        3.02: lambda: arm.start((20.0, 5.0, 0, 0, 0, -10.0), rate_deg_s=5.0, tool_mm_s=np.inf),
        105.0: arm.wake,
    }.items():
        wall.s = at_s
        act()
    return wall, clock, servo


def seen(clock: CellClock, instants: np.ndarray, value: Callable[[], tuple[float, ...]]) -> np.ndarray:
    """Read `value` at each of the instants (n,); return (n, 6)."""
    rows = []
    for at_s in instants:
        with clock.held(float(at_s)):
            rows.append(value())
    return np.array(rows)


def test_the_servo_at_a_past_instant_is_what_it_was_then() -> None:
    _, clock, servo = moved()
    instants = np.arange(0.5, 8.0, 0.008)
    shuffled = np.random.default_rng(1).permutation(len(instants))
    actual, speed = (seen(clock, instants, value) for value in (servo.actual, servo.actual_speed))
    assert np.array_equal(seen(clock, instants[shuffled], servo.actual), actual[shuffled])
    # a first-order lag has no jumps, and its speeds lead from one state to the next
    led = 0.008 * (speed[1:] + speed[:-1]) / 2.0
    assert np.abs(np.diff(actual, axis=0) - led).max() < COUNT_RAD + np.radians(10.0) * 0.008**2 / LAG_S
    assert np.degrees(actual[-1]) == pytest.approx((20.0, 5.0, 0, 0, 0, -10.0), abs=1e-3)
    halted = np.degrees(seen(clock, np.array([3.01]), servo.target)[0, 0])
    assert halted == pytest.approx(20.0, abs=1e-9)


def test_the_servo_is_never_asked_for_more_than_a_number_holds() -> None:
    _, clock, servo = moved()
    instants = np.array([105.0, 7.5, 0.0, -1e4])
    assert np.isfinite(seen(clock, instants, servo.actual)).all()


def test_a_value_of_the_past() -> None:
    wall = Wall()
    clock = CellClock(wall=wall)
    value = Past(clock.now, "none")
    for at_s, change in ((1.0, "one"), (2.0, "two")):
        wall.s = at_s
        value.change(change)
    asked = {}
    for at_s in (0.5, 1.0, 1.9, 2.0, 9.0):
        with clock.held(at_s):
            asked[at_s] = value.value
    assert asked == {0.5: "none", 1.0: "one", 1.9: "one", 2.0: "two", 9.0: "two"}


@pytest.mark.parametrize("period_s", [0.01, QUICKEST_S / 10])
def test_other_tasks_have_their_turn_while_a_late_sampler_catches_up(period_s: float) -> None:
    """Each sample takes longer than its period: the sampler stays late for ever."""

    async def race() -> tuple[int, int]:
        wall = Wall()
        turns, ticks = 0, 0

        async def others() -> None:
            nonlocal turns
            while True:
                await asyncio.sleep(0)
                turns += 1

        task = asyncio.create_task(others())
        async for _, at_s in CellClock(wall=wall).ticks(period_s):
            wall.s += 2.0 * period_s
            ticks += 1
            assert wall.s - at_s <= MOST_LATE_S + 3.0 * period_s
            if ticks == 200:
                break
        task.cancel()
        return turns, ticks

    turns, ticks = asyncio.run(race())
    assert turns >= ticks - 1

"""Simulated QC20-W ballbar behind its MBP/1 bridge (BALLBAR), on TCP and a pseudo-terminal.

The bar spans a ball on the tool and a ball on the base (the cell's nests). Its sensor shows the true distance
less the bar's length, which grows with the temperature, plus a zero that creeps by some micrometres. Beyond
+-1.0 mm it shows its stop. If `mounted` is None, the bar is between the requested balls, as in a rehearsal. If
it is a pair of names, the bar sits there for any request (the operator's mix-up).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from mocks.shared.arm_device import ArmDevice
from mocks.shared.at_rest import state_at_rest
from mocks.shared.clock import CellClock
from mocks.shared.mbp import BadRequest, pairs, value
from mocks.shared.mbp_bridge import Fields, MbpBridge
from mocks.shared.sockets import Endpoint
from mocks.world import World

BAR_STREAM = 40
STROKE_MM = 1.0
EXPANSION_PER_K = 11.7e-6
SINGLE_SIGMA_MM, MEAN_SIGMA_MM = 0.0005, 0.0003
ZERO_DRIFT_MM, ZERO_DRIFT_S = 0.003, 1800.0


class BallbarDevice:
    """State of one bar.

    `nominal_mm` is the length on its case; its true length differs by some micrometres.
    """

    def __init__(
        self,
        world: World,
        arm: ArmDevice,
        clock: CellClock,
        balls: Mapping[str, Sequence[float]],
        nominal_mm: float = 300.0,
    ) -> None:
        self.world, self.arm, self.clock = world, arm, clock
        self.balls = {name: np.asarray(p, dtype=float) for name, p in balls.items()}
        self._rng = np.random.default_rng([world.seed, BAR_STREAM])
        self.state = "READY"
        self.mounted: tuple[str, str] | None = None  # base ball, tool ball
        self.built_by_hand = False  # otherwise it has its stated length, as in a rehearsal
        self.in_calibrator = True  # whenever ZERO is asked
        self.knocked_mm = 0.0
        self.serial = "2Q0001"
        self.battery = 80.0
        self.radio = True
        self.scale = 1.0 + 1e-4 * float(self._rng.normal())
        self._zero_mm = ZERO_DRIFT_MM * float(self._rng.choice((-1.0, 1.0)))
        self.nominal_mm = 0.0
        self.length_mm = 0.0
        self.extend(nominal_mm)

    def extend(self, nominal_mm: float) -> None:
        """Build the bar from other extension bars and calibrate it."""
        self.nominal_mm = nominal_mm
        self.length_mm = nominal_mm + 0.005 * float(self._rng.normal())

    def air_c(self) -> float:
        return round(self.world.air_c(self.clock.now()), 2)

    def zero_mm(self) -> float:
        """Return the value that the sensor should show in its calibrator now."""
        return self._zero_mm * (1.0 - math.exp(-self.clock.now() / ZERO_DRIFT_S))

    def read_zero(self) -> float:
        """Return the value that the bar shows in its calibrator, mm.

        Raises
        ------
        BadRequest
            510: the bar is not in its calibrator.
        """
        if not self.in_calibrator:
            raise BadRequest(510, "the bar is not in its calibrator")
        return self.zero_mm() + self.knocked_mm + MEAN_SIGMA_MM * float(self._rng.normal())

    def distance(self, base: str, target: str) -> float:
        """True distance of two balls, mm, each on the base or on the tool."""
        state = state_at_rest(self.world, self.arm, self.clock)
        one, other = (
            self.balls[ball] if ball in self.balls else np.array(self.world.true_point(state, ball))
            for ball in (base, target)
        )
        return float(np.linalg.norm(one - other))

    def deviation(self, base: str, target: str) -> float:
        """Return the value that the sensor would show without its stops, mm."""
        base, target = self.mounted or (base, target)
        if base == target or not {base, target} <= {*self.balls, *self.world.targets}:
            raise BadRequest(103, f"no balls {base}, {target}")
        bar = self.length_mm * (1.0 + EXPANSION_PER_K * (self.air_c() - 20.0))
        return (self.distance(base, target) - bar) / self.scale + self.zero_mm() + self.knocked_mm

    def look(self) -> None:
        """Check that the bar can be read.

        Raises
        ------
        BadRequest
            The bar cannot be read.
        """
        if self.battery < 5.0:
            raise BadRequest(502, "battery low")
        if not self.radio:
            raise BadRequest(601, "no radio link to the bar", retry=True)
        codes = {"OFF": 201, "WARMING": 202, "ERROR": 201}
        if self.state in codes:
            raise BadRequest(codes[self.state], f"bar is {self.state}", retry=True)

    def average(self, base: str, target: str, n: int) -> tuple[float, float]:
        """Return mean and standard deviation of n values, mm.

        Raises
        ------
        BadRequest
            510 or 511: the bar is out of stroke on the long or the short side.
        """
        d = self.deviation(base, target)
        if abs(d) > STROKE_MM:
            raise BadRequest(
                510 if d > 0 else 511, f"out of stroke on the {'long' if d > 0 else 'short'} side"
            )
        mean = d + MEAN_SIGMA_MM * float(self._rng.normal())
        sd = SINGLE_SIGMA_MM * math.sqrt(self._rng.chisquare(n - 1) / (n - 1)) if n > 1 else 0.0
        return max(-STROKE_MM, min(STROKE_MM, mean)), sd


class BallbarBridge:
    """Wire side of the ballbar.

    `odd` holds faults of single readings that the back door sets; one READ uses them up.
    """

    def __init__(self, device: BallbarDevice) -> None:
        self.device = device
        self.odd: dict[str, Any] = {}
        self.bridge = self._make()
        self.serial = self._make()
        self._closing: list[Callable[[], object]] = []

    def _make(self) -> MbpBridge:
        bridge = MbpBridge(
            self.device.clock,
            pairs(proto=1, kind="BALLBAR", vendor="Renishaw", model="QC20-W", serial="2Q0001", fw="1.4")
            + " "
            + pairs(bridge="1.0", crc=1, units="mm,deg,C,hPa", sim=1),
            self._state,
            {"CAL": self._cal},
            {
                "INIT": lambda _: self._init(bridge),
                "READ": lambda fields: self._read(bridge, fields),
                "ZERO": lambda _: self._zero(bridge),
            },
            self._sample,
        )
        return bridge

    # -- serial line --------------------------------------------------------------------------------------

    async def open_pty(self) -> Endpoint:
        """Serve on a pseudo-terminal as well.

        Raises
        ------
        ImportError
            Windows has no pseudo-terminals.
        """
        from mocks.renishaw.serial_line import open_line

        end, self._closing = await open_line(self.serial.serve_serial)
        return end

    def close_pty(self) -> None:
        """Unplug the serial line."""
        closing, self._closing = self._closing, []
        for close in closing:
            close()

    # -- back door ----------------------------------------------------------------------------------------

    def orders(self) -> dict[str, Any]:
        """Return the orders of the back door."""
        return {
            "mount": self._mount,
            "extend": self._extend,
            "knock": lambda order: setattr(self.device, "knocked_mm", float(order["by_mm"])),
            "battery": lambda order: setattr(self.device, "battery", float(order["percent"])),
            "calibrator": lambda order: setattr(self.device, "in_calibrator", bool(order["on"])),
            "radio": self._radio,
            "flicker": lambda _: self.bridge.event("LINK_DOWN"),  # and back at once: samples are lost
            "pair": self._pair,
            "odd_length": lambda order: self.odd.update(order["fields"]),
        }

    def _mount(self, order: dict[str, Any]) -> None:
        self.device.mounted = (order["base"], order["target"]) if order["base"] is not None else None

    def _extend(self, order: dict[str, Any]) -> None:
        self.device.built_by_hand = True
        self.device.extend(float(order["nominal_mm"]))

    def _radio(self, order: dict[str, Any]) -> None:
        self.device.radio = bool(order["on"])
        for bridge in (self.bridge, self.serial):
            bridge.event("LINK_UP" if self.device.radio else "LINK_DOWN")

    def _pair(self, order: dict[str, Any]) -> None:
        """Lose the bar for a moment and pair another one, with another length."""
        self.device.serial = str(order["serial"])
        self.device.length_mm += float(order["longer_mm"])
        for bridge in (self.bridge, self.serial):
            bridge.event("LINK_DOWN")
            bridge.event("LINK_UP")

    def reboot(self) -> None:
        self.device.state = "OFF"
        for bridge in (self.bridge, self.serial):
            bridge.reboot()

    # -- commands -----------------------------------------------------------------------------------------

    def _state(self) -> str:
        device = self.device
        busy = self.bridge.busy or self.serial.busy
        state = "BUSY" if busy and device.state == "READY" else device.state
        return f"state={state} " + pairs(T=device.air_c(), batt=device.battery)

    def _cal(self, fields: Fields) -> str:
        device = self.device
        said = value(fields, "nominal", device.nominal_mm)
        if not device.built_by_hand and abs(said - device.nominal_mm) > STROKE_MM:
            device.extend(said)
        return pairs(
            L0=round(device.length_mm, 4),
            scale=round(device.scale, 6),
            u=0.0005,
            alpha=1e6 * EXPANSION_PER_K,
            date="2026-03-02",
            cert="SIM-0001",
            serial=device.serial,
        )

    def _sample(self, fields: Fields) -> str:
        """Return one line of a stream: the value of the sensor, and whether it is at its stop."""
        self.device.look()
        d = self.device.deviation(fields.get("base", ""), fields.get("target", ""))
        return pairs(d=max(-STROKE_MM, min(STROKE_MM, d)), over=(d > STROKE_MM) - (d < -STROKE_MM))

    async def _init(self, bridge: MbpBridge) -> str:
        await bridge.wait(2.0, lambda: None)
        if self.device.state == "OFF":
            self.device.state = "READY"
        return ""

    async def _zero(self, bridge: MbpBridge) -> str:
        self.device.look()
        await bridge.wait(1.0, self.device.look)
        return pairs(offset=self.device.read_zero())

    async def _read(self, bridge: MbpBridge, fields: Fields) -> str:
        device, n = self.device, int(value(fields, "n", 1.0))
        rate = value(fields, "rate", 100.0)
        if n < 1 or not 1.0 <= rate <= 1000.0:
            raise BadRequest(103, "n or rate out of range")
        base, target = fields.get("base", ""), fields.get("target", "")
        device.look()
        before = device.arm.joints_deg()
        await bridge.wait(n / rate, device.look)
        if device.arm.joints_deg() != before:
            raise BadRequest(303, "bar moved during averaging", retry=True)
        d, sd = device.average(base, target, n)
        answer: dict[str, object] = {"d": d, "sd": sd, "n": n, "t": bridge.t(), "age": 0.0}
        answer |= {"temp": device.air_c(), "batt": device.battery, "link": -60, "over": 0}
        odd, self.odd = self.odd, {}
        return pairs(**(answer | odd))

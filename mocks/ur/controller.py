"""Simulated Universal Robots controller: CB3, e-Series or PolyScope X.

It serves RTDE, the ports 30001 to 30003, the dashboard and the Robot API.
Written from the maker's sheets and manuals, not from the driver. These properties are kept on purpose:

- Nothing acknowledges a program, and a new program aborts the running one.
- In local mode, without power or in a safety stop, a program is ignored silently. From software 5 on, switching to
  local mode drops the connections on 30001 to 30003, and 30001 answers a program with the error C210.
- From software 5.10 on each port but that of the Robot API can be closed; PolyScope X has no dashboard and no 30003.
- All streams continue in every stop.
- The program ends while the joints still settle.
- A protective stop leaves the program paused. A target beyond the joint limits is a protective stop.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from mocks.shared.arm_device import ArmDevice
from mocks.shared.clock import QUICKEST_S, CellClock, Past
from mocks.shared.silence import silence
from mocks.shared.sockets import Endpoint, Handler, Servers
from mocks.ur.packets import (
    Dh,
    configuration,
    error_message,
    exception_message,
    joint_data,
    kinematics,
    masterboard_data,
    message,
    mode_data,
    package,
    realtime_packet,
    version_message,
)
from mocks.ur.registers import Registers, Variable
from mocks.ur.robot_api import SimulatedRobotApi
from mocks.ur.rtde import RtdeClient, unsimulated
from mocks.ur.script import AWAIT, Call, ScriptError, ScriptReader, parse_program
from mocks.ur.servo import Servo
from mocks.world import World
from mocks.world.kinematics import Geometry, nominal_geometry

PERIOD_S = 0.008
SECONDARY_S = 0.1
TYPES = {"ur5": 1, "ur10": 2, "ur3": 3, "ur16": 4, "ur20": 7, "ur30": 8}  # those of the e-Series are the same
SERIAL = "20155301234"
NORMAL, PROTECTIVE_STOP, ROBOT_EMERGENCY_STOP = 1, 3, 7
POWER_OFF, IDLE, RUNNING = 3, 5, 7
STOPPED, PLAYING, PAUSED = 1, 2, 4
TEXT_MESSAGE, ONLY_READS = 0, 210
PORTS = {"rtde": 0, "realtime": -1, "secondary": -2, "primary": -3, "dashboard": -5}
FASTEST_RAD_S = math.pi  # of any joint of a UR5


class UrController:
    """State of the controller, the program it runs, and the handlers of its four ports."""

    def __init__(self, arm: ArmDevice, clock: CellClock, world: World) -> None:
        self.arm = arm
        self.clock = clock
        self.world = world
        self.servo = Servo(arm)
        name = world.robot.name
        self._series = name.removesuffix("e")
        of_today = name.endswith("e") or name in ("ur20", "ur30")
        self.software: tuple[int, int, int, int] = (5, 11, 1, 108318) if of_today else (3, 15, 8, 106339)
        self.serial = SERIAL  # empty: software that does not report it
        self.checksum: tuple[int, ...] | None = None  # of another arm's calibration; None: of its geometry
        self.registers = Registers(arm.now)
        self._playing = Past(arm.now, False)
        self.forced_safety_mode: int | None = None
        self.speed_slider = 1.0
        self.refused: list[str] = []  # programs that it did not run, and why
        self.closed: set[str] = (
            set()
        )  # of PORTS, before it listens; "realtime" and "dashboard" of PolyScope X
        self._program: asyncio.Task[None] | None = None

    # -- state --------------------------------------------------------------------------------------------

    @property
    def robot_mode(self) -> int:
        if self.arm.motors_on:
            return RUNNING
        return POWER_OFF if self.arm.emergency_stop else IDLE

    @property
    def safety_mode(self) -> int:
        if self.forced_safety_mode is not None:
            return self.forced_safety_mode
        if self.arm.emergency_stop:
            return ROBOT_EMERGENCY_STOP
        return PROTECTIVE_STOP if self.arm.hung else NORMAL

    @property
    def runtime_state(self) -> int:
        if self._playing.value:
            return PLAYING
        return PAUSED if self.safety_mode == PROTECTIVE_STOP and self._program is not None else STOPPED

    @property
    def can_run(self) -> bool:
        return self.arm.can_move and self.safety_mode == NORMAL

    def variables(self) -> dict[str, Variable]:
        """Return the variables that a client can request over RTDE."""
        state: dict[str, Variable] = {
            "timestamp": ("DOUBLE", self.clock.now),
            "target_q": ("VECTOR6D", self.servo.target),
            "target_qd": ("VECTOR6D", self.servo.target_speed),
            "actual_q": ("VECTOR6D", self.servo.actual),
            "actual_qd": ("VECTOR6D", self.servo.actual_speed),
            "robot_mode": ("INT32", lambda: self.robot_mode),
            "safety_mode": ("INT32", lambda: self.safety_mode),
            "runtime_state": ("UINT32", lambda: self.runtime_state),
            "speed_scaling": ("DOUBLE", lambda: self.speed_slider),
            "joint_temperatures": ("VECTOR6D", lambda: (30.0,) * 6),
        }
        return state | unsimulated() | self.registers.variables()

    def orders(self) -> dict[str, Callable[[dict[str, Any]], dict[str, Any] | None]]:
        """Return the orders of the back door that only this device has.

        - {"do": "ur_safety_mode", "mode": 5}; "mode" null sets the state of the arm
        - {"do": "ur_registers", "on": false}
        - {"do": "ur_speed_slider", "fraction": 0.1}
        - {"do": "ur_refused"} returns the programs that were not run, with the reasons
        """
        return {
            "ur_safety_mode": lambda order: self._force_safety(order["mode"]),
            "ur_speed_slider": lambda order: setattr(self, "speed_slider", float(order["fraction"])),
            "ur_registers": lambda order: setattr(self.registers, "served", bool(order["on"])),
            "ur_refused": lambda _: {"refused": list(self.refused)},
        }

    def _force_safety(self, mode: int | None) -> None:
        self.forced_safety_mode = mode
        self.arm.halt()

    async def close(self) -> None:
        """End the program that runs."""
        self.end_program()
        if self._program is not None:
            with suppress(asyncio.CancelledError):
                await self._program

    @property
    def is_local(self) -> bool:
        """Whether it takes no programs by network, a state that a CB3 does not have."""
        return self.software >= (5,) and self.arm.mode != "auto"

    @property
    def is_polyscope_x(self) -> bool:
        return self.software >= (10,)

    # -- programs -----------------------------------------------------------------------------------------

    def submit(self, lines: list[str]) -> bytes:
        """Run a program or a single call from a client; it replaces the running one.

        A secondary program (`sec`) runs at the same time. Returns the messages for the client, of 30001 only.
        """
        now = self.clock.now()
        if self.is_local:
            self.refused.append("in local control")
            return error_message(now, ONLY_READS, 0, "read only")
        if not self.can_run:
            self.refused.append("not in remote control, not running, or in a safety stop")
            return b""
        try:
            calls = parse_program(lines)
        except ScriptError as error:
            self.refused.append(str(error))
            return exception_message(now, 1, str(error))
        if lines[0].startswith("sec"):
            texts = [call.arguments["s1"] for call in calls if call.name == "textmsg"]
            return b"".join(message(now, TEXT_MESSAGE, text.encode()) for text in texts)
        self.end_program()
        self._program = asyncio.create_task(self._run(calls))
        self._playing.change(True)
        return b""

    def end_program(self) -> None:
        """Stop the program that runs."""
        if self._program is not None and not self._program.done():
            self._program.cancel()
            self._playing.change(False)
            self.arm.halt()

    async def _run(self, calls: Sequence[Call]) -> None:
        guards: list[asyncio.Task[None]] = []
        try:
            for call in calls:
                if call.name == "rtde_set_watchdog":
                    guards.append(asyncio.create_task(self._guard(**call.arguments)))
                elif not await self._call(call):
                    return
        finally:
            for guard in guards:
                guard.cancel()
            if self._program is asyncio.current_task():
                self._playing.change(False)

    async def _call(self, call: Call) -> bool:
        """Carry out one call; False ends the program."""
        values = call.arguments
        if call.name == "movej":
            return await self._movej(values["q"], values["v"])
        if call.name == "stopj":
            self.arm.halt()
        elif call.name == "write_output_integer_register":
            self.registers.write_integer(values["output_register"], values["value"])
        elif call.name == "write_output_float_register":
            self.registers.write_double(values["output_register"], float(values["value"]))
        elif call.name == AWAIT:
            while self.registers.inputs.get(values["input_register"], 0) != values["value"]:
                self.registers.input_changed.clear()
                await self.registers.input_changed.wait()
        elif call.name == "sleep":
            await self.clock.wait(values["t"], asyncio.Event())
        return True

    async def _movej(self, q: Sequence[float], v: float) -> bool:
        goal = [math.degrees(angle) for angle in q]
        if not self.arm.within_limits(goal):
            self.arm.supervise()
            return False
        rate = min(v, FASTEST_RAD_S) * self.speed_slider
        self.arm.start(goal, rate_deg_s=math.degrees(rate), tool_mm_s=math.inf)
        while self.arm.moving:
            self.arm.changed.clear()
            await self.clock.wait(self.arm.left_s, self.arm.changed)
            if not self.can_run:
                self.arm.halt()
                return False
        return self.can_run

    async def _guard(self, variable_name: str, min_frequency: float, action: str) -> None:
        """Watchdog over a link: without an update for too long it acts."""
        await silence(1 / min_frequency, lambda: self.registers.received.get(variable_name))
        if action != "ignore":
            self.end_program()

    # -- ports --------------------------------------------------------------------------------------------

    async def listen(self, servers: Servers, port: int) -> list[Endpoint]:
        """Serve RTDE at `port` (0 for a free one) and the other ports at their usual distances.

        Raises
        ------
        OSError
            A port is taken.
        """
        handlers: dict[str, Handler] = {
            "rtde": self.serve_rtde,
            "realtime": self.serve_realtime,
            "secondary": self.serve_secondary,
            "dashboard": self.serve_dashboard,
            "primary": self.serve_primary,
        }
        first = await servers.listen_around(
            {PORTS[name]: None if name in self.closed else handler for name, handler in handlers.items()},
            port,
        )
        ends = [
            Endpoint("ur" if name == "rtde" else f"ur-{name}", name, first + PORTS[name]) for name in handlers
        ]
        if self.is_polyscope_x:
            ends.append(Endpoint("ur-api", "http", await servers.listen(SimulatedRobotApi(self).serve)))
        return ends

    async def serve_rtde(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        rtde = RtdeClient(self.variables, self.registers, self.clock, self.software, reader, writer)
        await rtde.serve()

    async def serve_realtime(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await self._stream(reader, writer, self._realtime, max(PERIOD_S / self.clock.time_scale, QUICKEST_S))

    async def serve_secondary(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await self._serve_packages(reader, writer, talks=False)

    async def serve_primary(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await self._serve_packages(reader, writer, talks=True)

    async def _serve_packages(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, talks: bool
    ) -> None:
        writer.write(version_message(self.software))
        writer.write(package(16, self._mode_data() + self._description()))
        period_s = max(SECONDARY_S / self.clock.time_scale, QUICKEST_S)
        await self._stream(reader, writer, self._robot_state, period_s, talks=talks)

    async def _stream(
        self,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        state: Callable[[], bytes],
        period_s: float,
        *,
        talks: bool = False,
    ) -> None:
        programs = asyncio.create_task(self._programs(reader, writer if talks else None))
        local = self.is_local
        try:
            while not programs.done() and (local or not self.is_local):
                writer.write(state())
                await writer.drain()
                await asyncio.wait([programs], timeout=period_s)
        finally:
            programs.cancel()

    async def _programs(self, reader: asyncio.StreamReader, answers: asyncio.StreamWriter | None) -> None:
        scripts = ScriptReader()
        with suppress(ConnectionError):
            while data := await reader.read(4096):
                for program in scripts.feed(data):
                    told = self.submit(program)
                    if answers is not None and told:
                        answers.write(told)

    async def serve_dashboard(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"Connected: Universal Robots Dashboard Server\n")
        while line := await reader.readline():
            writer.write(self._dashboard(line.decode("latin-1").strip()).encode() + b"\n")
            await writer.drain()

    def _dashboard(self, command: str) -> str:
        if command == "stop":
            self.end_program()
            return "Stopped"
        remote = "true" if self.arm.mode == "auto" else "false"
        answers = {"is in remote control": remote} if self.software >= (5, 6) else {}
        answers |= {
            "get serial number": self.serial or "could not understand: 'get serial number'",
            "get robot model": self._series.upper() if self._series in TYPES else "UNKNOWN",
            "PolyscopeVersion": "URSoftware {}.{}.{}.{}".format(*self.software),
            "programState": "PLAYING" if self.runtime_state == PLAYING else "STOPPED",
        }
        return answers.get(command, f"could not understand: '{command}'")

    # -- packets ------------------------------------------------------------------------------------------

    def _realtime(self) -> bytes:
        return realtime_packet(
            time=self.clock.now(),
            q_target=self.servo.target(),
            qd_target=self.servo.target_speed(),
            q_actual=self.servo.actual(),
            qd_actual=self.servo.actual_speed(),
            motor_temperatures=(30.0,) * 6,
            robot_mode=self.robot_mode,
            joint_modes=(253.0,) * 6,
            safety_mode=self.safety_mode,
            speed_scaling=self.speed_slider,
            v_main=48.0,
            program_state=self.runtime_state,
            safety_status=self.safety_mode,
        )

    def _robot_state(self) -> bytes:
        joints = joint_data(self.servo.actual(), self.servo.target(), self.servo.actual_speed())
        return package(16, self._mode_data() + joints + masterboard_data(self.safety_mode))

    def _mode_data(self) -> bytes:
        return mode_data(
            self.clock.now(),
            self.robot_mode,
            running=self.runtime_state == PLAYING,
            paused=self.runtime_state == PAUSED,
            speed=self.speed_slider,
            emergency=self.safety_mode == ROBOT_EMERGENCY_STOP,
            protective=self.safety_mode == PROTECTIVE_STOP,
        )

    def _description(self) -> bytes:
        """Configuration and kinematics. The factory's numbers are the true ones, without the twist beta."""
        limits = [(math.radians(low), math.radians(high)) for low, high in self.arm.limits_deg]
        nominal = configuration(TYPES.get(self._series, 0), limits, _dh(nominal_geometry(self.world.robot)))
        return nominal + kinematics(_dh(self.world.geometry), self.checksum)


def _dh(geometry: Geometry) -> Dh:
    return Dh(
        theta=geometry.theta,
        a=[a / 1000.0 for a in geometry.a],
        d=[d / 1000.0 for d in geometry.d],
        alpha=geometry.alpha,
    )

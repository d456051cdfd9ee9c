"""Changes to the drivers."""

from __future__ import annotations

from tests.sabotage.change import Change

_ABB = (
    "tests/drivers/test_read_back.py",
    "tests/drivers/test_abb.py",
    "tests/drivers/test_robots.py",
    "tests/drivers/test_transcripts.py",
    "tests/drivers/test_parsers.py",
)
_UR = (
    "tests/drivers/test_read_back.py",
    "tests/drivers/test_commanded.py",
    "tests/drivers/test_ur.py",
    "tests/drivers/test_robots.py",
    "tests/drivers/test_ur_stop.py",
    "tests/drivers/test_ur_transcripts.py",
)
_FANUC = (
    "tests/drivers/test_read_back.py",
    "tests/drivers/test_fanuc.py",
    "tests/drivers/test_robots.py",
    "tests/drivers/test_fanuc_mappdk.py",
    "tests/drivers/test_fanuc_transcripts.py",
)
_MBP = (
    "tests/drivers/test_reading_parsers.py",
    "tests/drivers/test_parsers.py",
    "tests/drivers/test_faro.py",
    "tests/drivers/test_instruments.py",
    "tests/drivers/test_transcripts.py",
)

CHANGES = (
    Change(
        "drivers/ur/arm.py",
        "        hold_deg: float = 0.013,",
        "        hold_deg: float = 1.0,",
        "a UR that stands a degree from its target is believed to have arrived",
        _UR,
    ),
    Change(
        "drivers/abb/arm.py",
        "        hold_deg: float = 0.002,",
        "        hold_deg: float = 1.0,",
        "an ABB that stands a degree from its target is believed to have arrived",
        _ABB,
    ),
    Change(
        "drivers/abb/simple.py",
        "        hold_deg: float = 0.002,",
        "        hold_deg: float = 1.0,",
        "an ABB under Simple Message that stands a degree from its target is believed to have arrived",
        ("tests/drivers/test_read_back.py", "tests/drivers/test_abb_simple.py"),
    ),
    Change(
        "drivers/fanuc/arm.py",
        "        hold_deg: float = 0.003,",
        "        hold_deg: float = 1.0,",
        "a Fanuc that stands a degree from its target is believed to have arrived",
        _FANUC,
    ),
    Change(
        "drivers/abb/arm.py",
        "                self._calsrv.set_conditions(self._watchdog_ms, self._caps.speeds)\n",
        "                pass\n",
        "the watchdog of an ABB is never set: a program that dies leaves the arm moving",
        _ABB,
    ),
    Change(
        "drivers/abb/arm.py",
        "self._main.ask(9, (1, 0, 0, 0))  # every",
        "self._main.ask(9, (0, 0, 0, 0))  # every",
        "an ABB rounds its targets instead of stopping in them",
        _ABB,
    ),
    Change(
        "drivers/abb/arm.py",
        "            if reading.joints_deg == before.joints_deg:\n",
        "            if reading.joints_deg:\n",
        "a damaged answer of an ABB is taken for its position",
        _ABB,
    ),
    Change(
        "drivers/caps.py",
        "            if not low <= q <= high:",
        "            if q < low or q > high:",
        "a target that is not a number passes the limits",
        _UR,
    ),
    Change(
        "drivers/ur/motion.py",
        "        number = here.echo % _LAST_NUMBER + 1  #",
        "        number = here.echo  #",
        "the end of the program before is taken for the end of this one",
        _UR,
    ),
    Change(
        "drivers/ur/motion.py",
        "                undo.callback(self._halt_if_possible)",
        "                undo.callback(lambda: None)",
        "a move that fails leaves the arm moving",
        _UR,
    ),
    Change(
        "drivers/ur/motion.py",
        "{1 / self.watchdog_s:.3f}",
        "{self.watchdog_s:.3f}",
        "the watchdog gets its time where it wants a frequency",
        _UR,
    ),
    Change(
        "drivers/ur/realtime.py",
        "        if not outlives_close:\n",
        "        if command:\n",
        "a disconnect cuts the stop of the move that it ends",
        _UR,
    ),
    Change(
        "drivers/ur/state.py",
        "    if dt <= 0:",
        "    if dt < 0:",
        "a state that comes twice confirms itself",
        (
            "tests/drivers/test_ur_parsers.py",
            "tests/drivers/test_ur_transcripts.py",
        ),
    ),
    Change(
        "drivers/ur/arm.py",
        "tuple(math.degrees(q) for q in state.actual_rad)",
        "tuple(math.degrees(q) for q in state.target_rad)",
        "where a UR was sent is recorded as where it stands",
        _UR,
    ),
    Change(
        "drivers/link.py",
        "            if not unread_allowed:\n                self._nothing_unread(command)\n",
        "",
        "a late answer is taken for that to the next question",
        ("tests/drivers/test_link.py",),
    ),
    Change(
        "drivers/link.py",
        "        except BaseException:\n            self.close()\n            raise\n",
        "        except BaseException:\n            raise\n",
        "a link goes on after a fault",
        ("tests/drivers/test_link.py",),
    ),
    Change(
        "drivers/bridge/mbp.py",
        "    if found and found[1].decode().upper() != checksum(body):",
        "    if found and len(found[1]) != len(checksum(body)):",
        "the checksum of a bridge is not verified",
        _MBP,
    ),
    Change(
        "drivers/bridge/mbp.py",
        "                elif message.number != asked:",
        "                elif message.number > asked:",
        "the answer to an earlier question is taken for this one's",
        _MBP,
    ),
    Change(
        "drivers/bridge/session.py",
        "        new = t_s > self._last_t_s and t_s not in self._stamps",
        "        new = t_s >= self._last_t_s",
        "the reading before is believed to be a new one",
        (*_MBP, "tests/drivers/test_device_clock.py"),
    ),
    Change(
        "drivers/renishaw/qc20w.py",
        "bar.scale * (d - self.zero_mm)",
        "bar.scale * (d + self.zero_mm)",
        "the zero of a ballbar is added where it is to be taken off",
        ("tests/drivers/test_qc20w.py", "tests/drivers/test_reading_parsers.py"),
    ),
    Change(
        "drivers/creaform/ctrack.py",
        "rot_wxyz=(sign * q[0], sign * q[1], sign * q[2], sign * q[3])",
        "rot_wxyz=(sign * q[3], sign * q[0], sign * q[1], sign * q[2])",
        "a quaternion is read with its scalar last",
        ("tests/drivers/test_ctrack.py", "tests/drivers/test_instruments.py"),
    ),
    Change(
        "drivers/fanuc/arm.py",
        "                time.sleep(self.deadlines.gap_s)  # two",
        "                pass  # two",
        "a Fanuc that creeps is believed to stand",
        _FANUC,
    ),
    Change(
        "drivers/fanuc/modbus.py",
        "            if seen.taken != self._number:",
        "            if seen.taken > self._number + 1000:",
        "another client moves the robot during a move and nobody notices",
        _FANUC,
    ),
    Change(
        "drivers/fanuc/mappdk.py",
        "        if found[1] != number or not sealed(found[0]):",
        "        if found[1] != number:",
        "the sum of an answer of our KAREL server is not verified",
        (*_FANUC, "tests/drivers/test_fanuc_parsers.py"),
    ),
    Change(
        "drivers/fanuc/arm.py",
        "math.floor(100 * full_s / wanted_s)",
        "math.ceil(100 * full_s / wanted_s)",
        "a Fanuc moves faster than the caps of the cell",
        _FANUC,
    ),
    Change(
        "drivers/ur/motion.py",
        "speed=min(speed, self._limits.speed))",
        "speed=speed)",
        "a path drives a UR faster than the caps of the cell",
        ("tests/drivers/test_ur.py",),
    ),
)

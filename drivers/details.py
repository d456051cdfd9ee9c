"""What a device tells of itself beyond its common status, asked read-only and without arming.

Each protocol has something of its own: a UR controller its clock, joint temperatures and DH numbers (30003 and 30002),
a Fanuc the meaning of its alarm, simple_message whether motion is possible, an MBP/1 bridge its clock (PING) and
battery (STATUS), the length of a ballbar (CAL), the bodies of a camera (MODELS). For `truepose doctor`; a campaign
needs none of it.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from drivers import mbp
from drivers.abb_simple import AbbSimpleArm
from drivers.abb_simple_packets import parse_state
from drivers.ctrack import CTrack
from drivers.emscon import EmsconTracker
from drivers.errors import AcquisitionError, Busy, NotReady
from drivers.fanuc import FanucArm
from drivers.fanuc_controller import alarm
from drivers.faro import FaroTracker
from drivers.interfaces import Device, InstrumentStatus, RobotStatus
from drivers.leica import LeicaTracker
from drivers.mbp_session import MbpSession
from drivers.qc20w import Qc20w
from drivers.ur import UrArm
from drivers.ur_realtime import parse_packet
from drivers.ur_secondary import DhNumbers
from drivers.ur_state import PLAYING, unfit

_TEMPERATURES, _SPEED = 692, 940  # offsets in the packet of 30003, by the maker's sheet
_LONGEST_BAR_MM = 5000.0


@dataclass(frozen=True, slots=True)
class Details:
    """None or empty: this protocol does not tell.

    `trouble`: why it could not move now; `temperatures_c`: of the joints; `speed_share`: of the speed slider, 1 is
    full; `nominal`: DH numbers that the controller calculates with; `bar_mm`: calibrated length of the ballbar as it
    is built together; `bodies`: reflective targets of each.
    """

    trouble: AcquisitionError | None = None
    temperatures_c: tuple[float, ...] = ()
    speed_share: float | None = None
    nominal: DhNumbers | None = None
    weather_station: bool | None = None
    battery_percent: float | None = None
    bar_mm: float | None = None
    bodies: Mapping[str, int] = field(default_factory=dict)


def details_of(device: Device, status: RobotStatus | InstrumentStatus) -> Details:
    """Of a connected device that has just answered with `status`. Raises LinkError."""
    teller = _TELLERS.get(type(device))
    return Details() if teller is None else teller(device, status)


def clock_of(device: Device) -> float | None:
    """The device's own clock now (s), None where its protocol does not tell. Raises LinkError."""
    teller = _CLOCKS.get(type(device))
    return None if teller is None else teller(device)


# -- robots ----------------------------------------------------------------------------------------------------


def _ur(device: UrArm, status: RobotStatus) -> Details:
    state = parse_packet(status.raw)
    trouble = unfit(state, moving=False)
    if trouble is None and state.runtime_state == PLAYING:
        trouble = Busy(
            "a program runs on the controller",
            what_to_do="Stop the program on the pendant: the first move of a campaign would take its place.",
        )
    return Details(
        trouble=trouble,
        temperatures_c=struct.unpack_from(">6d", status.raw, _TEMPERATURES),
        speed_share=struct.unpack_from(">d", status.raw, _SPEED)[0],
        nominal=device.factory().nominal,
    )


def _fanuc(device: FanucArm, status: RobotStatus) -> Details:
    facility, number = divmod(status.error_number or 0, 1000)
    if not facility or status.mode == "manual":  # an enabled pendant is an alarm of its own
        return Details()
    kind, text = alarm(facility, number)
    return Details(trouble=kind(text, raw=status.raw))


def _abb_simple(device: AbbSimpleArm, status: RobotStatus) -> Details:
    flags = parse_state(status.raw).flags
    well = flags.mode == "auto" and flags.motors_on and flags.emergency_stop is False
    if not well or (flags.motion_possible and not flags.in_error):
        return Details()
    return Details(
        trouble=NotReady(
            f"motion is not possible{f', error {flags.error_code}' if flags.in_error else ''}",
            raw=status.raw,
            what_to_do="Clear the error on the pendant and start all three programs of the controller.",
        )
    )


# -- instruments behind a bridge -------------------------------------------------------------------------------


def _tracker(device: FaroTracker | LeicaTracker, status: InstrumentStatus) -> Details:
    return Details(battery_percent=_battery(device.session, status))


def _emscon(device: EmsconTracker, status: InstrumentStatus) -> Details:
    return Details(weather_station=device.has_weather_station())


def _camera(device: CTrack, status: InstrumentStatus) -> Details:
    reply = device.session.ask("MODELS", {})
    names, totals = (reply.fields.get(key, "").split(",") for key in ("names", "totals"))
    bodies = {name: int(total) for name, total in zip(names, totals, strict=False) if total.isdecimal()}
    return Details(battery_percent=_battery(device.session, status), bodies=bodies)


def _ballbar(device: Qc20w, status: InstrumentStatus) -> Details:
    reply = device.session.ask("CAL", {})
    with device.session.understood():
        length = mbp.number(reply, "L0", 1.0, _LONGEST_BAR_MM)
    return Details(battery_percent=_battery(device.session, status), bar_mm=length)


def _battery(session: MbpSession, status: InstrumentStatus) -> float | None:
    return _if_told(session, mbp.parse(status.raw), "batt")


def _if_told(session: MbpSession, reply: mbp.Message, key: str) -> float | None:
    with session.understood():
        return mbp.number(reply, key) if key in reply.fields else None


_Bridged = FaroTracker | LeicaTracker | CTrack | Qc20w


def _bridge_clock(device: _Bridged) -> float | None:
    return _if_told(device.session, device.session.ask("PING", {}), "t")


def _ur_clock(device: UrArm) -> float:
    return parse_packet(device.status().raw).t_s


_TELLERS: Mapping[type, Callable[..., Details]] = {
    AbbSimpleArm: _abb_simple,
    FanucArm: _fanuc,
    UrArm: _ur,
    EmsconTracker: _emscon,
    FaroTracker: _tracker,
    LeicaTracker: _tracker,
    CTrack: _camera,
    Qc20w: _ballbar,
}
_CLOCKS: Mapping[type, Callable[..., float | None]] = {
    UrArm: _ur_clock,
    **dict.fromkeys((FaroTracker, LeicaTracker, CTrack, Qc20w), _bridge_clock),
}

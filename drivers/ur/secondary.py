"""The secondary client interface of a UR controller, TCP 30002: identity, kinematics.

The primary one (30001, `drivers.ur.primary`) sends the same, and messages as well. Packages have `>IB` size with its
header, and type: 16 robot state, with sub-packages of the same form, 20 message. On every new connection the controller
sends its version message, and then two sub-packages once:

- 6, the configuration data: limits, nominal DH numbers, type of the arm
- 5, the kinematics (software 3.6 or later): DH numbers of this individual arm, calibrated at the factory

Sources: Universal Robots, "Remote control via TCP/IP", sheet of the client interfaces. For 5,
UniversalRobots/Universal_Robots_Client_Library `primary/robot_state/kinematics_info`; for types, its `RobotType`. A
later version may append fields to any of them.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass

from drivers.dh_numbers import ControllerCalibration, DhNumbers, Row
from drivers.errors import LinkTimeout, ProtocolError, naming
from drivers.link import TcpLink
from drivers.ur.deadlines import UrDeadlines
from drivers.ur.software import E_SERIES, Software, software_of

STATE, MESSAGE = 16, 20
_KINEMATICS, _CONFIGURATION = 5, 6
_VERSION_MESSAGE = 3
_LONGEST = 65536
_CONFIGURATION_LAYOUT = ">12d12d5d24d4i"  # limits; speeds, accelerations; defaults; a d alpha theta; types
_KINEMATICS_LAYOUT = ">6I24dI"  # checksums; theta a d alpha; status
_TYPES = {
    1: "UR5",
    2: "UR10",
    3: "UR3",
    4: "UR16e",
    5: "UR18",
    6: "UR8 Long",
    7: "UR20",
    8: "UR30",
    9: "UR15",
}
_TWICE = ("UR5", "UR10", "UR3")  # the e-Series has the types of the CB series; its software is 5 or later
_MOST_PACKAGES = 50
_COMMAND = "factory"
_HAS_KINEMATICS: Software = (3, 6)  # before, sub-package 5 had another meaning


@dataclass(frozen=True, slots=True)
class Factory:
    """The factory data that the controller reports.

    `calibrated` is None before software 3.6. For nearly parallel axes the maker writes a large d and subtracts it on
    the next link. Single numbers of `calibrated` therefore have little meaning, only the chain of all six. The
    `checksum` identifies the calibration.
    """

    model: str
    firmware: str
    nominal: DhNumbers
    calibrated: DhNumbers | None
    checksum: tuple[int, ...] = ()
    status: int | None = None

    @property
    def calibration(self) -> str:
        """A name for the calibration of this arm, from its checksums; empty if it has none."""
        if not set(self.checksum) - {0, 2**32 - 1}:
            return ""
        return f"calibration-{zlib.crc32(struct.pack('>6I', *self.checksum)):08x}"

    @property
    def correction(self) -> DhNumbers | None:
        """The corrections by the factory's calibration to the nominal numbers."""
        return None if self.calibrated is None else self.calibrated.minus(self.nominal)

    @property
    def held(self) -> ControllerCalibration | None:
        """The calibration that the controller calculates with, None if it reports none."""
        correction = self.correction
        if correction is None or not self.calibration:
            return None
        return ControllerCalibration(self.calibration, self.checksum, self.status, correction)


def split_packages(data: bytes) -> list[tuple[int, bytes]]:
    """Split the sub-packages, as (type, content).

    Raises
    ------
    ProtocolError
        A sub-package has a wrong length.
    """
    found = []
    while data:
        size, kind = struct.unpack_from(">IB", data.ljust(5, b"\0"))
        if not 5 <= size <= len(data):
            raise ProtocolError("sub-package of a wrong length", raw=data[:64])
        found.append((kind, data[5:size]))
        data = data[size:]
    return found


def parse_version(message: bytes) -> str | None:
    """Return the version, `3.15.8`, of a version message, None for any other message.

    Raises
    ------
    ProtocolError
        The message has a wrong length.
    """
    if len(message) < 10 or message[9] != _VERSION_MESSAGE:
        return None
    rest = message[10:]
    if not rest or len(rest) < 1 + rest[0] + 6:
        raise ProtocolError("version message of a wrong length", raw=message)
    return ".".join(map(str, struct.unpack_from(">BBi", rest, 1 + rest[0])))


def parse_configuration(content: bytes) -> tuple[str, DhNumbers]:
    """Return the model of the arm, according to its type, and the nominal DH parameters.

    Raises
    ------
    ProtocolError
        The content has a wrong length.
    """
    if len(content) < struct.calcsize(_CONFIGURATION_LAYOUT):
        raise ProtocolError("configuration data of a wrong length", raw=content[:64])
    values = struct.unpack_from(_CONFIGURATION_LAYOUT, content)
    a, d, alpha, theta = (values[29 + 6 * i : 35 + 6 * i] for i in range(4))
    kind = values[55]
    return _TYPES.get(kind, f"UR type {kind}"), _numbers(alpha, a, theta, d)


def parse_kinematics(content: bytes) -> tuple[DhNumbers, tuple[int, ...], int]:
    """Return calibrated DH numbers, checksums, status.

    Raises
    ------
    ProtocolError
        The content has a wrong length.
    """
    if len(content) < struct.calcsize(_KINEMATICS_LAYOUT):
        raise ProtocolError("kinematics of a wrong length", raw=content[:64])
    values = struct.unpack_from(_KINEMATICS_LAYOUT, content)
    theta, a, d, alpha = (values[6 + 6 * i : 12 + 6 * i] for i in range(4))
    return _numbers(alpha, a, theta, d), values[:6], values[30]


def _numbers(alpha: Row, a: Row, theta: Row, d: Row) -> DhNumbers:
    if not all(math.isfinite(each) for each in alpha + a + theta + d):
        raise ProtocolError("DH numbers that are not finite")
    return DhNumbers(
        alpha_deg=tuple(math.degrees(each) for each in alpha),
        a_mm=tuple(1000.0 * each for each in a),
        theta_deg=tuple(math.degrees(each) for each in theta),
        d_mm=tuple(1000.0 * each for each in d),
    )


def read_factory(link: TcpLink, deadlines: UrDeadlines) -> Factory:
    """Read the factory data of a controller over a link to 30002 or 30001 that is not open yet.

    Raises
    ------
    LinkError
        The connection failed.
    """
    link.open(connect_s=deadlines.connect_s)
    try:
        with naming(link.device, _COMMAND):
            return _read(link, deadlines)
    finally:
        link.close()


def read_software(link: TcpLink, deadlines: UrDeadlines) -> Software | None:
    """Read the version that a controller sends first, over a closed link to 30002 or 30001.

    Raises
    ------
    LinkError
        The connection failed.
    """
    link.open(connect_s=deadlines.connect_s)
    try:
        with naming(link.device, _COMMAND):
            kind, content = read_package(link, _COMMAND, deadlines.reply_s)
            return software_of(parse_version(content) or "") if kind == MESSAGE else None
    finally:
        link.close()


def _read(link: TcpLink, deadlines: UrDeadlines) -> Factory:
    firmware = ""
    for _ in range(_MOST_PACKAGES):
        kind, content = read_package(link, _COMMAND, deadlines.reply_s)
        if kind == MESSAGE:
            firmware = parse_version(content) or firmware
        elif kind == STATE:
            parts = dict(split_packages(content))
            software = software_of(firmware)
            if _CONFIGURATION in parts and software is not None:
                model, nominal = parse_configuration(parts[_CONFIGURATION])
                model += "e" if model in _TWICE and software >= E_SERIES else ""
                if software < _HAS_KINEMATICS:
                    return Factory(model, firmware, nominal, None)
                if _KINEMATICS in parts:
                    return Factory(model, firmware, nominal, *parse_kinematics(parts[_KINEMATICS]))
    raise LinkTimeout("no configuration data among the states", device=link.device, command=_COMMAND)


def read_package(link: TcpLink, command: str, reply_s: float) -> tuple[int, bytes]:
    """Read the next package, as (type, content).

    Raises
    ------
    LinkError
        The connection failed.
    """

    def part(count: int) -> bytes:
        return link.read_exactly(count, command=command, deadline="reply_s", seconds=reply_s)

    size, kind = struct.unpack(">IB", part(5))
    if not 5 <= size <= _LONGEST:
        raise ProtocolError("package of a wrong length")
    return kind, part(size - 5)

"""Packets of the emScon programming interface (TPI, TCP 700) of AT901, AT401 and AT402.

Little-endian, packed to 4 bytes: i32 size (counted with itself), i32 type, then by type

    0 command        i32 command, arguments;  its answer: i32 command, i32 status, results
    1 error          i32 command, i32 status          2 single measurement    156 bytes
    8 status change  i32 code                         6, 7, 11 nivel, reflector, probe: 40, 36, up to 256 bytes

Types 6, 7 and 11 come by themselves if another program has switched them on. An answer names only its command, so only
one command may be outstanding. Sizes are checked against the kind of packet before its content is used.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivers.errors import (
    AcquisitionError,
    BeamBroken,
    Busy,
    CommandRefused,
    LinkLost,
    NoisyMeasurement,
    NotReady,
    ProtocolError,
    TargetNotSeen,
)

COMMAND, ERROR, SINGLE, CHANGE = 0, 1, 2, 8
NIVEL, REFLECTOR_POSITION, PROBE_POSITION = 6, 7, 11
UNASKED = (NIVEL, REFLECTOR_POSITION, PROBE_POSITION)  # for programs that show where the beam is
HEADER = struct.Struct("<ii")
_LONGEST_ANSWER = 256

GET_SYSTEM_STATUS, GET_TRACKER_STATUS, SET_UNITS, INITIALIZE = 1, 2, 5, 7
GET_ENVIRONMENT, SET_MODE, SET_COORDINATES, SET_STATIONARY = 21, 24, 26, 28
SET_REFLECTOR, GET_REFLECTOR, GET_REFLECTORS, SET_SEARCH = 40, 41, 42, 43
SET_SETTINGS, GET_SETTINGS = 47, 48
START_MEASUREMENT, STOP_MEASUREMENT, GO_POSITION = 49, 52, 55

_ARGUMENTS: Mapping[int, str] = {
    SET_UNITS: "5i",
    SET_MODE: "i",
    SET_COORDINATES: "i",
    SET_STATIONARY: "2i",
    SET_REFLECTOR: "i",
    SET_SEARCH: "di",
    SET_SETTINGS: "9i",
    GO_POSITION: "3di",
}
_RESULTS: Mapping[int, str] = {
    GET_SYSTEM_STATUS: "10i",
    GET_TRACKER_STATUS: "i",
    GET_ENVIRONMENT: "3d",
    GET_REFLECTOR: "i",
    GET_REFLECTORS: "3id64s",
    GET_SETTINGS: "9i",
}
_SINGLE = struct.Struct("<3i17d")

_ERRORS: Mapping[int, tuple[type[AcquisitionError], str]] = {
    1: (Busy, "busy with another command"),
    2: (CommandRefused, "not implemented"),
    23: (NotReady, "wrong reflector"),
    27: (NotReady, "no weather station"),
    28: (TargetNotSeen, "no point measured last"),
    37: (BeamBroken, "no distance set"),
    38: (LinkLost, "controller without its sensor"),
    39: (NotReady, "not initialised"),
    57: (NotReady, "weather out of range"),
    58: (NotReady, "being compensated"),
    59: (Busy, "busy with itself"),
    94: (NotReady, ""),
    95: (NotReady, ""),
    96: (NotReady, ""),
    10002: (NotReady, ""),
    10004: (TargetNotSeen, "not ready to measure: nothing in the beam"),
    10005: (NotReady, "distance meter is starting up"),
    10009: (NoisyMeasurement, ""),
    10010: (NotReady, "not levelled"),
    10011: (Busy, "another program is connected"),
    10012: (NotReady, "not warmed up"),
    10013: (NoisyMeasurement, "not stable"),
    10014: (TargetNotSeen, ""),
    10015: (LinkLost, "no communication with its sensor"),
    10016: (NotReady, ""),
    10019: (NotReady, "not levelled for its initialisation"),
}


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet.

    `number` is that of its command, or the code of a change; `values` are the results of a good answer.
    """

    kind: int
    number: int
    status: int
    values: tuple[Any, ...]
    raw: bytes


def command(number: int, *arguments: float) -> bytes:
    """Encode a command."""
    body = struct.pack("<i" + _ARGUMENTS.get(number, ""), number, *arguments)
    return HEADER.pack(HEADER.size + len(body), COMMAND) + body


def rest_of(header: bytes) -> int:
    """Return the number of bytes that follow a header of 8 bytes.

    Raises
    ------
    ProtocolError
        No packet of ours can have this header.
    """
    size, kind = HEADER.unpack(header)
    known = {
        COMMAND: range(16, _LONGEST_ANSWER + 1),
        ERROR: (16,),
        SINGLE: (_SINGLE.size + 8,),
        CHANGE: (12,),
        NIVEL: (40,),
        REFLECTOR_POSITION: (36,),
        PROBE_POSITION: range(16, _LONGEST_ANSWER + 1),
    }
    if size not in known.get(kind, ()):
        raise ProtocolError(f"packet of type {kind} and {size} bytes", raw=header)
    return size - HEADER.size


def parse(data: bytes) -> Packet:
    """Parse a packet.

    Raises
    ------
    ProtocolError
        The bytes are not a packet.
    """
    if len(data) < HEADER.size or len(data) - HEADER.size != rest_of(data[: HEADER.size]):
        raise ProtocolError("packet of the wrong size", raw=data)
    kind, body = HEADER.unpack(data[: HEADER.size])[1], data[HEADER.size :]
    if kind == CHANGE:
        return Packet(kind, struct.unpack("<i", body)[0], 0, (), data)
    if kind == SINGLE:
        status, *values = _SINGLE.unpack(body)
        return Packet(kind, START_MEASUREMENT, status, tuple(values), data)
    if kind in UNASKED:
        return Packet(kind, 0, 0, (), data)
    number, status = struct.unpack("<2i", body[:8])
    results = struct.Struct("<" + _RESULTS.get(number, "") if status == 0 and kind == COMMAND else "<")
    if len(body) - 8 != results.size:
        raise ProtocolError(f"answer to {number} of {len(data)} bytes", raw=data)
    return Packet(kind, number, status, results.unpack(body[8:]), data)


def error_of(packet: Packet, device: str, what: str) -> AcquisitionError:
    """Return the error for a status other than 0.

    An unknown number voids a measurement, and refuses any other command.
    """
    measures = packet.number in (START_MEASUREMENT, GO_POSITION)
    kind, words = _ERRORS.get(packet.status, (TargetNotSeen if measures else CommandRefused, ""))
    text = f"tracker says {packet.status}" + (f" ({words})" if words else "")
    return kind(text, device=device, command=what, raw=packet.raw)

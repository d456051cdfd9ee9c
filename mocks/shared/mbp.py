"""MBP/1 lines as the bridge's side writes and reads them; the sum is computed bit by bit."""

from __future__ import annotations

import math
import re

_REQUEST = re.compile(r"([1-9][0-9]*) ([A-Z_]+)((?: [^ ]+)*)")


def crc(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 1021, start FFFF, no reflection. "123456789" gives 29B1."""
    value = 0xFFFF
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = ((value << 1) ^ 0x1021 if value & 0x8000 else value << 1) & 0xFFFF
    return value


def line(text: str) -> bytes:
    """Return a line with its checksum."""
    body = text.encode("ascii")
    return body + f"*{crc(body):04X}\n".encode()


def pairs(**values: object) -> str:
    """`k=v` fields; floats so that they read back to the same double."""
    return " ".join(f"{k}={float(v)!r}" if isinstance(v, float) else f"{k}={v}" for k, v in values.items())


class BadRequest(Exception):
    """A request that cannot be served; `code` is the protocol's error number."""

    def __init__(self, code: int, text: str, *, retry: bool = False) -> None:
        super().__init__(text)
        self.code = code
        self.text = text.replace('"', "'")
        self.retry = retry


def request(data: bytes) -> tuple[int, str, dict[str, str]] | None:
    """Parse a request into number, command and fields; None for a line with a wrong checksum.

    Raises
    ------
    BadRequest
        101: the line is no request.
    """
    body = data.rstrip(b"\n").rstrip(b"\r")
    if len(body) >= 5 and body[-5:-4] == b"*":
        body, given = body[:-5], body[-4:]
        if given.upper() != f"{crc(body):04X}".encode():
            return None
    found = _REQUEST.fullmatch(body.decode("ascii", errors="replace"))
    if not found or int(found[1]) > 2147483647:
        raise BadRequest(101, "not a request")
    fields = dict(word.split("=", 1) for word in found[3].split() if "=" in word)
    return int(found[1]), found[2], fields


def value(fields: dict[str, str], key: str, default: float | None = None) -> float:
    """Return a number from the fields.

    Raises
    ------
    BadRequest
        103: the number is missing or wrong.
    """
    if key not in fields and default is not None:
        return default
    try:
        return float(fields[key])
    except (KeyError, ValueError):
        raise BadRequest(103, f"{key} missing or not a number") from None


def place(fields: dict[str, str]) -> tuple[float, float, float]:
    """Return the point that a POINT request names, mm.

    The fields are `x y z`, or `az el r` (deg, mm).

    Raises
    ------
    BadRequest
        103: a number is missing or wrong.
    """
    if "az" not in fields:
        return value(fields, "x"), value(fields, "y"), value(fields, "z")
    az, el = math.radians(value(fields, "az")), math.radians(value(fields, "el"))
    across, up = value(fields, "r") * math.cos(el), value(fields, "r") * math.sin(el)
    return across * math.cos(az), across * math.sin(az), up

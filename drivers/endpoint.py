"""The canonical address of a device, for every spelling of its URL.

`tcp://localhost:5000`, `TCP://127.0.0.1:05000/` and `tcp://[::1]:5000?background=5002` lead to one socket. The URL is
parsed as by the drivers, so that this address is the one to which they connect.
"""

from __future__ import annotations

import ipaddress
import os
import socket

from drivers.link import parse_url

_LOOPBACK = "loopback"


def endpoints(url: str) -> frozenset[str]:
    """Return the `IP:port` of every address of the host in a URL, or that of a serial device.

    The address of a serial device is its real path. All loopback addresses, IPv4 or IPv6, count as one: `localhost` may
    be any of them. A name that cannot be resolved now is kept as it is.

    Raises
    ------
    ConfigError
        The URL is not an address.
    """
    if "://" not in url:
        return frozenset({os.path.realpath(url)})
    address = parse_url(url)
    try:
        found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):  # no such name; a name that is not valid for a name server
        return frozenset({f"{address.host.casefold().rstrip('.')}:{address.port}"})
    return frozenset(f"{_plain(str(place[0]))}:{address.port}" for *_, place in found)


def _plain(text: str) -> str:
    """Return an IP address without its zone; IPv4 within IPv6 as IPv4."""
    ip = ipaddress.ip_address(text.partition("%")[0])
    ip = getattr(ip, "ipv4_mapped", None) or ip
    # 0.0.0.0 and :: are answered by the computer that asks
    return _LOOPBACK if ip.is_loopback or ip.is_unspecified else str(ip)

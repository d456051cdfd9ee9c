"""Golden conversations, byte for byte with their terminators, and two ends to play them.

`ExpectedDevice` is a scripted device for a driver: it fails on a request that is not the next one and on
pairs left over. `converse` is a scripted client for a simulator.
"""

from __future__ import annotations

import re
import socket
import threading
from collections.abc import Callable, Iterable, Sequence
from types import TracebackType

from tests.drivers.waiting import PATIENCE_S

Pair = tuple[bytes, bytes]

_FLOAT = re.compile(rb"=-?\d+(?:\.\d+)?(?:e-?\d+)?(?= |$)")


def shapes(reply: bytes) -> bytes:
    """Reduce MBP/1 lines to the part that two bridges must have in common.

    Checksums are removed and every number becomes `=0`.
    """
    return b"\n".join(_FLOAT.sub(b"=0", re.sub(rb"\*[0-9A-F]{4}$", b"", line)) for line in reply.splitlines())


class ExpectedDevice:
    """Scripted device on a free port; one connection after another, one list of pairs each."""

    def __init__(self, *conversations: Iterable[Pair]) -> None:
        self._conversations = conversations
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._server.getsockname()[1])
        self.faults: list[str] = []
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        for pairs in self._conversations:
            client, _ = self._server.accept()
            client.settimeout(10)
            with client:
                for wanted, reply in pairs:
                    got = b""
                    while len(got) < len(wanted):
                        data = client.recv(len(wanted) - len(got))
                        if not data:
                            break
                        got += data
                    if got != wanted:
                        self.faults.append(f"expected {wanted!r}, got {got!r}")
                        return
                    client.sendall(reply)
                extra = client.recv(1000)
                if extra:
                    self.faults.append(f"unexpected {extra!r}")

    def __enter__(self) -> ExpectedDevice:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._thread.join(PATIENCE_S)
        self._server.close()
        assert not self._thread.is_alive(), "conversation not finished"
        assert not self.faults, self.faults


def converse(port: int, pairs: Sequence[Pair], same: Callable[[bytes], bytes] = lambda reply: reply) -> None:
    """Ask a simulator each question and compare its answers after `same`."""
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as client:
        for request, wanted in pairs:
            client.sendall(request)
            got = b""
            while len(got) < len(wanted) or (wanted.endswith(b"\n") and not got.endswith(b"\n")):
                data = client.recv(4096)
                assert data, f"closed after {got!r}, expected {wanted!r}"
                got += data
                if same(got) == same(wanted):
                    break
            assert same(got) == same(wanted)


# -- open_abb, as abb.py of robotics/open_abb formats its requests -------------------------------------------

OPEN_ABB_CLIENT: list[Pair] = [
    (b"0 #", b"0 1 "),
    (b"200 #", b"200 0 "),
    (b"8 +00100.0 +00050.0 +00000.0 +00000.0 #", b"8 1 "),
    (b"9 1 0 0 0 #", b"9 1 "),
    (b"2 +0010.00 +0020.50 -0030.25 +0000.00 +0045.00 -0090.00 #", b"2 1 "),
    (b"4 #", b"4 1 10.00 20.50 -30.25 0.00 45.00 -90.00"),
    (b"2 +0010.00 #", b"2 0 "),
    (b"nonsense", b"2 0 "),
    (b"4 #0 #", b"4 1 10.00 20.50 -30.25 0.00 45.00 -90.00"),
    (b"0 #", b"0 1 "),
    (b"55 #", b"55 0 "),
]

# -- the ABB driver with a stock server ----------------------------------------------------------------------

_PING: Pair = (b"0 #", b"0 1 ")
_AT_ZERO: Pair = (b"4 #", b"4 1 0.00 0.00 0.00 0.00 0.00 0.00")
_ARRIVED: Pair = (b"4 #", b"4 1 10.12 -5.00 0.00 0.00 0.00 90.00")
STOCK_MOVE: list[Pair] = [  # behind every question comes a ping
    _PING,
    (b"200 #", b"200 0 "),
    *(_AT_ZERO, _PING) * 2,
    (b"8 500.0000 20.0000 #", b"8 1 "),
    _PING,
    (b"9 1.0000 0.0000 0.0000 0.0000 #", b"9 1 "),
    _PING,
    *(_AT_ZERO, _PING) * 2,
    (b"2 10.1235 -5.0000 0.0000 0.0000 0.0000 90.0000 #", b"2 1 "),
    _PING,
    *(_ARRIVED, _PING) * 2,
]

# -- the ABB driver with CALSRV: main and background connection ----------------------------------------------

CALSRV_MAIN: list[Pair] = [
    (b"0 #", b"0 1 "),
    (b"200 #", b"200 1 CAL 2 5 #\n"),
    (b"202 1 #", b"202 1 1 0.00000 0.00000 0.00000 0.00000 0.00000 0.00000 #\n"),
    (b"202 2 #", b"202 1 2 0.00000 0.00000 0.00000 0.00000 0.00000 0.00000 #\n"),
    (b"208 3 2000 500.00000 20.00000 #", b"208 1 3 2000 500.0 20.0 #\n"),
    (b"202 4 #", b"202 1 4 0.00000 0.00000 0.00000 0.00000 0.00000 0.00000 #\n"),
    (b"202 5 #", b"202 1 5 0.00000 0.00000 0.00000 0.00000 0.00000 0.00000 #\n"),
    (
        b"201 6 10.12345 -5.00000 0.00000 0.00000 0.00000 90.00000 #",
        b"201 1 6 10.12345 -5.00000 0.00000 0.00000 0.00000 90.00000 #\n",
    ),
    (b"209 7 46237 #", b"209 1 7 #\n"),  # by od and awk
    (b"202 8 #", b"202 1 8 10.12345 -5.00000 0.00000 0.00000 0.00000 90.00000 #\n"),
    (b"202 9 #", b"202 1 9 10.12345 -5.00000 0.00000 0.00000 0.00000 90.00000 #\n"),
]
CALSRV_BACKGROUND: list[Pair] = [
    (b"200 #", b"200 1 CAL 2 5 #\n"),
    (b"205 1 #", b"205 1 1 1 1 1 0 0 0 #\n"),
    (b"207 2 #", b"207 1 2 #\n"),
]
CALSRV_REFUSALS: list[Pair] = [
    (b"201 9 500 0 0 0 0 0 #", b"201 0 2 9 #\n"),
    (b"201 10 1 2 3 #", b"201 0 1 10 #\n"),
    (b"299 11 #", b"299 0 9 11 #\n"),
    (b"202 0 #", b"202 0 1 0 #\n"),
    (b"209 12 7 #", b"209 0 6 12 #\n"),  # no target was shown since the last move
    (b"201 13 10 0 0 0 0 0 #", b"201 1 13 10.00000 0.00000 0.00000 0.00000 0.00000 0.00000 #\n"),
    (b"209 14 7 #", b"209 0 6 14 #\n"),  # not its sum
    (b"208 15 2000 0 20 #", b"208 0 1 15 #\n"),
    (b"2 +0010.00 +0020.50 -0030.25 +0000.00 +0045.00 -0090.00 #", b"2 0 "),  # nothing moves on one request
    (b"4 #", b"4 1 10.12 -5.00 0.00 0.00 0.00 90.00"),
]

# -- the FARO driver over MBP/1; sums computed with an independent tool --------------------------------------

MBP_MEASURE: list[Pair] = [
    (
        b"1 HELLO proto=1 client=truepose crc=1*05B0\n",
        b"1 OK proto=1 kind=TRACKER vendor=FARO model=ION serial=X01000500000 fw=4.1 bridge=1.0 crc=1 "
        b"units=mm,deg,C,hPa sim=1*8E53\n",
    ),
    (b"2 STATUS*B508\n", b"2 OK state=READY T=21.89 P=1013.2 H=45.0*E2EA\n"),
    (b"3 STATUS*F2DB\n", b"3 OK state=READY T=21.89 P=1013.2 H=45.0*0C4E\n"),
    (b"4 WEATHER*E944\n", b"4 OK T=21.89 P=1013.2 H=45.0 n=1.000270*C94F\n"),
]

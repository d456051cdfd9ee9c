"""Simulated controller and arm, written from the manual. It imports nothing from the driver."""

import socketserver
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

JOINTS = 6


class AcmeController:
    """Simulated arm: one motion at a time, all joints in proportion. Angles in deg."""

    port = 0

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._sent: list[tuple[float, ...]] = []
        self._deg_s, self._share = 50.0, 1.0
        self.restart()

    def restart(self) -> None:
        """Switch off and on: the arm rests where it is."""
        self._from = self._to = self._now() if self._sent else (0.0,) * JOINTS
        self._begun = time.monotonic()

    def pace(self, deg_s: float) -> None:
        """Set the speed of later motions, deg/s."""
        self._deg_s = deg_s

    def fall_short(self, share: float) -> None:
        """Let later motions end after this fraction of their path."""
        self._share = share

    def targets_deg(self) -> Sequence[Sequence[float]]:
        """Return the target of every motion that was started, deg."""
        return tuple(self._sent)

    def joints_deg(self) -> Sequence[float]:
        """Return the true joint angles, deg."""
        return self._now()

    def moving(self) -> bool:
        """Return whether the arm is moving."""
        return self._done() < 1.0

    def answer(self, line: bytes) -> bytes:
        """Return the answer to one line."""
        text = line.decode("latin-1").strip().rpartition("*")[0]
        if line != framed(text):
            return framed("ERR SUM")
        verb, *words = text.split()
        with self._lock:
            if verb == "MOVE":
                target = tuple(float(word) for word in words)
                self._sent.append(target)
                here = self._now()
                end = tuple(a + self._share * (b - a) for a, b in zip(here, target, strict=True))
                self._from, self._to, self._begun = here, end, time.monotonic()
            elif verb == "STOP":
                self._from = self._to = self._now()
            elif verb == "ID":
                return framed("OK 4711 1.2")
            elif verb == "POS":
                # The state comes before the joints: an arm at rest has its final angles
                state = "MOVING" if self.moving() else "STILL"
                return framed(f"OK {' '.join(f'{q:.3f}' for q in self._now())} {state}")
        return framed("OK")

    def _done(self) -> float:
        way = max(abs(b - a) for a, b in zip(self._from, self._to, strict=True))
        return min(1.0, (time.monotonic() - self._begun) * self._deg_s / way) if way else 1.0

    def _now(self) -> tuple[float, ...]:
        share = self._done()
        return tuple(a + share * (b - a) for a, b in zip(self._from, self._to, strict=True))


def framed(text: str) -> bytes:
    """Return a line with its checksum."""
    return f"{text}*{sum(text.encode('latin-1')) % 256:02X}\n".encode("latin-1")


class AcmeServer(socketserver.ThreadingTCPServer):
    """Server of the simulated controller."""

    daemon_threads = True
    controller: AcmeController


class AcmeConversation(socketserver.StreamRequestHandler):
    """Conversation with one client: a line in, a line out."""

    server: AcmeServer

    def handle(self) -> None:
        """Answer lines until the client disconnects."""
        try:
            for line in self.rfile:
                self.wfile.write(self.server.controller.answer(line))
        except OSError:
            return  # the client has disconnected


@contextmanager
def simulated() -> Iterator[AcmeController]:
    """Run a controller that listens on a free port of this computer."""
    with AcmeServer(("127.0.0.1", 0), AcmeConversation) as server:
        server.controller = AcmeController()
        server.controller.port = server.server_address[1]
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        try:
            yield server.controller
        finally:
            server.shutdown()

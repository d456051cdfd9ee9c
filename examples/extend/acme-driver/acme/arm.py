"""Driver of the Acme Step controller, a line protocol over TCP with checksums.

It has not been run on hardware yet.
"""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivers import Identity, JointReading, MotionStopped, NotArmed, NotReached, ProtocolError, RobotStatus
from drivers.interfaces import is_there
from drivers.limits import Caps
from drivers.link import TcpLink, WireSink, parse_url

JOINTS = 6
RESOLUTION_DEG = 0.001
HOLD_DEG = 0.003  # allowed servo error: twice the repeatability over the reach, from the data sheet
POLL_S = 0.02


@dataclass(frozen=True)
class AcmeDeadlines:
    """Longest waits of the driver, s; `margin_s` is added to the duration of a move."""

    connect_s: float = 3.0
    reply_s: float = 2.0
    margin_s: float = 10.0


def framed(text: str) -> bytes:
    """Return a line with its checksum: the sum of its characters modulo 256, in hexadecimal."""
    return f"{text}*{sum(text.encode()) & 0xFF:02X}\n".encode()


class AcmeArm:
    """Driver of one controller. Methods block; `stop` may be called from any thread.

    Every method that asks the controller fails with LinkError if the answer is missing or wrong.
    """

    unverified_on_hardware = True
    can_stop = True

    def __init__(
        self,
        url: str,
        *,
        name: str = "acme",
        speed_mm_s: float = 250.0,
        speed_deg_s: float = 20.0,
        limits_deg: Sequence[Sequence[float]] | None = None,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
        deadlines: AcmeDeadlines | None = None,
    ) -> None:
        self.name = name
        self.deadlines = deadlines or AcmeDeadlines()
        self._caps = Caps(speed_mm_s, speed_deg_s, limits_deg, joints=JOINTS, widest_deg=360.0, device=name)
        self._link = TcpLink(parse_url(url), name, wire=wire, clock=clock)
        self._clock = clock
        self._armed = False
        self._stopped = threading.Event()
        self._talking = threading.Lock()  # held for one question and its answer, so a stop waits no longer

    def connect(self) -> None:
        """Open the connection and request the identity; nothing moves."""
        self._armed = False
        self._link.open(connect_s=self.deadlines.connect_s)
        self.identify()

    def disconnect(self) -> None:
        """Close the connection and disarm; never raises."""
        self._armed = False
        self._link.close()

    def identify(self) -> Identity:
        """Return the identity of the controller."""
        serial, firmware = self._ask("ID", 2)
        return Identity("Acme", "Step", serial, firmware, "acme-line")

    def arm(self) -> None:
        """Allow motion until a stop or a disconnect."""
        self.position()
        self._stopped.clear()
        self._armed = True

    def disarm(self) -> None:
        """Forbid motion until armed again; never raises."""
        self._armed = False

    def position(self) -> JointReading:
        """Return the joint angles that were read back."""
        return self._where()[0]

    def status(self) -> RobotStatus:
        """Return the part of the status that the protocol has."""
        return RobotStatus("unknown", None, None, self._where()[1])

    def move_to(self, joints_deg: Sequence[float]) -> JointReading:
        """Move to absolute joint angles, deg, and return the angles read back at rest.

        Raises
        ------
        NotArmed, JointLimit
            Nothing was sent.
        LinkError, MotionStopped, NotReached
            The arm may be anywhere on its way.
        """
        if not self._armed:
            raise NotArmed("not armed", device=self.name, command="move_to")
        self._caps.check(joints_deg)
        here = self.position().joints_deg
        turns = [abs(b - a) for a, b in zip(here, joints_deg, strict=True)]
        end = self._clock() + self._caps.seconds(turns) + self.deadlines.margin_s
        self._ask("MOVE " + " ".join(f"{q:.3f}" for q in joints_deg), 0)
        while True:
            if self._stopped.is_set():  # perhaps before the move reached the controller
                self._ask("STOP", 0)
                raise MotionStopped("stopped during the move", device=self.name, command="move_to")
            reading, moving = self._where()
            if not moving and is_there(reading, joints_deg, HOLD_DEG):
                return reading
            if not moving or self._clock() > end:
                self._armed = False
                raise NotReached("stopped short of its target", device=self.name, command="move_to")
            time.sleep(POLL_S)

    def stop(self) -> None:
        """Stop the motion and disarm, from any thread."""
        self._armed = False
        self._stopped.set()
        self._ask("STOP", 0)

    def _where(self) -> tuple[JointReading, bool]:
        words = self._ask("POS", JOINTS + 1)
        try:
            joints = tuple(float(word) for word in words[:JOINTS])
        except ValueError as error:
            raise self._wrong("POS", words) from error
        if words[JOINTS] not in ("STILL", "MOVING"):
            raise self._wrong("POS", words)
        return JointReading(joints, RESOLUTION_DEG), words[JOINTS] == "MOVING"

    def _ask(self, question: str, count: int) -> list[str]:
        """Return the words after OK.

        Any fault closes the link: a late answer must not be taken for the answer to the next question.
        """
        with self._talking, self._link.question(question):
            seconds = self.deadlines.reply_s
            self._link.send(framed(question), command=question, send_s=seconds)
            line = self._link.read_until(b"\n", command=question, deadline="reply", seconds=seconds) + b"\n"
            text = line.decode("latin-1").rpartition("*")[0]
            words = text.split()
            if line != framed(text) or len(words) != count + 1 or words[0] != "OK":
                raise self._wrong(question, [line.decode("latin-1")])
            return words[1:]

    def _wrong(self, question: str, words: Sequence[str]) -> ProtocolError:
        raw = " ".join(words).encode("latin-1")
        return ProtocolError("does not answer the question", device=self.name, command=question, raw=raw)

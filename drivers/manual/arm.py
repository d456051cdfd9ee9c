"""A robot that a person drives with its pendant: each pose is a prompt.

The prompt is answered with the joints on the pendant. Joints that turn are in deg, those that slide in mm, also if a
name ends in `_deg`: a pendant shows both to the same number of digits. The target is shown to the resolution of the
pendant. CONFIRM alone means that the pendant shows the target. Otherwise the person types the angles shown, and these
count. If they differ from the request by more than `within_deg`, the robot is not in the pose, or the angles were
mistyped: the prompt is repeated with the likely mistake.

Nothing moves by itself, and nothing can be stopped: `can_stop` is False, and `stop` ends the waiting with an error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from drivers.errors import CannotStop, ConfigError, JointLimit, NotArmed
from drivers.interfaces import Asking, Identity, JointReading, RobotStatus, TypedEntry
from drivers.limits import Caps
from drivers.link import WireSink
from drivers.manual.meter import InvalidEntry, Questions, TypedRow, TypingDoubt, apart, in_words, slip_of

RESOLUTION_DEG = 0.01
BY_HAND = "this robot is moved by hand: Stop does not reach it"
_WIDEST_DEG = 720.0
_ROUNDING = 1e-9


class ManualArm:
    """A robot that a person drives.

    Parameters
    ----------
    resolution_deg
        Resolution of its pendant.
    within_deg
        Largest distance from a request. Default: the resolution.
    axes, units
        Name and unit (deg or mm) of each joint. Default: j1, j2, ..., all in deg.
    """

    unverified_on_hardware = True
    can_stop = False
    weakness = f"{BY_HAND}, and its joint angles are what a person confirms or types"

    def __init__(
        self,
        url: str = "",
        *,
        name: str = "manual",
        speed_mm_s: float = 250.0,
        speed_deg_s: float = 20.0,
        limits_deg: Sequence[Sequence[float]] | None = None,
        axes: Sequence[str] = (),
        units: Sequence[str] = (),
        resolution_deg: float = RESOLUTION_DEG,
        within_deg: float | None = None,
        serial: str = "",
        wire: WireSink | None = None,
    ) -> None:
        if limits_deg is None:
            raise ConfigError(
                "limits_deg is missing, and the number of joints with it",
                device=name,
                what_to_do="Give a pair of limits per joint.",
            )
        self.name = name
        self._names = tuple(name.upper() for name in axes or [f"j{i + 1}" for i in range(len(limits_deg))])
        self._units = tuple(units or ["deg"] * len(limits_deg))
        self._unit = "deg or mm" if len(set(self._units)) > 1 else self._units[0]
        self._resolution_deg = resolution_deg
        self._within_deg = max(resolution_deg, within_deg or 0.0)
        self._decimals = max(0, math.ceil(-math.log10(resolution_deg) - _ROUNDING))
        self._caps = Caps(
            speed_mm_s,
            speed_deg_s,
            limits_deg,
            joints=len(limits_deg),
            widest_deg=_WIDEST_DEG,
            device=name,
            units=self._units,
        )
        self._serial = serial
        self._wire = wire
        self._questions = Questions(name)
        self._armed = False
        self._here: JointReading | None = None  # None: it may have been moved since a person said where it is

    def attend(self, ask: Asking) -> None:
        """Put questions to a person through `ask` from now on."""
        self._questions.attend = ask

    def connect(self) -> None:
        """Do nothing; the position of the robot is requested when it is needed."""
        self.disarm()

    def disconnect(self) -> None:
        """Disarm; never raises."""
        self.disarm()

    def identify(self) -> Identity:
        """Return the serial number of the cell file; maker and model are unknown."""
        return Identity("", "", self._serial, "", "by hand")

    def arm(self) -> None:
        """Allow prompts for poses."""
        self._armed = True

    def disarm(self) -> None:
        """Allow no prompts until armed again, and discard the position of the robot. Never raises."""
        self._armed = False
        self._here = None

    def position(self) -> JointReading:
        """Return the joints that a person last entered, or have them entered now.

        Errors of the question are passed on.

        Raises
        ------
        NoOperator
            There is no person to ask.
        """
        if self._here is None:
            entry = TypedEntry(self._names, self._unit)
            rows, raw = self._questions.numbers(
                f"Type the joint angles that the pendant shows now. {BY_HAND[:1].upper()}{BY_HAND[1:]}.",
                entry,
                "pendant",
                self._outside,
            )
            self._here = JointReading(rows[0].values, self._resolution_deg, raw)
        return self._here

    def move_to(self, joints_deg: Sequence[float]) -> JointReading:
        """Ask a person to drive to joint angles, deg, and return the angles on the pendant.

        Errors are those of `move_over`.
        """
        return self.move_over((), joints_deg)

    def move_over(self, over_deg: Sequence[Sequence[float]], joints_deg: Sequence[float]) -> JointReading:
        """Ask a person to drive over postures to the last one, and return the joints typed.

        Joints are in deg. Errors of the question are passed on.

        Raises
        ------
        NotArmed, JointLimit
            No question was asked.
        NoOperator
            There is no person to ask.
        LeftOut
            The person skipped the question.
        """
        if not self._armed:
            raise NotArmed("not armed", device=self.name, command="move_to")
        for each in (*over_deg, joints_deg):
            self._caps.check(each)
        target = tuple(self._shown(q) for q in joints_deg)
        entry = TypedEntry(self._names, self._unit, target, needed=False)
        way = "".join(f"over {self._listed(each)}, " for each in over_deg)
        self._here = None  # from the question on it may be moving
        rows, raw = self._questions.numbers(
            f"Drive the robot by hand {way}to {self._listed(joints_deg)}. Confirm when the pendant shows just that, "
            "or type the joint angles that it shows.",
            entry,
            "drive",
            lambda rows: self._wrong(rows, target),
        )
        reached = rows[0].values if rows else tuple(map(float, target))
        self._here = JointReading(reached, self._resolution_deg, raw or " ".join(target).encode())
        return self._here

    def stop(self) -> None:
        """Disarm, and raise an error: only the person who drives the robot can stop it.

        Raises
        ------
        CannotStop
            Always.
        """
        self._armed = False
        raise CannotStop(
            BY_HAND, device=self.name, command="stop", what_to_do="Tell the person who drives it to stop."
        )

    def status(self) -> RobotStatus:
        """Return a status without information."""
        return RobotStatus("unknown", None, None, None)

    def _shown(self, q: float) -> str:
        return f"{round(q / self._resolution_deg) * self._resolution_deg + 0.0:.{self._decimals}f}"

    def _listed(self, joints_deg: Sequence[float]) -> str:
        numbers = [f"{name} {self._shown(q)}" for name, q in zip(self._names, joints_deg, strict=True)]
        if len(set(self._units)) > 1:
            return ", ".join(f"{one} {unit}" for one, unit in zip(numbers, self._units, strict=True))
        return f"{', '.join(numbers)} {self._units[0]}"

    def _outside(self, rows: Sequence[TypedRow]) -> InvalidEntry | None:
        """Return the mistake in typed rows, or None.

        There must be exactly one row. It must be within the joint limits, because no path was checked beyond them.
        """
        if len(rows) != 1:
            return InvalidEntry("count", "", f"{len(rows)} rows were typed, one is needed")
        try:
            self._caps.check(rows[0].values)
        except JointLimit as error:
            return InvalidEntry("limit", "", f"{error.message}: jog it to within its limits first")
        return None

    def _wrong(self, rows: Sequence[TypedRow], target: Sequence[str]) -> InvalidEntry | None:
        """Return the mistake or likely slip in joints typed for a target, or None."""
        if len(rows) != 1:
            return InvalidEntry("count", "", f"{len(rows)} rows were typed, one is needed")
        asked = tuple(map(float, target))
        off = apart(rows[0].values, asked)
        if off <= self._resolution_deg + _ROUNDING:
            return None
        worst = max(range(len(asked)), key=lambda i: abs(rows[0].values[i] - asked[i]))
        slip = slip_of(rows[0], asked, _ROUNDING)
        typed = rows[0].texts[worst]
        unit = self._units[worst]
        far = f"{self._names[worst]} at {typed} {unit} is {off:g} {unit} from the {target[worst]} {unit} asked for"
        if slip is not None:
            name = self._names[worst] if slip.index is None else self._names[slip.index]
            of_slip = self._unit if slip.index is None else self._units[slip.index]
            words = f"{far}: {in_words(slip, self._names, of_slip)}"
            doubtful = off <= self._within_deg + _ROUNDING
            return (TypingDoubt if doubtful else InvalidEntry)(slip.reason, name, words)
        if off > self._within_deg + _ROUNDING:
            return InvalidEntry("far", self._names[worst], f"{far}; {self._within_deg:g} {unit} are allowed")
        return self._outside(rows)

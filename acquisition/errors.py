"""Errors of a campaign, in the same families and by the same rules as `drivers.errors`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Unpack

from calib.errors import DataError
from drivers.errors import (
    AcquisitionError,
    Busy,
    ConfigError,
    ErrorPlace,
    NoisyMeasurement,
    Refused,
    Unmeasurable,
)


@contextmanager
def as_config_error(place: str = "") -> Iterator[None]:
    """Raise a `DataError` of the block as a ConfigError with `place` before its message."""
    try:
        yield
    except DataError as error:
        raise ConfigError(f"{place}{error}") from error


class RecordInUse(Busy):
    """Another program owns this record (and therefore the cell)."""

    code = 3101
    exit_code = 4
    advice = "End the other program that runs this campaign, or look at it with 'campaign status'."


class RobotInUse(AcquisitionError):
    """Another campaign of this computer moves this robot.

    No person is asked: this campaign pauses.
    """

    code = 3106
    exit_code = 4
    advice = "Wait until the other campaign has ended, or pause it; one robot obeys one campaign at a time."


class OtherIndividual(ConfigError):
    """Another robot or instrument answers than the one the record was measured with.

    Attributes
    ----------
    serial
        Serial number of the one that answers; with it, the device can be accepted.
    """

    code = 6103
    exit_code = 5
    advice = (
        "Connect the device of the record, or start a new record. Only where both belong together: accept it by "
        "its serial number and with a reason (--accept-device SERIAL --reason TEXT)."
    )

    def __init__(
        self, message: str, *, serial: str = "", what_to_do: str | None = None, **where: Unpack[ErrorPlace]
    ) -> None:
        super().__init__(message, what_to_do=what_to_do, **where)
        self.serial = serial

    def as_dict(self) -> dict[str, object]:
        """Return the error for JSON, with the serial number."""
        return super().as_dict() | {"serial": self.serial}


class UnsafePlan(Refused):
    """A pose of the plan may not be driven; the plan was checked before the first motion."""

    code = 3102
    exit_code = 5
    advice = (
        "Remove the pose, or correct limits, table, keep-out boxes or fixtures in the cell file, or the capsules of "
        "the robot file; nothing has moved."
    )


class NoClearWay(Refused):
    """Every path to a pose that was tried touches the table, a keep-out box or a fixture."""

    code = 3108
    exit_code = 5
    advice = (
        "Jog the robot to a place high above the table, then confirm; or give the cell file a home_deg from which "
        "every pose can be reached."
    )


class Displaced(Refused):
    """The robot moved after it arrived: while it settled, was measured, or a bar was put on."""

    code = 3109
    advice = (
        "Find out what moved the robot: a hand, the pendant, a brake. Nothing may move it between arrival and reading; "
        "confirm, and the robot approaches the pose again."
    )


class OtherBalls(Refused):
    """A leg of the ballbar is not as long as the calibration of stage 1 predicts."""

    code = 3110
    advice = (
        "Check whether the bar sits on the balls named, with the right extension bar, and whether a cup has moved. "
        "Confirm to measure the leg again, or skip to leave it out."
    )


class TouchedElsewhere(Refused):
    """A ball of the tool was touched far from its cup."""

    code = 3111
    advice = (
        "Jog the named ball into the named cup, then confirm: the touch is requested again. If the cups are not where "
        "the cell file has them, correct its world.nests and begin a new record."
    )


class CupsDisagree(Refused):
    """The touched positions of two cups contradict the ballbar, or the sides make no triangle."""

    code = 3112
    advice = "Confirm to repeat the distances or touches that disagree, or skip to continue with the readings so far."


class NestsDisagree(Refused):
    """The nests measured on the table do not have the distances of the cell file."""

    code = 3103
    advice = "Check that every nest holds its SMR and that the cell file has their true positions."


class WronglySeated(Refused):
    """The SMR was detected at the place of another target, or at none."""

    code = 3107
    advice = (
        "Seat the SMR in the target named, then confirm. If the robot is elsewhere than the cell file says, "
        "correct its world.nests or raise instrument.expected_within_mm."
    )


class Misplaced(Unmeasurable):
    """A target was detected at the place of another, or at none: the beam found another SMR."""

    code = 2101
    advice = (
        "Cover the SMRs that the beam may find instead. If the robot is elsewhere than the cell file says, "
        "correct its world.nests or raise instrument.expected_within_mm."
    )


class NothingNew(NoisyMeasurement):
    """The instrument repeats a reading to the last digit: it is stuck, or its bridge repeats."""

    code = 2102
    advice = (
        "Check whether the bridge still receives data from the instrument and whether a bar moves freely, then "
        "repeat the measurement."
    )


class TurnedOtherwise(Refused):
    """The orientations of a body and of the robot do not agree."""

    code = 3114
    advice = (
        "Check that the bridge sends the turn of the body in the frame of the reference, scalar first, and that the "
        "body sits fast on the tool. Confirm to measure it again; if the first pose was wrong, begin a new record."
    )


class NothingWhereItShouldBe(Refused):
    """No target of the first readings was measured: the arm may differ from the robot file."""

    code = 3113
    advice = (
        "Check that robot.model, joint_coupling and the targets in the cell file are those of this arm: the program "
        "keeps clear only by them. Confirm to continue if only the line of sight is blocked."
    )


class NotResumed(Refused):
    """The campaign is paused or ended, and was not resumed."""

    code = 3104
    advice = "Look at the cell, then resume the campaign; the robot will approach the pose again."


class IllegalTransition(Refused):
    """The campaign cannot go from its state to the requested one."""

    code = 3105
    advice = "Look at the state of the campaign: a finished one cannot be run again."


class StorageError(AcquisitionError):
    """The record cannot be written."""

    code = 5000
    advice = "Make room on the disk or correct its permissions, then resume the campaign."


class RecordTaken(StorageError):
    """Another program writes this record now, although this one has the lock."""

    code = 5101
    advice = "Find out which other program runs this campaign and end one of the two, then resume."


class ClockJumped(StorageError):
    """The calendar jumped relative to the steady clock; times between readings are in doubt."""

    code = 5102
    advice = (
        "The computer slept, or its clock was set: look at its date and time and at the cell, then resume."
    )


class DamagedRecord(StorageError):
    """The file of a record was changed or damaged; `damaged` creates this error."""

    code = 5103
    exit_code = 2


def damaged(path: Path, what: str) -> DamagedRecord:
    """Return the error for a record whose file is `path`.

    `what` is the predicate, "is ..." or "holds ...".
    """
    return DamagedRecord(
        f"{path}: {what}",
        command="record",
        what_to_do=f"Save what can be read with: truepose campaign rescue {path.parent}",
    )


class RecordError(ConfigError):
    """The folder holds no record, one of a newer program, or one that already exists."""

    code = 6101
    advice = "Give the folder of a record made by this program, or a new folder for a new campaign."

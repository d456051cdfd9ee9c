"""Errors of a campaign beside those of the devices; same families, same rules (`drivers.errors`)."""

from __future__ import annotations

from drivers.errors import Busy, ConfigError, Refused


class RecordInUse(Busy):
    """Another program owns this record (and therefore the cell)."""

    code = 3101
    exit_code = 4
    advice = "End the other program that runs this campaign, or look at it with 'campaign status'."


class UnsafePlan(Refused):
    """The plan was checked before the first motion and one of its poses may not be driven."""

    code = 3102
    exit_code = 5
    advice = (
        "Remove the pose, or correct limits, table or keep-out boxes in the cell file; nothing has moved."
    )


class NestsDisagree(Refused):
    """The nests measured on the table do not have the distances of the cell file."""

    code = 3103
    advice = "Check that every nest holds its SMR and that the cell file has their true positions."


class NotResumed(Refused):
    """The campaign is paused or ended, and nobody has asked for it to go on."""

    code = 3104
    advice = "Look at the cell, then resume the campaign; the robot will approach the pose anew."


class IllegalTransition(Refused):
    """The campaign cannot go from its state to the one asked for."""

    code = 3105
    advice = "Look at the state of the campaign: a finished one cannot be run again."


class RecordError(ConfigError):
    """The folder holds no record, one of a newer program, or one that already exists."""

    code = 6101
    advice = "Give the folder of a record made by this program, or a new folder for a new campaign."

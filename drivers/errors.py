"""Errors of devices, grouped according to the reaction of the sequencer.

    LinkError      1xxx   reconnect, approach again, retry
    Unmeasurable   2xxx   retry, then skip the pose
    Refused        3xxx   pause and ask the operator
    SafetyStop     4xxx   stop everything; never resume by itself
    StorageError   5xxx   pause; that of a record, `acquisition.errors`
    ConfigError    6xxx   refuse to start
    NoOperator     7xxx   nobody there to answer a prompt: end with exit code 4

The numeric codes are part of the record (database, HTTP, reports) and never change their meaning. Every error names the
device, the command that was under way and the raw reply, and tells the operator in one sentence what to do.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar, TypedDict, Unpack

_ROLES = ("", "robot", "instrument", "operator")


class ErrorPlace(TypedDict, total=False):
    """The origin of an error: the device, the command that was under way, the raw reply."""

    device: str
    command: str
    raw: bytes


class AcquisitionError(Exception):
    """The base class of all device and campaign errors; code catches only its subclasses."""

    code: ClassVar[int] = 0
    exit_code: ClassVar[int] = 1
    advice: ClassVar[str] = "Note what happened and call the person responsible for the cell."

    def __init__(
        self,
        message: str,
        *,
        device: str = "",
        command: str = "",
        raw: bytes = b"",
        what_to_do: str | None = None,
    ) -> None:
        # A device's own words may hold control characters, which a terminal would obey.
        message = "".join(
            each if each.isprintable() or each in "\n\N{NO-BREAK SPACE}" else "\ufffd" for each in message
        )
        super().__init__(message)
        self.message = message
        self.device = device
        self.command = command
        self.raw = raw
        self.what_to_do = what_to_do if what_to_do is not None else self.advice

    def __str__(self) -> str:
        where = f"{self.device}: " if self.device else ""
        during = f" (during {self.command})" if self.command else ""
        reply = f", reply {self.raw!r}" if self.raw else ""
        return f"{where}{self.message}{during}{reply} [{self.code}]"

    @property
    def sentence(self) -> str:
        """The error as text for the person at the cell: device, problem and remedy."""
        return f"{self.what_happened} {self.what_to_do}"

    @property
    def what_happened(self) -> str:
        """The problem as a sentence that names the device.

        The name is put in front if the message does not have it. An error of the campaign has only a role as its device
        (robot, instrument or operator), and gets no prefix.
        """
        named = self.device in _ROLES or self.device.casefold() in self.message.casefold()
        end = "" if self.message.endswith("?") else "."
        return f"{'' if named else f'{self.device}: '}{self.message.rstrip('.')}{end}"

    def as_dict(self) -> dict[str, object]:
        """Return plain values for the audit log and for problem+json; raw bytes as latin-1 text."""
        return {
            "code": self.code,
            "name": type(self).__name__,
            "device": self.device,
            "command": self.command,
            "message": self.message,
            "raw": self.raw.decode("latin-1"),
            "what_to_do": self.what_to_do,
        }


@contextmanager
def naming(device: str, command: str) -> Iterator[None]:
    """Complete errors inside the block that name no device.

    They get `device`, and `command` unless they have another one.
    """
    try:
        yield
    except AcquisitionError as error:
        if not error.device:
            error.device, error.command = device, error.command or command
        raise


class LinkError(AcquisitionError):
    """The conversation with the device broke; the link is closed and a reconnect is needed."""

    code = 1000
    exit_code = 4
    advice = "Check cable, power and network address of the device; the program then connects again."


class LinkTimeout(LinkError):
    """No complete answer before the named deadline."""

    code = 1001
    advice = "Check that the device is on, its program runs and the address is its own, then connect again."


class LinkLost(LinkError):
    """The device refused, closed or reset the connection."""

    code = 1002


class ProtocolError(LinkError):
    """The answer is not one that this question can have; its content is not used."""

    code = 1003
    advice = "Check that the right device and program version answer at this address, then connect again."


class Unmeasurable(AcquisitionError):
    """The instrument works, but this point cannot be measured now."""

    code = 2000
    advice = "Look at the target and the line of sight, then repeat the measurement or skip the pose."


class BeamBroken(Unmeasurable):
    """The beam was interrupted before or during the reading."""

    code = 2001
    advice = "Clear the line of sight, bring the beam back to the SMR and repeat the measurement."


class TargetNotSeen(Unmeasurable):
    """The target was lost, not found, or is not in the requested nest."""

    code = 2002
    advice = "Check that the SMR is seated and faces the instrument, then repeat the measurement."


class OutOfRange(Unmeasurable):
    """The reading is beyond the stroke of the instrument."""

    code = 2003
    advice = "The point lies outside the instrument's range: skip the pose or move the instrument."


class NoisyMeasurement(Unmeasurable):
    """A reading that is stale, inaccurate or scattered; it is not used."""

    code = 2004
    advice = "Wait until robot and air are calm, then repeat the measurement."


class Refused(AcquisitionError):
    """A working device refused, or the driver refused before it asked the device."""

    code = 3000
    advice = "Read the message, put the device in order and confirm to go on."


class NotArmed(Refused):
    """Motion was requested without arming first, or after the device was disarmed."""

    code = 3001
    advice = "Check that the cell is clear, then arm the device again."


class Busy(Refused):
    """Another client holds the device, or it is still busy with something else."""

    code = 3002
    exit_code = 4
    advice = "Close the other program that uses the device, then try again."


class JointLimit(Refused):
    """The target is outside the joint limits; nothing moved."""

    code = 3003
    exit_code = 5
    advice = "Remove this pose from the campaign, or correct the limits in the cell file."


class WrongMode(Refused):
    """The controller is in manual mode, or its motors are off."""

    code = 3004
    exit_code = 4
    advice = "Switch the controller to automatic mode and the motors on, then confirm."


class NotReady(Refused):
    """The instrument is not initialised, is warming up, or has no weather data."""

    code = 3005
    exit_code = 4
    advice = "Let the instrument finish its start-up and check its weather station, then confirm."


class ProgramNotReady(NotReady):
    """The program on the controller that moves the robot does not run, or cannot move it."""

    code = 3011
    advice = "Clear the alarm on the pendant, start the robot's programs again, then confirm."


class MotionStopped(Refused):
    """The move ended before its target because it was stopped."""

    code = 3006
    advice = "The robot stopped on its way. Check the cell, then arm it again. The pose is approached again."


class CannotStop(Refused):
    """The device cannot be stopped through the network."""

    code = 3007
    exit_code = 5
    advice = "Press the stop button of the controller: this robot cannot be stopped by the program."


class NotReached(Refused):
    """The controller reports the end of the move, but not at the target."""

    code = 3008
    advice = "Compare the position on the pendant with the requested one before you continue."


class CommandRefused(Refused):
    """The device answered with an error that has no better class here."""

    code = 3009


class LeftOut(Refused):
    """A person skipped a requested reading, or repeats the previous reading."""

    code = 3010
    advice = "The reading is left out; it can be measured again later."

    def __init__(self, message: str, *, again: bool = False, **where: Unpack[ErrorPlace]) -> None:
        """Create the error.

        With `again`, the reading is not left out; the previous one is measured again first.
        """
        super().__init__(message, **where)
        self.again = again


class SafetyStop(AcquisitionError):
    """A safety function acted. Nothing resumes by itself."""

    code = 4000
    exit_code = 5
    advice = "Find out why the safety function acted, reset it at the controller, then resume the campaign."


class EmergencyStop(SafetyStop):
    """The emergency stop is pressed."""

    code = 4001


class ProtectiveStop(SafetyStop):
    """A collision or supervision stop of the controller."""

    code = 4002


class EnableLost(SafetyStop):
    """The enabling device was released, or a safeguard opened."""

    code = 4003


class ConfigError(AcquisitionError):
    """A file, address or option is wrong; nothing was started."""

    code = 6000
    exit_code = 2
    advice = "Correct the cell or campaign file and start again."


class NoOperator(AcquisitionError):
    """A prompt needs a person, and no one can be reached."""

    code = 7000
    exit_code = 4
    advice = "Start the program in a terminal or use the operator's page, so that a person can answer."

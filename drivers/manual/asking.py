"""Questions of the manual drivers to a person; an implausible entry is requested again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from drivers.errors import NoOperator
from drivers.interfaces import Asking, TypedEntry
from drivers.manual.slips import TypingSlip
from drivers.manual.typed import InvalidEntry, TypedRow, rows_of


class Questions:
    """The prompts of a device. Before `attend` is set, there is no one to ask."""

    def __init__(self, device: str) -> None:
        self._device = device
        self.attend: Asking | None = None

    def numbers(
        self,
        text: str,
        entry: TypedEntry,
        picture: str,
        judge: Callable[[Sequence[TypedRow]], InvalidEntry | None],
    ) -> tuple[list[TypedRow], bytes]:
        """Ask until the numbers can be accepted, and return the rows and the typed text.

        There are no rows if CONFIRM alone was enough. `judge` returns the fault of the rows, or None. If it has only a
        doubt (`TypingDoubt`), the same rows are accepted when they are confirmed or typed again. Errors of the question
        are passed on.

        Raises
        ------
        NoOperator
            There is no person to ask.
        """
        if self.attend is None:
            raise NoOperator("nobody is there to be asked", device=self._device, command=picture)
        words, shown, doubted = text, picture, None
        while True:
            typed = self.attend(words, entry, shown)
            try:
                if not typed.strip() and doubted is not None:
                    return doubted
                if not typed.strip() and not entry.needed:
                    return [], b""
                rows = rows_of(typed, entry.names, entry.unit)
                said = rows, typed.encode()
                wrong = judge(rows)
                if wrong is None or (
                    isinstance(wrong, TypingDoubt) and doubted is not None and doubted[0] == rows
                ):
                    return said
                doubted = said if isinstance(wrong, TypingDoubt) else None
            except InvalidEntry as error:
                wrong, doubted = error, None
            again = ""
            if doubted is not None:
                entry, again = replace(entry, needed=False), " Type it again, or confirm alone if it is so."
            end = "" if wrong.words.endswith("?") else "."
            words = f"{wrong.words[:1].upper()}{wrong.words[1:]}{end}{again} {text}"
            shown = "/".join(part for part in (picture, "again", wrong.reason, wrong.name) if part)


class TypingDoubt(InvalidEntry):
    """A doubt about numbers that look wrong but may be right."""


def in_words(slip: TypingSlip, names: Sequence[str], unit: str) -> str:
    """Return the slip as a question."""
    name = "" if slip.index is None else names[slip.index]
    meant = "" if slip.index is None else f" ({slip.meant[slip.index]:g} {unit})"
    return {
        "order": f"are two numbers exchanged, {name} and another?",
        "unit": f"are the numbers really in {unit}?",
        "sign": f"is the sign of {name} right{meant}?",
        "swap": f"are two digits of {name} exchanged{meant}?",
        "point": f"is the decimal point of {name} in its place{meant}?",
        "digit": f"is a digit of {name} wrong, missing or doubled{meant}?",
    }[slip.reason]

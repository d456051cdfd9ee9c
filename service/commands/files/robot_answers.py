"""The questions of `truepose robot new`, one per line, repeated until the answer is valid."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import typer

from calib.arm import HEAVIEST_KG
from calib.errors import DataError
from calib.robot_file import CONVENTIONS, Convention, Draft, DraftLink, weighed

T = TypeVar("T")
_SLIDES = "slides"
_ROW = "alpha deg, a mm, theta deg, d mm, lowest, highest"


@dataclass(frozen=True)
class RobotFileAnswers:
    """The answers from options.

    Each None, and missing links, lead to a question.
    """

    name: str | None
    maker: str | None
    convention: Convention | None
    joints: int | None
    links: list[str]
    source: str | None
    mass_kg: float | None

    @property
    def complete(self) -> bool:
        """Whether options gave everything that a file needs, so that no question is asked."""
        return None not in (self.name, self.maker, self.convention, self.source) and bool(self.links)


def ask_draft(asked: RobotFileAnswers) -> Draft:
    """Create the draft of a robot file from options and answers.

    Raises
    ------
    DataError
        An option cannot be used.
    """
    links = [link_of(text) for text in asked.links]
    if asked.joints is not None and len(links) > asked.joints:
        raise DataError(
            f"is given {len(links)} times for {asked.joints} joints.", do="Give one per joint.", key="--link"
        )
    name = asked.name or _ask("Name of the robot (my-arm)", _text)
    maker = asked.maker or _ask("Its maker", _text)
    convention = asked.convention or _ask_convention()
    joints = asked.joints or len(links) or _ask("How many joints", _count)
    if len(links) < joints:
        typer.echo(f"One row a joint: {_ROW}. '{_SLIDES}' before them where it slides (mm).", err=True)
    while len(links) < joints:
        links.append(_ask(f"Joint {len(links) + 1}", link_of))
    source = asked.source or _ask("Where the numbers come from (drawing, data sheet)", _text)
    remarks = ("Written by 'truepose robot new'. docs/robot-file.md explains every key.",)
    draft = Draft(name, maker, convention, source, tuple(links), remarks=remarks)
    mass_kg = ask_mass() if asked.mass_kg is None and not asked.complete else asked.mass_kg
    return weighed(draft, mass_kg) if mass_kg else draft


def ask_mass() -> float:
    """Ask for the mass of the whole arm, kg; 0 if the user does not know it or has no answers."""
    try:
        return _ask("Mass of the whole arm, kg, as in its data sheet (0: unknown)", _mass)
    except DataError:
        return 0.0


def link_of(text: str) -> DraftLink:
    """Parse the link of one row.

    Raises
    ------
    DataError
        The text is no row; the message explains the format of a row.
    """
    words = text.replace(",", " ").replace(";", " ").split()
    slides = bool(words) and words[0].lower() == _SLIDES
    try:
        alpha, a, theta, d, low, high = (float(word) for word in words[slides:])
    except ValueError as error:
        raise DataError(
            f"'{text}' is not a row of six numbers.",
            do=f"Give {_ROW}, with blanks between and decimal points: -90 0 0 290 -165 165.",
            key="--link",
        ) from error
    if low >= high:
        what = "swapped" if low > high else "the same"
        raise DataError(
            f"'{text}' has its limits {what}: {low:g} to {high:g}.",
            do="Give the lower one first.",
            key="--link",
        )
    return DraftLink(alpha, a, theta, d, low, high, slides)


def _ask_convention() -> Convention:
    for name, what in CONVENTIONS.items():
        typer.echo(f"  {name}: {what}", err=True)

    def known(text: str) -> Convention:
        if text == "dh" or text == "mdh":
            return text
        raise DataError(f"'{text}' is not a convention.", do="Answer dh or mdh.")

    return _ask("Convention of the table (dh, mdh)", known)


def _ask(question: str, answer: Callable[[str], T]) -> T:
    while True:
        try:
            return answer(typer.prompt(question, err=True).strip())
        except typer.Abort as ended:
            if sys.stdin.isatty():
                raise
            raise DataError(
                f"There is no answer to '{question}': the input has ended.",
                do="Give --name, --maker, --convention, --source and one --link per joint, or run it at a terminal.",
            ) from ended
        except DataError as error:
            typer.echo(f"  {error}", err=True)


def _text(text: str) -> str:
    if not text:
        raise DataError("is empty.", do="Give text.")
    return text


def _mass(text: str) -> float:
    try:
        mass_kg = float(text)
    except ValueError:
        mass_kg = -1.0
    if not 0.0 <= mass_kg <= HEAVIEST_KG:
        raise DataError(f"'{text}' is not a mass in kg.", do="Give kg, or 0.")
    return mass_kg


def _count(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text[:4]) <= 20:
        raise DataError(f"'{text}' is not a number of joints.", do="Give 1 to 20.")
    return int(text)

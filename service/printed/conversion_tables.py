"""Tables of foreign files: meaning of each column, open questions, fit of the robot."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from rich.console import RenderableType
from rich.text import Text

from calib.foreign import Converted, MapProposal
from service.printed.tables import grid


def proposal(of: MapProposal) -> Iterable[RenderableType]:
    """Show columns, remarks and questions of a proposal."""
    for part in of.parts:
        sheet = part.layout.sheet
        title = f"Columns of {sheet.path.name}" + (f", sheet {sheet.name}" if sheet.name else "")
        shown = grid(title, "column", "read as", "unit", "why", left=4)
        for found in part.findings:
            style = "" if found.read_as else "dim"
            shown.add_row(
                Text(found.column), found.read_as or "left aside", found.unit, Text(found.why), style=style
            )
        yield shown
    for said in of.said:
        yield Text(f"- {said}")
    for missing in of.missing:
        yield Text(f"Missing: {missing}", "bold")
    for question in of.questions:
        choices = f" [{' | '.join(question.choices)}]" if question.choices else ""
        likely = f" likely {question.proposed}" if question.proposed else ""
        yield Text(f"To decide: {question.key}{choices}{likely}", "bold")
        yield Text(f"  {question.text}")


def converted(of: Converted, told: Collection[str] = ()) -> Iterable[RenderableType]:
    """Show the remarks on a data set created from the files, and the fit of the nominal robot.

    Remarks in `told`, which a proposal has already shown, are not repeated.
    """
    for said in of.said:
        if said not in told:
            yield Text(f"- {said}")
    if of.fit is None:
        yield Text("Too few readings to hold them against the nominal robot.")
    else:
        yield Text(f"Plausible: {of.fit.sentence}.", "bold")
        if of.fit.suspicious:
            yield Text(
                "That is more than robots err by: see whether robot, joints and units are right.", "yellow"
            )


def remarks(of: MapProposal) -> list[str]:
    """List the first lines of a map file: columns left aside, and decisions to take at '?'."""
    out = ['Map of foreign files (docs/howto/own-data.md): quantity = "column[unit]".']
    for part in of.parts:
        for found in part.findings:
            if not found.read_as:
                out.append(
                    f"{part.layout.sheet.path.name}: column '{found.column}' is left aside: {found.why}"
                )
    for question in of.questions:
        choices = f" ({' | '.join(question.choices)})" if question.choices else ""
        out.append(f"TO DECIDE {question.key}: {question.text}{choices}")
    return [" ".join(line.split()) for line in out]

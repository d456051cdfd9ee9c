"""Custom files for `truepose convert`, read by a proposed or a kept map.

Open questions of a proposal are asked if both ends are a terminal. Otherwise they are printed and the command
ends with exit code 2.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import typer

from calib.arm import built_in_robots, load_robot
from calib.errors import DataError
from calib.foreign import (
    ColumnQuestion,
    Map,
    MapProposal,
    answers_of,
    converted,
    data_set_of,
    propose,
    read_map,
    text_of,
)
from calib.text import replace_file
from service import exit_codes
from service.commands import options
from service.files import STANDARD_OUTPUT, write_json
from service.printed import conversion_tables
from service.printed.terminal import Terminal
from service.results.files.conversion import ConversionResult, ProposalResult
from service.results.shape import document_of


@dataclass(frozen=True)
class OwnFiles:
    """Files, with the statements of the command line about them."""

    files: Sequence[Path]
    out: Path | None
    map_file: Path | None
    propose_to: Path | None
    robot: str | None
    answers: Sequence[str]
    sigma: float | None
    instrument: str | None
    lines: tuple[int, int] | None

    def convert(self, holdout: Mapping[str, Any], json: str | None) -> None:
        """Propose a map, or convert by one.

        `holdout` has kind, share and seed if they are given. They are kept in a proposed map.

        Raises
        ------
        DataError
            A file, an answer or an option cannot be used.
        typer.Exit
            With USAGE, if questions are open.
        """
        self._check(json)
        with Terminal(quiet=json == STANDARD_OUTPUT) as terminal:
            for file in self.files:
                terminal.say(f"reading {file}")
            if self.map_file is not None:
                made = _held(read_map(self.map_file), holdout)
                self._write(made, self.map_file, self.map_file.parent, (), terminal, json)
                return
            proposal = self._proposal(terminal, asking=json != STANDARD_OUTPUT)
            kept = self.propose_to or (None if self.out is None else self.out.with_suffix(".map.toml"))
            made = _held(proposal.made, holdout)
            if self.propose_to is not None:
                _keep(made, proposal, self.propose_to, terminal)
            if not proposal.complete or self.out is None:
                write_json(document_of(ProposalResult.of(proposal, self.propose_to)), json)
                self._end(proposal, terminal)
                return
            assert kept is not None
            self._write(made, kept, Path(), proposal.said, terminal, json)
            if self.propose_to is None:  # kept once it has been of use
                _keep(made, proposal, kept, terminal)

    def _check(self, json: str | None) -> None:
        if len(self.files) > 2:
            raise DataError(
                f"{len(self.files)} files are given.",
                do="Give one, or one with joints and one with points; the data set is named by --out OUT.csv.",
            )
        if self.map_file is not None:
            if self.propose_to or self.answers or self.lines or self.robot or self.sigma or self.instrument:
                raise DataError(
                    "contains all answers and cannot be combined with "
                    "--propose, --robot, --answer, --sigma, --instrument or --lines.",
                    do="Change the map, or leave it out.",
                    file="--map",
                )
            if self.out is None:
                raise DataError("is missing.", do="Name the data set.", file="--out")
        inputs = (*self.files, self.map_file, None if self.robot is None else Path(self.robot))
        if self.out is not None:
            options.check_data_set(self.out, json, inputs)
            if self.map_file is None and self.propose_to is None:
                options.check_outputs({"map of OUT.csv": self.out.with_suffix(".map.toml")}, inputs=inputs)
        if self.propose_to is not None:
            options.check_outputs({"--propose": self.propose_to, "--json": json}, inputs=inputs)

    def _given(self) -> dict[str, str]:
        """Return the answers of the command line."""
        given = {"robot": self.robot or "", "instrument": self.instrument or ""}
        given["sigma_mm"] = "" if self.sigma is None else repr(self.sigma)
        given |= answers_of(self.answers, "--answer")
        return {key: value for key, value in given.items() if value}

    def _proposal(self, terminal: Terminal, *, asking: bool) -> MapProposal:
        """Return the proposal, completed by the answers of a person at the terminal."""
        answers = self._given()
        asking = asking and sys.stdin is not None and sys.stdin.isatty() and sys.stdout.isatty()
        proposal = propose(self.files, answers, self.lines)
        proposal.refuse_unknown(answers, "--answer")
        while asking and proposal.questions and not proposal.missing:
            terminal.rest()
            # the robot first, then what it cannot decide: it may answer the others
            question = min(proposal.questions, key=lambda each: (each.key != "robot", each.evidence))
            answers[question.key] = _asked(question)
            terminal.begin("reading")
            proposal = propose(self.files, answers, self.lines)
        terminal.rest()
        for shown in conversion_tables.proposal(proposal):
            terminal.out.print(shown)
        return proposal

    def _end(self, proposal: MapProposal, terminal: Terminal) -> None:
        if proposal.missing:
            raise DataError(
                f"no file holds {' and '.join(proposal.missing)}.",
                do="Give the file that does as a second one, or name its columns in a map (--propose writes one).",
                file=self.files[0],
            )
        if proposal.questions:
            first = proposal.questions[0]
            choice = first.proposed or (first.choices[0] if first.choices else "...")
            terminal.note(f"truepose: undecided. Answer with --answer, e.g. --answer '{first.key}={choice}'"
                          + (", or in the map." if self.propose_to else "."))  # fmt: skip
            raise typer.Exit(exit_codes.USAGE)
        if self.out is None:
            terminal.note("nothing was converted: name the data set with --out OUT.csv" if self.propose_to is None else
                          f"convert with: truepose convert FILE --map {self.propose_to} --out OUT.csv")  # fmt: skip

    def _write(
        self,
        made: Map,
        kept: Path,
        home: Path,
        told: Sequence[str],
        terminal: Terminal,
        json: str | None,
    ) -> None:
        """Convert the files, compare the result with its robot, and only then write it.

        The map names a robot relative to `home`. `told` lists the lines that were printed about the files already.
        """
        assert self.out is not None
        made = _from(made, home, self.out.parent)
        found = converted(made, self.files, kept, self.out.parent)
        terminal.say("holding it against the nominal robot")
        data_set_of(found.table, found.fit, self.out, self.files)
        terminal.say(f"writing {self.out}")
        found.table.write(self.out)
        result = ConversionResult.of_mapped(self.out, found, kept)
        write_json(document_of(result), json)
        terminal.rest()
        for shown in conversion_tables.converted(found, told):
            terminal.out.print(shown)
        terminal.out.print(result.summary)


def _held(made: Map, holdout: Mapping[str, Any]) -> Map:
    """Return the map with the hold-out of the command line."""
    if not holdout:
        return made
    return replace(made, header={**made.header, "holdout": {**made.header.get("holdout", {}), **holdout}})


def _keep(made: Map, proposal: MapProposal, to: Path, terminal: Terminal) -> None:
    """Write the map of a proposal."""
    replace_file(to, text_of(_from(made, Path(), to.parent), conversion_tables.remarks(proposal)))
    terminal.note(f"map: {to}")


def _asked(question: ColumnQuestion) -> str:
    """Ask a person; an empty answer means the proposed one, if there is one."""
    typer.echo(f"\n{question.text}")
    for number, choice in enumerate(question.choices, start=1):
        typer.echo(f"  {number}  {choice}" + ("   (likely)" if choice == question.proposed else ""))
    while True:
        given = typer.prompt(question.key, default=question.proposed or None, type=str).strip()
        if question.key == "robot":
            try:
                load_robot(given, Path())
            except DataError as error:
                typer.echo(str(error))
                continue
        if not question.choices and given:
            return given
        if given in question.choices:
            return given
        if given.isdigit() and 1 <= int(given) <= len(question.choices):
            return question.choices[int(given) - 1]
        typer.echo(f"Answer with one of {', '.join(question.choices)}, or its number.")


def _from(made: Map, home: Path, to: Path) -> Map:
    """Return the map with its robot's file, named from `home`, named from the folder `to`."""
    robot = str(made.header.get("robot", ""))
    if robot in built_in_robots() or robot == "?" or not (home / robot).is_file():
        return made
    try:
        named = Path(os.path.relpath(home / robot, to)).as_posix()
    except ValueError:  # on another drive
        named = str((home / robot).resolve())
    return replace(made, header={**made.header, "robot": named})

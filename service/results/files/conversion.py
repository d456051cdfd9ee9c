"""Results of a conversion of foreign files, and of a proposed map for them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field

from service import wording
from service.results.shape import ResponseBody, told

if TYPE_CHECKING:
    from calib.convert import ConvertedTable
    from calib.foreign import Converted, MapProposal


class MappedFit(ResponseBody):
    """The deviation of readings from the nominal robot in its best place, its tool fitted."""

    robot: Annotated[str, told("The robot.", "abb-irb120")]
    miss_mm: Annotated[float, told("Within which three quarters of the readings lie, mm.", 0.8, of="miss")]
    extent_mm: Annotated[float, told("Extent of the points, mm.", 900.0, of="extent")]


class ConversionResult(ResponseBody):
    """A data set created from foreign files (`truepose-conversion/1`)."""

    format: Annotated[Literal["truepose-conversion/1"], told("The format.", "truepose-conversion/1")]
    data: Annotated[str, told("File of the data set.", "out.csv")]
    header: Annotated[str, told("File of its header.", "out.toml")]
    readings: Annotated[int, told("Number of readings.", 120)]
    validation: Annotated[int, told("Number of those that only judge.", 24)]
    holdout: Annotated[str, told("How they were held out.", "random")]
    note: Annotated[str, told("A sentence on the hold-out.", "5 readings are held out for validation")]
    map: Annotated[str, told("File of the map; left out for a file that an importer knows.", "map.toml")] = ""
    fit: Annotated[MappedFit | None, told("Null: this cannot be said of these readings.", None)] = None
    said: Annotated[
        list[str], told("What was left aside or made of the files.", ["left aside: 'Remark'"])
    ] = Field(default_factory=list)

    @classmethod
    def of(cls, out: Path, table: ConvertedTable, **more: Any) -> Self:
        """Describe a data set that was written; `more` are the members of a conversion by a map."""
        return cls(
            format="truepose-conversion/1",
            data=str(out),
            header=str(out.with_suffix(".toml")),
            readings=len(table),
            validation=table.columns.get("set", []).count("validation"),
            holdout=table.holdout,
            note=table.note,
            **more,
        )

    @classmethod
    def of_mapped(cls, out: Path, found: Converted, kept: Path) -> Self:
        """Describe a data set written by the map in the file `kept`, with the nominal robot's fit."""
        return cls.of(out, found.table, map=str(kept), fit=found.fit, said=remarks_of(found))

    @property
    def summary(self) -> str:
        """One or two sentences on the readings, and on those that are held out to judge a model by."""
        said = f"{self.data}: {wording.counted(self.readings, 'reading')}; {self.note}."
        return f"{said} --holdout block, random or none holds out others." if self.validation else said


def remarks_of(found: Converted) -> list[str]:
    """List the remarks on files that were read by a map, the one on the hold-out last."""
    return [*found.said, found.table.note]


class ProposedColumn(ResponseBody):
    """The interpretation of a column."""

    file: Annotated[str, told("Name of the file.", "messung.csv")]
    column: Annotated[str, told("Name of the column.", "X_meas")]
    read_as: Annotated[str, told("Its meaning; empty: it is left aside.", "x")]
    unit: Annotated[str, told("Its unit.", "mm")]
    why: Annotated[str, told("Why it is read so.", "the head says mm")]


class ProposalQuestion(ResponseBody):
    """A question that the files leave open."""

    key: Annotated[str, told("Its name in --answer KEY=CHOICE.", "match")]
    text: Annotated[str, told("The question.", "How do joints and points belong together?")]
    choices: Annotated[list[str], told("The answers; empty: any text.", ["name", "order", "time"])]
    proposed: Annotated[str, told("The likeliest answer; empty: none.", "order")]


class ProposalResult(ResponseBody):
    """A proposed map of foreign files (`truepose-proposal/1`)."""

    format: Annotated[Literal["truepose-proposal/1"], told("The format.", "truepose-proposal/1")]
    map: Annotated[str | None, told("File of the map; null if none was written.", "map.toml")]
    complete: Annotated[bool, told("Whether nothing is missing or open.", False)]
    columns: Annotated[list[ProposedColumn], told("Every column.", [])]
    questions: Annotated[list[ProposalQuestion], told("What is open.", [])]
    missing: Annotated[list[str], told("What no file holds.", [])]
    said: Annotated[list[str], told("Remarks on how the files were read.", [])]

    @classmethod
    def of(cls, proposal: MapProposal, kept: Path | None) -> Self:
        """Describe a proposal; `kept` is the file to which its map was written, None without one."""
        return cls(
            format="truepose-proposal/1",
            map=None if kept is None else str(kept),
            complete=proposal.complete,
            columns=[
                ProposedColumn(
                    file=part.layout.sheet.path.name,
                    column=found.column,
                    read_as=found.read_as,
                    unit=found.unit,
                    why=found.why,
                )
                for part in proposal.parts
                for found in part.findings
            ],
            questions=[ProposalQuestion.model_validate(question) for question in proposal.questions],
            missing=list(proposal.missing),
            said=list(proposal.said),
        )

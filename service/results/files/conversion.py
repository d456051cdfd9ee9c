"""Results of a conversion of foreign files, for people and for programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calib.convert import ConvertedTable
from calib.foreign import Converted, MapProposal
from service import wording


def summary(out: Path, table: ConvertedTable) -> str:
    """Summarise a data set that was written, in one or two sentences.

    They state its readings, and which of them are held out to judge a model by.
    """
    said = f"{out}: {wording.counted(len(table), 'reading')}; {table.note}."
    return f"{said} --holdout block, random or none holds out others." if _held(table) else said


def document(out: Path, table: ConvertedTable) -> dict[str, Any]:
    """Build the document of a conversion, `truepose-conversion/1`."""
    return {
        "format": "truepose-conversion/1",
        "data": str(out),
        "header": str(out.with_suffix(".toml")),
        "readings": len(table),
        "validation": _held(table),
        "holdout": table.holdout,
        "note": table.note,
    }


def mapped_document(out: Path, found: Converted, kept: Path) -> dict[str, Any]:
    """Build the document of a conversion by a map, with the fit of the nominal robot."""
    return document(out, found.table) | {"map": str(kept)} | told_of(found)


def told_of(found: Converted) -> dict[str, Any]:
    """Report the fit of the nominal robot to files read by a map, and the remarks on the files."""
    fit = found.fit
    return {
        "fit": None if fit is None else {"robot": fit.robot, "miss_mm": fit.miss, "extent_mm": fit.extent},
        "said": [*found.said, found.table.note],
    }


def proposal_document(proposal: MapProposal, kept: Path | None) -> dict[str, Any]:
    """Create the document of a proposal, `truepose-proposal/1`.

    It lists the interpretation of each column and the open questions.
    """
    return {
        "format": "truepose-proposal/1",
        "map": None if kept is None else str(kept),
        "complete": proposal.complete,
        "columns": [
            {
                "file": part.layout.sheet.path.name,
                "column": f.column,
                "read_as": f.read_as,
                "unit": f.unit,
                "why": f.why,
            }
            for part in proposal.parts
            for f in part.findings
        ],
        "questions": [
            {"key": q.key, "text": q.text, "choices": list(q.choices), "proposed": q.proposed}
            for q in proposal.questions
        ],
        "missing": list(proposal.missing),
        "said": list(proposal.said),
    }


def _held(table: ConvertedTable) -> int:
    return table.columns.get("set", []).count("validation")

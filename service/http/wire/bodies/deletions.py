"""The bodies of deletions: a record of the deleted item, the person and the reason stays."""

from __future__ import annotations

from typing import Annotated, Literal

from service.http.wire.bodies.fields import Id, ResponseBody, told

Kind = Literal[
    "run", "dataset", "campaign", "identification", "diagnosis", "alignment", "regression", "validation", "selection",
    "placement", "watch_plan", "watch", "upkeep", "sweeps",
]  # fmt: skip


class DeletionShown(ResponseBody):
    """One deletion, as `deleted.jsonl` of the record keeps it."""

    utc: Annotated[str, told("When, RFC 3339 UTC.", "2026-11-21T17:04:59.120Z")]
    kind: Annotated[Kind, told("What it was.", "dataset")]
    id: Id
    name: Annotated[str, told("Its name, where it had one.", "night 1")]
    by: Annotated[str, told("Who: the holder of the lease where its secret came, else http.", "anna")]
    reason: Annotated[str, told("Why it was deleted.", "a trial with the wrong tool")]
    created_utc: Annotated[
        str, told("When it was made, where that is known, RFC 3339 UTC.", "2026-11-20T09:00:00Z")
    ] = ""
    sha256: Annotated[
        str, told("Hash of the readings or of the record's file, where there was one.", "a93c6fe1")
    ] = ""
    kept: Annotated[
        str, told("What stays of a run: its events, below the record.", "deleted/X.events.jsonl")
    ] = ""


class DeletionList(ResponseBody):
    """Every deletion."""

    deletions: Annotated[list[DeletionShown], told("Oldest first.", [])]

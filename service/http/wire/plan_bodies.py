"""The answers about errors in space and about results, as OpenAPI describes them.

Lengths are in mm, in the world frame.
"""

from __future__ import annotations

from typing import Annotated

from service.results.cell.scene import Place
from service.results.shape import ResponseBody, told


class ArrowShown(ResponseBody):
    """A reading with its error, measured less predicted."""

    reading: Annotated[str, told("Id of the reading in its data set.", "17")]
    at_mm: Place
    nominal_mm: Annotated[
        list[float], told("Its error by the nominal robot in its place, mm.", [0.4, -0.9, 0.3])
    ]
    model_mm: Annotated[list[float], told("Its error by the model found, mm.", [0.01, -0.02, 0.01])]


class ArrowsShown(ResponseBody):
    """Errors in space."""

    format: Annotated[str, told("Name of this format.", "truepose-arrows/1")]
    held_out: Annotated[bool, told("Whether nothing was fitted to these readings.", True)]
    readings: Annotated[int, told("The number of readings of which these are a draw.", 120)]
    arrows: Annotated[list[ArrowShown], told("At most 500 of them.", [])]


class ResultShown(ResponseBody):
    """Members of all results. Those of jobs have the members of a job besides, those of loops the members of a loop."""

    id: Annotated[str, told("The id of the job or loop.", "20261122-143851-6ab9e645236")]
    kind: Annotated[str, told("identification, diagnosis, regression, alignment or loop.", "diagnosis")]
    state: Annotated[str, told("The state, as of a run.", "succeeded")]
    version: Annotated[int, told("A number that grows with everything that happens.", 3)]
    created_utc: Annotated[str, told("When it was asked for, RFC 3339.", "2026-11-22T14:43:01.512Z")]
    report: Annotated[str | None, told("Path of the report; null before there is one.", None)]

"""The body of everything that goes wrong."""

from __future__ import annotations

from typing import Annotated

from service.http.wire.bodies.told import Answered, told


class ProblemShown(Answered):
    """RFC 9457, with a sentence on what happened and one on what to do.

    Some have more: `key` or `line` of what was sent, `run_id` of the run that uses the robot, `open_prompt_id`,
    `holder` of the lease, `retry_after_s`.
    """

    type: Annotated[str, told("A name of the kind of problem.", "urn:truepose:problem:8102")]
    title: Annotated[str, told("The words of the HTTP status.", "Conflict")]
    status: Annotated[int, told("The HTTP status; no unit.", 409)]
    detail: Annotated[str, told("What happened.", "The motion lease is held by anna.")]
    code: Annotated[int, told("Number for programs, below 8000 of a device or the record; no unit.", 8102)]
    operator_text: Annotated[str, told("What happened, for people.", "The motion lease is held by anna.")]
    what_to_do: Annotated[str, told("One sentence for the person at the cell.", "Ask anna to give it back.")]

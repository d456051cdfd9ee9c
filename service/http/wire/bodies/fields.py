"""Parts that all bodies share: descriptions of fields, strictness, and body of a problem."""

from __future__ import annotations

import unicodedata
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError

from acquisition.file_table import first_of_a_list
from calib.text import turns_writing
from service.results.shape import ResponseBody, told

_MOST_ERRORS = 100


def told_limit(words: str, example: float, more: str = "") -> Any:
    """Describe a length, mm, that is required or allowed; 0 stands for none.

    `more` adds another sentence to the description.
    """
    return told(f"{words}, mm; 0: none.{more}", example, ge=0.0, le=1e4, allow_inf_nan=False)


class RequestBody(BaseModel):
    """A request; strict, and without members that no one reads.

    A list is refused for its first wrong value, and a request for its first hundred. Describing each of a hundred
    thousand would take the event loop seconds, and a stop would wait as long.
    """

    model_config = ConfigDict(strict=True, extra="forbid")

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return first_of_a_list(handler(source))

    @model_validator(mode="wrap")
    @classmethod
    def _few_errors(cls, value: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        try:
            return handler(value)
        except ValidationError as error:
            if error.error_count() <= _MOST_ERRORS:
                raise
            raise PydanticCustomError(
                "too_many_errors", "has {count} errors, too many to list", {"count": error.error_count()}
            ) from None


Name = Annotated[
    str, told("A name for people, at most 200 letters; it need not be unique.", "night 1", max_length=200)
]


def _as_read(text: str) -> str:
    if turns_writing(text):
        raise ValueError("it holds marks that turn the direction of writing; leave them out")
    if any(unicodedata.category(letter) == "Cc" for letter in text):
        raise ValueError("it holds control characters, such as line breaks; leave them out")
    return text


AsRead = AfterValidator(_as_read)
"""The rule for names and reasons that people read: no control characters, and no mark that turns the direction of
writing."""

Id = Annotated[str, told("The id of the resource, as its path has it.", "20261121-170459-3f9a1c07b2e")]
Created = Annotated[str, told("When it was made, RFC 3339 UTC.", "2026-11-21T17:04:59.120Z")]
Simulated = Annotated[bool, told("Whether simulators were measured and no real devices.", False)]

Version = Annotated[
    int, told("Grows with every change; send it as `after` to wait for the next. No unit.", 412)
]

Prior = Annotated[
    dict[str, Any],
    told("The content of a file of `truepose fleet learn`: what robots of the type share; empty: none.", {}),
]


class ProblemShown(ResponseBody):
    """RFC 9457, with a sentence on the event and one on the remedy.

    Some have more: `key` or `line` of the request, `run_id` of the run that uses the robot, `open_prompt_id`,
    `holder` of the lease, `retry_after_s`.
    """

    type: Annotated[str, told("A name of the kind of problem.", "urn:truepose:problem:8102")]
    title: Annotated[str, told("The words of the HTTP status.", "Conflict")]
    status: Annotated[int, told("The HTTP status; no unit.", 409)]
    detail: Annotated[str, told("What happened.", "The motion lease is held by anna.")]
    code: Annotated[int, told("Number for programs, below 8000 of a device or the record; no unit.", 8102)]
    operator_text: Annotated[str, told("What happened, for people.", "The motion lease is held by anna.")]
    what_to_do: Annotated[str, told("One sentence for the person at the cell.", "Ask anna to give it back.")]

"""Description of results by classes: each member has a description, a unit and an example.

Some members are also columns of a table. The JSON document, its validation when a file is read back, the OpenAPI schema
and the rows of printed tables are derived from the class.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, GetJsonSchemaHandler, TypeAdapter
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from service import wording


def told(words: str, example: Any, *, of: str | None = None, **limits: Any) -> Any:
    """Describe a field: meaning with unit, example, and limits of its values.

    `of` is the attribute from which it is read, if that does not have the name of the field.
    """
    return Field(description=words, examples=[example], validation_alias=of, **limits)


class DescribedAs:
    """Annotation of a plain dictionary that is validated elsewhere.

    The OpenAPI schema shows the schema of `table` instead.
    """

    def __init__(self, table: type) -> None:
        self._schema = TypeAdapter(table).core_schema

    def __get_pydantic_json_schema__(self, _: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return handler(self._schema)


class ResponseBody(BaseModel):
    """Base class of responses and their parts. Later versions may add members.

    An instance is created from its members, from JSON, or from an object with attributes of the same names. Validators
    are built on first use, because building all of them took a seventh of the service's start-up time.
    """

    model_config = ConfigDict(
        extra="allow", defer_build=True, from_attributes=True, validate_by_name=True, validate_by_alias=True
    )


def document_of(result: ResponseBody) -> dict[str, Any]:
    """A result as JSON has it, without members that nobody set; its format comes first, where readers look for it."""
    document = result.model_dump(exclude_unset=True)
    return {"format": document["format"], **document} if "format" in document else document


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


Real = Annotated[float | None, BeforeValidator(_finite)]
"""A number; null for NaN and infinity, which JSON does not know."""


def length_cell(value: float) -> str:
    """Format a length, mm, for a cell of a table; empty for NaN and infinity."""
    return wording.millimetres(value) if math.isfinite(value) else ""


@dataclass(frozen=True)
class TableColumn:
    """Column of a field in a table: its head, and the function that formats a cell."""

    head: str
    show: Callable[[Any], str] = length_cell


def columns_of(kind: type[ResponseBody]) -> dict[str, TableColumn]:
    """Return the fields of a class that a table shows."""
    return {
        name: column
        for name, field in kind.model_fields.items()
        for column in field.metadata
        if isinstance(column, TableColumn)
    }


def cells_of(result: ResponseBody) -> Iterator[str]:
    """Yield a result as cells of a row."""
    for name, column in columns_of(type(result)).items():
        value = getattr(result, name)
        yield "" if value is None else column.show(value)

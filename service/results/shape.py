"""How one class describes a result: every member has words, a unit and an example, some a column of a table.

From it come the JSON document, its check when a file is read back, the OpenAPI schema and rows of printed tables.
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
    """The description of a field: what it is, with its unit, an example, and what bounds its values.

    of: the attribute that it is read from, unless that has the field's name.
    """
    return Field(description=words, examples=[example], validation_alias=of, **limits)


class DescribedAs:
    """The annotation of a plain dictionary that another reader checks: the schema shows this one's instead."""

    def __init__(self, table: type) -> None:
        self._schema = TypeAdapter(table).core_schema

    def __get_pydantic_json_schema__(self, _: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return handler(self._schema)


class ResponseBody(BaseModel):
    """A response or a part of one; members may be added in time.

    It is made from its members, from JSON, or from an object whose attributes have their names. What checks it is made
    when it is first needed: all of them together were a seventh of the start of the service.
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
    """A length, mm, in a cell of a table; empty for NaN and infinity."""
    return wording.millimetres(value) if math.isfinite(value) else ""


@dataclass(frozen=True)
class TableColumn:
    """The head of a field's column in a table, and how a cell shows a value."""

    head: str
    show: Callable[[Any], str] = length_cell


def columns_of(kind: type[ResponseBody]) -> dict[str, TableColumn]:
    """The fields of a class that a table shows."""
    return {
        name: column
        for name, field in kind.model_fields.items()
        for column in field.metadata
        if isinstance(column, TableColumn)
    }


def cells_of(result: ResponseBody) -> Iterator[str]:
    """A result as cells of a row."""
    for name, column in columns_of(type(result)).items():
        value = getattr(result, name)
        yield "" if value is None else column.show(value)

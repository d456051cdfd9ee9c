"""A user's file as one model: its keys, its errors and its JSON schema.

A class below `Table` is the only description of a table: its fields have type, limits, default, words and an example.
`read_table` reads a parsed table according to it; an error names file, key and remedy. The JSON schema of HTTP and of
editors comes from pydantic.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar, cast, get_args, get_origin

from annotated_types import Ge, Le, MinLen
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Strict,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, PydanticOmit

from calib.errors import DataError
from calib.text import FARTHEST_MM, Vector, turns_writing

_LEAVE_OUT = "Leave out the marks that turn the direction of writing."
_SHOWN = 200  # characters of a value in a message
_NO_TABLE = ("model_type", "dict_type", "model_attributes_type")
ADD = "Add it; the unit of a number is in the key's name."


def first_of_a_list(schema: Any) -> Any:
    """Return a schema of the validator in which every list and mapping stops at its first error.

    To describe a hundred thousand errors would hold the interpreter for a second, and the stop of a robot would wait.
    """
    if isinstance(schema, dict):
        parts = cast("dict[str, Any]", schema)
        first = {"fail_fast": True} if parts.get("type") in ("list", "tuple", "dict") else {}
        return {
            key: part if key == "metadata" else first_of_a_list(part) for key, part in parts.items()
        } | first
    if isinstance(schema, list):
        return [first_of_a_list(part) for part in cast("list[Any]", schema)]
    return schema


class Table(BaseModel):
    """A table of a file: immutable and strict.

    The first unknown key and the first error of a list are reported.
    """

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return first_of_a_list(handler(source))

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> type[Self]:
        """Return the class of these values, this one or one below it that has further keys."""
        return cls

    @classmethod
    def accepted(cls) -> Collection[str]:
        return cls.model_fields

    @model_validator(mode="wrap")
    @classmethod
    def _by_its_class(cls, values: Any, handler: Any, info: ValidationInfo) -> Any:
        table = cls.of(values) if isinstance(values, Mapping) else cls
        return handler(values) if table is cls else table.model_validate(values, context=info.context)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, values: Any) -> Any:
        """Refuse null and keep at most one unknown key.

        A file cannot contain null, and JSON should not: None stands for a key that was left out.
        """
        if not isinstance(values, Mapping):
            return values
        null = next((key for key, value in values.items() if value is None), None)
        if null is not None:
            raise refused(null, "is null.", "Leave it out.")
        unknown = [key for key in values if key not in cls.accepted()]
        if unknown and unknown[0] in cls.model_fields:
            raise refused(unknown[0], "is not known here.", _there_are(cls.accepted()))
        further = {*unknown[1:]}
        return {key: value for key, value in values.items() if key not in further} if further else values

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy with other values, without what this table computed from its own and kept."""
        copy = super().model_copy(update=update, deep=deep)
        for name in vars(copy).keys() - type(self).model_fields.keys():
            vars(copy).pop(name)
        return copy

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the schema of pydantic without the nulls, which are refused."""
        schema = handler(core)
        for member in handler.resolve_ref_schema(schema).get("properties", {}).values():
            kinds = [each for each in member.get("anyOf", ()) if each != {"type": "null"}]
            if len(kinds) < len(member.get("anyOf", ())):
                del member["anyOf"]
                member.pop("default", None)
                member.update(kinds[0] if len(kinds) == 1 else {"anyOf": kinds})
        return schema


@dataclass(frozen=True)
class Remedy:
    """The remedy for a field that is wrong or missing, if its type does not imply one."""

    wrong: str = ""
    missing: str = ""


def told(words: str, example: Any, *, do: str = "", missing: str = "", **limits: Any) -> Any:
    """Describe a field: words with the unit, an example (None for none), and its limits.

    `do` and `missing` are the texts of a `Remedy`.
    """
    field = Field(description=words, examples=None if example is None else [example], **limits)
    field.metadata.append(Remedy(do, missing))
    return field


def no_default(schema: dict[str, Any]) -> None:
    """Remove the default from a JSON schema.

    A missing key is inherited, and a client must not fill it in.
    """
    schema.pop("default", None)


def refused(key: str, what: str, do: str) -> PydanticCustomError:
    """Return the error that a validator raises.

    The `key` is relative to its table; `what` and `do` are those of a `DataError`.
    """
    return PydanticCustomError("refused", "{what} {do}", {"key": key, "what": what, "do": do})


def _there_are(known: Iterable[str]) -> str:
    return f"There are {', '.join(sorted(known))}."


def refuse_unknown(key: str, names: Iterable[str], known: Collection[str]) -> None:
    """Refuse the first of the names in a mapping that is not among those that are known."""
    for name in names:
        if name not in known:
            raise refused(f"{key}.{name}", "is not known here.", _there_are(known))


def as_read(text: str) -> str:
    if turns_writing(text):
        raise refused("", f"is {text!r}.", _LEAVE_OUT)
    return text


def _each_once(names: tuple[Any, ...]) -> tuple[Any, ...]:
    if len(set(names)) != len(names):
        raise ValueError("twice")
    return names


Item = TypeVar("Item")
Written = Annotated[str, AfterValidator(as_read)]
"""Text that may be empty."""
Text = Annotated[Written, MinLen(1)]
List = Annotated[tuple[Item, ...], Strict(False), MinLen(1)]
"""A list of a file, not empty."""
Once = Annotated[tuple[Item, ...], Strict(False), MinLen(1), AfterValidator(_each_once)]
"""A list of which each item is there once."""


def same_width(rows: tuple[tuple[Any, ...], ...]) -> tuple[tuple[Any, ...], ...]:
    if len({len(row) for row in rows}) > 1:
        raise ValueError("of several widths")
    return rows


def _on_earth(place: Vector) -> Vector:
    if max(map(abs, place)) > FARTHEST_MM:
        raise refused("", f"is {list(place)!r}: farther than anything on earth.", "Give it in mm.")
    return place


Place = Annotated[Vector, Strict(False), AfterValidator(_on_earth)]
"""A place in mm, or a direction."""
Pair = Annotated[tuple[float, float], Strict(False)]
Rows = Annotated[tuple[List[float], ...], Strict(False), MinLen(1), AfterValidator(same_width)]
Model = TypeVar("Model", bound=Table)


def read_table(
    model: type[Model], table: Mapping[str, Any], file: Path | str, folder: Path | None = None
) -> Model:
    """Read a parsed table.

    Parameters
    ----------
    folder
        Folder of the files that the table names; None if they are not read.

    Raises
    ------
    DataError
        The table does not fit the model.
    """
    try:
        return model.model_validate(table, context={"folder": folder})
    except ValidationError as error:
        faults = error.errors(include_url=False)
        # A mistyped key first: the intended key is then often missing too.
        fault = min(faults, key=lambda each: (each["loc"] != ("format",), each["type"] != "extra_forbidden"))
        raise _refusal(model, table, fault, file) from error


def _refusal(model: type[Table], values: Any, fault: Any, file: Path | str) -> DataError:
    kind, context = fault["type"], fault.get("ctx", {})
    keys, table, field = _place(model, values, fault["loc"])
    given = _at(values, keys)
    what, do = f"is {_shown(given)}.", _wanted(field, keys[-1] if keys else "")
    if kind == "refused":
        keys += [context["key"]] if context["key"] else []
        what, do = context["what"], context["do"]
    elif not fault["loc"]:
        do = "Give a table of keys and values."
    elif kind == "missing" and isinstance(fault["loc"][-1], str):
        table_too = field is not None and _tables(field.annotation) and not _is_list(field.annotation)
        usual = f"Add the table [{'.'.join(map(str, keys))}]." if table_too else ADD
        what, do = "is missing.", _remedy(field).missing or usual
    elif kind == "extra_forbidden" or fault["loc"][-1] == "[key]":
        known = table.accepted() if field is None else get_args(get_args(field.annotation)[0])
        what, do = "is not known here.", _there_are(known)
    elif kind in ("union_tag_invalid", "union_tag_not_found") and given.get("kind", "") is None:
        keys.append("kind")
        what, do = "is null.", "Leave it out."
    elif kind in ("union_tag_invalid", "union_tag_not_found"):
        keys.append("kind")
        what, do = (
            f"is {given.get('kind')!r}.",
            f"Use {context.get('expected_tags', 'text').replace(', ', ' or ')}.",
        )
    elif field is not None and (kind in _NO_TABLE or _tables(field.annotation)):
        keys = [key for key in keys if isinstance(key, str)]
        what, key = f"is {_shown(_at(values, keys))}.", ".".join(keys)
        listed = bool(_tables(field.annotation)) and _is_list(field.annotation)
        do = f"Write [[{key}]] tables." if listed else f"Make it a table, [{key}]."
    elif given is None:
        what, do = "is null.", "Leave it out."
    name = ""
    for key in keys:
        name += f"[{key}]" if isinstance(key, int) else f".{key}" if name else str(key)
    return DataError(what, do=do, file=file, key=name or None)


def _shown(value: Any) -> str:
    """Return a value as a message shows it; of a long one only the beginning."""
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]} and so on"


def _remedy(field: FieldInfo | None) -> Remedy:
    return next((m for m in (field.metadata if field else ()) if isinstance(m, Remedy)), Remedy())


def _at(values: Any, keys: list[Any]) -> Any:
    """Return the value that was given at these keys."""
    for key in keys:
        given = values if isinstance(values, Mapping) else dict(enumerate(values))
        values = given.get(key)
    return values


def _place(
    model: type[Table], values: Any, loc: tuple[Any, ...]
) -> tuple[list[Any], type[Table], FieldInfo | None]:
    """Return the keys of a fault, its table, and its field."""
    keys: list[Any] = []
    table, field, within = model, None, [model]
    for part in loc:
        tagged = [each for each in within if part == _tag(each)] if len(within) > 1 else []
        if tagged:
            within = tagged
        elif isinstance(part, int):
            values = _at(values, [part])
            if field is not None and _tables(field.annotation):  # for a row of numbers, the list is named
                keys.append(part)
        elif part != "[key]":
            table = within[0].of(values) if within else table
            field = table.model_fields.get(part) if within else field
            within, values = _tables(field.annotation) if field is not None else [], _at(values, [part])
            keys.append(part)
    return keys, table, field


def _tag(table: type[Table]) -> str:
    """Return what distinguishes a class from the others of a union: its kind, or its name."""
    field = table.model_fields.get("kind")
    return table.__name__ if field is None else get_args(field.annotation)[0]


def _tables(annotation: Any) -> list[type[Table]]:
    """Return the tables in an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return [annotation]
    return [table for each in get_args(annotation) for table in _tables(each)]


def _is_list(annotation: Any) -> bool:
    return get_origin(annotation) is tuple or any(_is_list(each) for each in get_args(annotation))


def _bounds(field: FieldInfo) -> tuple[float | None, float | None]:
    low: Any = next((m.ge for m in field.metadata if isinstance(m, Ge)), None)
    high: Any = next((m.le for m in field.metadata if isinstance(m, Le)), None)
    return low, high


def _kind_of(annotation: Any) -> Any:
    """Return the plain type below an annotation, such as float, bool, tuple or a Literal.

    Of a mapping, it is the type of its values.
    """
    if get_origin(annotation) in (tuple, Literal) or not get_args(annotation):
        return annotation
    if get_origin(annotation) is dict:
        return _kind_of(get_args(annotation)[1])
    return _kind_of(next(each for each in get_args(annotation) if each is not type(None)))


def _wanted(field: FieldInfo | None, key: str) -> str:
    """Return a sentence on the required value of a field."""
    if field is None:
        return ""
    if _remedy(field).wrong:
        return _remedy(field).wrong
    kind = _kind_of(field.annotation)
    if get_origin(kind) is Literal:
        return f"Use {' or '.join(repr(each) for each in get_args(kind))}."
    if kind is bool:
        return "Use true or false."
    if kind in (int, float):
        return f"Give a {'whole ' if kind is int else ''}number{_range(*_bounds(field))}."
    if get_origin(kind) is tuple:
        (item, *others) = get_args(kind)
        if get_origin(row := _kind_of(item)) is tuple:
            width, of = len(get_args(row)), "numbers, all of one length"
            return f"Give a list of rows of {of if get_args(row)[-1] is ... else f'{width} numbers'}."
        if others and others[-1] is not ...:
            return "Give three numbers, [x, y, z]."
        return f"List names of {key}, each once." if _kind_of(item) is str else "Give a list of numbers."
    return "Use text."


def _range(low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f" from {low:g} to {high:g}"
    if low is not None:
        return f", {low:g} or above" if low else ", zero or above"
    return "" if high is None else f", {high:g} or below"


class OnlyInFiles:
    """Mark of a key, or of one of its values, that names a file in the same folder.

    The schema for HTTP omits it.
    """

    def __init__(self, value: str = "") -> None:
        self._value = value

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> Any:
        if isinstance(getattr(handler, "generate_json_schema", None), FileSchema):
            return handler(core)
        if not self._value:
            raise PydanticOmit
        schema = handler(core)
        return {**schema, "enum": [each for each in schema["enum"] if each != self._value]}


class FileSchema(GenerateJsonSchema):
    """The JSON schema of a file for editors.

    Use `Model.model_json_schema(schema_generator=FileSchema)`.
    """

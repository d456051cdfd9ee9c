"""Pages of the reference, generated from the program: commands, keys of files, HTTP, effects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from acquisition import CampaignTable, Cell
from acquisition.file_table import FileSchema
from calib.effects import LIBRARY
from service.commands import app, load
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app

COLUMNS = 78  # of a terminal of 80


def write(folder: Path) -> None:
    """Write the pages; one that would not change is left as it is."""
    folder.mkdir(exist_ok=True)
    pages = {"commands": commands(), "keys": keys(), "http": http(), "effects": effects()}
    for name, lines in pages.items():
        page, text = folder / f"{name}.md", "\n".join(lines) + "\n"
        if not page.is_file() or page.read_text("utf-8") != text:
            page.write_text(text, "utf-8")


def commands() -> Iterator[str]:
    """Yield the help of every command, as `--help` prints it."""
    yield "# Commands"
    yield "Every command says the same with `--help`. Exit codes: 0 done, 1 failed, 2 cannot be used as it was given,"
    yield "3 done, but the accuracy asked for was not met, 4 operator or device not available, 5 refused for safety,"
    yield "130 interrupted. Completion of words by the shell: `truepose --install-completion`."
    for words, text in helps():
        yield from ("", f"## {' '.join(words)}", "", "```text", text, "```")


def helps() -> Iterator[tuple[tuple[str, ...], str]]:
    """The words and the help of the program and of each of its commands."""
    yield from _helps(app, ("truepose",), None)


def _helps(command: Any, words: tuple[str, ...], parent: Any) -> Iterator[tuple[tuple[str, ...], str]]:
    shown = {"terminal_width": COLUMNS, "max_content_width": COLUMNS}
    context = command.context_class(
        command, info_name=words[-1], parent=parent, **command.context_settings, **shown
    )
    yield words, command.get_help(context)
    for name, each in getattr(command, "commands", {}).items():
        yield from _helps(load(name) if parent is None else each, (*words, name), context)


def keys() -> Iterator[str]:
    """Every key of a cell and of a campaign, from the classes that read them."""
    yield "# Keys of cell and campaign"
    yield "Every key that these files may have; an unknown key is refused. `truepose cell schema` and"
    yield "`truepose campaign schema` write the same for editors."
    for file, model in (("cell.toml", Cell), ("campaign.toml", CampaignTable)):
        document = model.model_json_schema(schema_generator=FileSchema)
        yield from ("", f"## {file}")
        for name, schema in {document["title"]: document, **document["$defs"]}.items():
            yield from _schema(name, schema)


def effects() -> Iterator[str]:
    """Yield the effects of the library, with the check of a technician and the difference from other effects."""
    yield "# Effects"
    yield "The effects that the diagnosis searches for. The first word of a label is the effect: `backlash:j4` is the"
    yield "backlash of joint 4. [The theory](../theory.md#diagnosis) explains the search."
    yield ""
    yield "| effect | law | what to check | distinguished from others by |"
    yield "|---|---|---|---|"
    for entry in LIBRARY:
        for kind in entry.KINDS:
            check = kind.check.format(joint="K", name="NAME")
            yield _row(f"`{kind.name}`", entry.law, check, " ".join(kind.apart))


def http() -> Iterator[str]:
    """Yield every route and body of `/openapi.json`."""
    document = create_app(ServiceSettings(record=Path(), tokens=Tokens("", ""))).openapi()
    yield "# HTTP"
    yield document["info"]["description"]
    yield "The service serves this as `/openapi.json`, from which client generators work."
    yield "Every error is an `application/problem+json` with `operator_text` and `what_to_do`."
    for tag in document["tags"]:
        yield from ("", f"## {tag['name']}", "", tag["description"])
        for path, item in sorted(document["paths"].items()):
            for method, operation in item.items():
                if operation["tags"][-1] == tag["name"]:  # the core stands first, and only there
                    yield from _route(method.upper(), path, operation)
    yield from ("", "## Bodies")
    for name, schema in sorted(document["components"]["schemas"].items()):
        yield from _schema(name, schema)


def _route(method: str, path: str, operation: Mapping[str, Any]) -> Iterator[str]:
    said = operation.get("description") or operation.get("summary", "")
    yield from ("", f"### {method} {path}", "", said, "")
    if parameters := operation.get("parameters"):
        yield from ("| parameter | in | type | default | |", "|---|---|---|---|---|")
        for each in parameters:
            kind = each["schema"]
            yield _row(
                f"`{each['name']}`", each["in"], _type(kind), _default(kind), each.get("description", "")
            )
        yield ""
    bodies = operation.get("requestBody", {}).get("content", {})
    answers = {
        code: content.get("schema", {})
        for code, answer in operation["responses"].items()
        for content in answer.get("content", {}).values()
        if code != "default"
    }
    for media, content in bodies.items():
        yield f"Request, `{media}`: {_type(content.get('schema', {}))}."
    for code, schema in answers.items():
        yield f"Answer {code}: {_type(schema)}."


def _schema(name: str, schema: Mapping[str, Any]) -> Iterator[str]:
    yield from ("", f"### {name}", "", schema.get("description", "").replace("\n", " "), "")
    if properties := schema.get("properties"):
        needed = schema.get("required", ())
        yield from ("| field | type | default | |", "|---|---|---|---|")
        for key, value in properties.items():
            default = "must be given" if key in needed else _default(value)
            yield _row(f"`{key}`", _type(value), default, value.get("description", ""))
    elif choices := schema.get("enum"):
        yield "One of " + ", ".join(f"`{each}`" for each in choices) + "."


def _type(schema: Mapping[str, Any]) -> str:
    """A schema in a few words, other schemas by their names."""
    if reference := schema.get("$ref"):
        name = reference.rsplit("/", 1)[1]
        return f"[{name}](#{name.lower()})"
    for key in ("anyOf", "oneOf", "allOf"):
        if key in schema:
            return " or ".join(_type(each) for each in schema[key])
    if "enum" in schema:
        return ", ".join(f"`{each}`" for each in schema["enum"])
    kind = schema.get("type", "anything")
    if kind == "array":
        return f"list of {_type(schema.get('items') or schema.get('prefixItems', [{}])[0])}"
    ends = {"from": "minimum", "to": "maximum"}
    limits = [f"{word} {schema[key]:g}" for word, key in ends.items() if key in schema]
    return " ".join([f"`{schema['const']}`" if "const" in schema else kind, *limits])


def _default(schema: Mapping[str, Any]) -> str:
    return f"`{schema['default']!r}`" if "default" in schema else ""


def _row(*cells: str) -> str:
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |"

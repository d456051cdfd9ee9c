"""Spoiled requests drawn from the OpenAPI document.

Paths, queries, headers, and bodies of JSON and forms are spoiled.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from random import Random
from typing import Any

from tests.fuzz.formats import EXAMPLES
from tests.fuzz.mutations import VALUES, WORDS, spoil_bytes, spoil_value

CAMPAIGN = tomllib.loads((EXAMPLES / "irb120_faro" / "campaign.toml").read_text("utf-8"))
TARGETS = [{"target_id": "A", **{f"j{k}_deg": 10.0 * k for k in range(1, 7)}}]
TABLE = "target_id,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\nA,10,-20,30,0,45,0\n"
GOOD: Mapping[str, tuple[Any, ...]] = {
    "campaign": (CAMPAIGN,),
    "targets": (TARGETS, []),
    "csv": (TABLE, ""),
    "conditions": ("", "side=below,temperature=22", "mass=2,cog=1:2:3"),
    "tool": ("", "0,0,100,0,0,0"),
    "dry_run": (True, True, True, False),
}
"""Values of members for which the schema says too little to be taken."""
EITHER = (("campaign", "campaign_id"), ("csv", "targets"))
"""Members of which one is given."""


@dataclass(frozen=True)
class Asked:
    """Request in the form that the client takes."""

    method: str
    path: str
    params: list[tuple[str, str]]
    headers: dict[bytes, bytes]
    content: bytes | None = None
    files: dict[str, tuple[str, bytes]] = field(default_factory=dict)


def draw(document: Mapping[str, Any], ids: tuple[str, ...], files: Mapping[str, bytes], rng: Random) -> Asked:
    """Draw a request to an operation of the OpenAPI document.

    `ids` are some that exist; `files` are good ones for forms.
    """
    path = rng.choice(sorted(document["paths"]))
    method = rng.choice(sorted(document["paths"][path]))
    operation = document["paths"][path][method]
    params: list[tuple[str, str]] = []
    headers: dict[bytes, bytes] = {}
    for each in operation.get("parameters", ()):
        text = _text(_value(document, each.get("schema", {}), each["name"], rng), rng)
        if each["in"] == "query" and rng.random() < 0.7:
            params.append((each["name"], text))
        elif each["in"] == "header" and rng.random() < 0.5:
            headers[each["name"].encode()] = text.translate(_NO_CONTROL).encode("latin-1", "replace")
    where = re.sub(
        r"\{\w+\}", lambda _: rng.choice((*ids, *ids, "x", "..", "%2e%2e", "a" * 300, "%00", "é")), path
    )
    content = None
    sent: dict[str, tuple[str, bytes]] = {}
    bodies = operation.get("requestBody", {}).get("content", {})
    if "multipart/form-data" in bodies:
        sent = {
            name: (name, spoil_bytes(data, rng) if rng.random() < 0.5 else data)
            for name, data in files.items()
        }
    elif bodies:
        body = _value(document, bodies["application/json"]["schema"], "", rng)
        for _ in range(rng.choice((0, 0, 1, 1, 2))):
            # mostly what the schema does not describe, and the framework does not refuse
            inner = [body.get(key) for key in ("campaign", "targets")] if isinstance(body, dict) else []
            free = [each for each in inner if each] if rng.random() < 0.7 else []
            for each in free or [body]:
                if isinstance(each, dict | list) and each:
                    spoil_value(each, rng)
        content = json.dumps(body).encode()
        if rng.random() < 0.2:
            content = spoil_bytes(content, rng)
        headers[b"Content-Type"] = rng.choice((b"application/json",) * 9 + (b"text/plain",))
    return Asked(method.upper(), where, params, headers, content, sent)


_NO_CONTROL = dict.fromkeys([*range(32), 127], "")


def _text(value: Any, rng: Random) -> str:
    if rng.random() < 0.2:
        value = rng.choice((*VALUES, *(word[:200].decode("latin-1") for word in WORDS)))
    return str(value)[:2000].encode("utf-8", "replace").decode("utf-8")


def _value(document: Mapping[str, Any], schema: Mapping[str, Any], name: str, rng: Random) -> Any:
    """A value that the schema allows, more or less."""
    if "$ref" in schema:
        schema = document["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    if name in GOOD and rng.random() < 0.9:
        return deepcopy(rng.choice(GOOD[name]))
    for key in ("anyOf", "allOf", "oneOf"):
        if key in schema:
            return _value(document, rng.choice(schema[key]), name, rng)
    kind = schema.get("type")
    if kind == "object":
        members = schema.get("properties", {})
        left_out = {rng.choice(pair) for pair in EITHER} if rng.random() < 0.9 else set()
        needed = {*schema.get("required", ()), *(each for pair in EITHER for each in pair)}
        return {
            key: _value(document, inner, key, rng)
            for key, inner in members.items()
            if key not in left_out and (key in needed or rng.random() < 0.3)
        }
    if kind == "array":
        return [_value(document, schema.get("items", {}), "", rng) for _ in range(rng.randrange(4))]
    simple = {"string": ("", "a", "anna", "x" * 300), "boolean": (True, False), "integer": (0, 1, -1, 10**20)}
    return rng.choice(simple.get(kind or "", (0, 1.5, -1.0, 30.0, 1e300)))

"""dccXMLJSONConv and dsiUnits of the PTB read a certificate, in an environment of their own.

Called as `.counterparts/dcc/bin/python dcc_peer.py FILE.xml`: prints what they find, as one JSON object. The types are
those of the schema 3.3.0, which dccXMLJSONConv carries as tables: a leaf that is not among them is none of the schema,
or one of its enumerations, which have no name there.
"""

from __future__ import annotations

import json
import sys
import warnings
from importlib.resources import files
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

warnings.simplefilter(
    "ignore"
)  # of the packages: they use what Python gives up, and say which lists they make

from dccXMLJSONConv.dccConv import XMLToJson  # noqa: E402  # pyright: ignore[reportMissingImports]
from dsi_unit import DsiUnit  # noqa: E402  # pyright: ignore[reportMissingImports]

SPACES = {"{https://ptb.de/dcc}": "dcc:", "{https://ptb.de/si}": "si:"}
SCHEMA = '["https://ptb.de/dcc/dcc.xsd", "3.3.0"]'


def main(file: Path) -> None:
    text = file.read_text("utf-8")
    read = XMLToJson(text)
    tables = json.loads((files("dccXMLJSONConv") / "data" / "schemaTypeCastCache.json").read_text("utf-8"))[
        SCHEMA
    ]
    known = {name for table in tables.values() for name in table}
    leaves = {_short(each.tag) for each in ElementTree.fromstring(text).iter() if not len(each)}
    units = {each["#text"] for each in _all(read, "si:unit")}
    told = {
        "read": read,
        "unknown_leaves": sorted(leaves - known),
        "known": len(leaves & known),
        "units": {unit: bool(DsiUnit(unit).valid) for unit in sorted(units)},
    }
    sys.stdout.write(json.dumps(told))


def _short(tag: str) -> str:
    for space, short in SPACES.items():
        tag = tag.replace(space, short)
    return tag


def _all(value: Any, key: str) -> list[Any]:
    if isinstance(value, list):
        return [found for each in value for found in _all(each, key)]
    if not isinstance(value, dict):
        return []
    own = [value[key]] if key in value else []
    return own + [found for each in value.values() for found in _all(each, key)]


if __name__ == "__main__":
    main(Path(sys.argv[1]))

"""JSON schema of robot files (draft 2020-12), for TOML editors and other programs.

Editors use it to complete and check files. The reader checks what a schema cannot express: limits in
order, invertible matrices, parallel axes. A test compares both, key by key.
"""

from __future__ import annotations

from typing import Any

from calib.arm import FARTHEST_MM
from calib.arm.robot import FORMAT, MOST_JOINTS, MOST_TURN
from calib.units import DEG

_DEG = round(MOST_TURN / DEG, 6)
_MM = FARTHEST_MM


def _number(unit: str, what: str, most: float) -> dict[str, Any]:
    return {"type": "number", "minimum": -most, "maximum": most, "description": f"{what} ({unit})"}


def _point(what: str) -> dict[str, Any]:
    items = {"type": "number", "minimum": -_MM, "maximum": _MM}
    return {"type": "array", "items": items, "minItems": 3, "maxItems": 3, "description": f"{what} (mm)"}


def _table(required: list[str], properties: dict[str, Any], what: str, **more: Any) -> dict[str, Any]:
    return {
        "type": "object",
        "description": what,
        "required": required,
        "additionalProperties": False,
        "properties": properties,
        **more,
    }


_TEXT = {"type": "string", "minLength": 1}
_WHICH = {"type": "integer", "minimum": 1, "maximum": MOST_JOINTS, "description": "number of the link"}
_TURNS = {"properties": {"joint": {"const": "turns"}, "min_mm": False, "max_mm": False}}
_SLIDES = {"properties": {"joint": {"const": "slides"}, "min_deg": False, "max_deg": False}}
_LINK = _table(
    ["alpha_deg", "a_mm", "theta_deg", "d_mm"],
    {
        "joint": {"enum": ["turns", "slides"], "default": "turns", "description": "what the joint does"},
        "axis": {
            "type": "string",
            "pattern": "^e[1-9][0-9]?$",
            "description": "name of an axis that is not the arm's: a track, a positioner",
        },
        "alpha_deg": _number("deg", "twist of the link, about x", _DEG),
        "a_mm": _number("mm", "length of the link, along x", _MM),
        "theta_deg": _number("deg", "angle about z when the joint is at 0", _DEG),
        "d_mm": _number("mm", "offset along z when the joint is at 0", _MM),
        "min_deg": _number("deg", "lower limit, as the controller counts", _DEG),
        "max_deg": _number("deg", "upper limit, as the controller counts", _DEG),
        "min_mm": _number("mm", "lower limit of a joint that slides", _MM),
        "max_mm": _number("mm", "upper limit of a joint that slides", _MM),
    },
    "one link with its joint, from the foot to the flange",
    oneOf=[
        {**_TURNS, "required": ["min_deg", "max_deg"]},
        {**_SLIDES, "required": ["joint", "min_mm", "max_mm"]},
    ],
)
_NUMBERS = {"type": "array", "items": {"type": "number"}, "minItems": 1, "maxItems": MOST_JOINTS}

SCHEMA: dict[str, Any] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": FORMAT,
    **_table(
        ["format", "name", "maker", "convention", "source", "link"],
        {
            "format": {"const": FORMAT},
            "name": {**_TEXT, "description": "name of the robot"},
            "maker": {**_TEXT, "description": "its maker"},
            "convention": {"enum": ["dh", "mdh"], "description": "standard or modified (Craig) DH numbers"},
            "base": {
                "enum": ["plain", "thesis"],
                "default": "plain",
                "description": "where d of link 1 stands",
            },
            "parallel_axes": {
                "type": "array",
                "items": {"type": "integer", "minimum": 2, "maximum": MOST_JOINTS},
                "description": "axes that are parallel to the one before: their twist is identified",
            },
            "controller_world_mm": _point("where the controller's world is, in the base frame"),
            "source": {**_TEXT, "description": "where the numbers come from"},
            "link": {"type": "array", "items": _LINK, "minItems": 1, "maxItems": MOST_JOINTS},
            "loads": {
                "type": "array",
                "items": _table(
                    ["link", "mass_kg", "cog_mm"],
                    {
                        "link": _WHICH,
                        "mass_kg": {"type": "number", "exclusiveMinimum": 0.0, "description": "mass (kg)"},
                        "cog_mm": _point("centre of gravity in the frame of the link"),
                    },
                    "a mass that loads the joints",
                ),
            },
            "loads_estimated": {
                "type": "boolean",
                "default": False,
                "description": "whether the loads are estimates: they weigh less in the fit of the compliances",
            },
            "joint_matrices": {
                "type": "object",
                "description": "how a controller counts: model joint = matrix x counted + offset",
                "additionalProperties": _table(
                    ["matrix"],
                    {
                        "matrix": {
                            "type": "array",
                            "items": _NUMBERS,
                            "minItems": 1,
                            "maxItems": MOST_JOINTS,
                        },
                        "offset_deg": {**_NUMBERS, "description": "of joints that turn, 0 for others (deg)"},
                        "offset_mm": {**_NUMBERS, "description": "of joints that slide, 0 for others (mm)"},
                    },
                    "one way of counting",
                ),
            },
            "capsule": {
                "type": "array",
                "items": _table(
                    ["name", "link", "from_mm", "to_mm", "radius_mm"],
                    {
                        "name": _TEXT,
                        "link": _WHICH,
                        "from_mm": _point("one end in the frame of the link"),
                        "to_mm": _point("the other end"),
                        "radius_mm": {
                            "type": "number",
                            "exclusiveMinimum": 0.0,
                            "description": "radius (mm)",
                        },
                    },
                    "part of the body: all points near a line",
                ),
            },
        },
        "a robot as its maker describes it",
    ),
}

"""Results of a ballbar test as the maker's software saves them: `.b5r`, an XML file.

The format is not published. This module reads the parts that public programs read: the header, and the features of the
analysis by name, value and kind of unit. It is unknown which element has the raw radial samples, so they are not read.
Values keep the unit of the file (`Feature.unit`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from drivers.errors import ConfigError

UNITS: Mapping[str, str] = {
    "UT_LENGTH_UM": "um",
    "UT_LENGTH_MM": "mm",
    "UT_LENGTH_M": "m",
    "UT_SQUARENESS": "um/m",
    "UT_SERVO_MISMATCH": "ms",
    "UT_ANGLE": "deg",
    "UT_SCALE_ERROR": "ppm",
    "UT_FEEDRATE": "mm/min",
    "UT_SPEED": "mm/s",
    "UT_PERCENT": "%",
    "UT_RANKING": "1",
}
_MOST_BYTES = 50_000_000
_SAVE_AGAIN = "Save the test again from the ballbar software."


@dataclass(frozen=True, slots=True)
class Feature:
    """One result of an analysis; `unit` is empty if the file names an unknown kind."""

    analysis: str
    name: str
    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class BallbarTest:
    """Header and features of one test; a text is empty if the file has none."""

    plane: str
    axes: tuple[str, str]
    test: str
    operator: str
    started: str
    machine: str
    serial: str
    last_calibrated: str
    part: str
    features: tuple[Feature, ...]

    def feature(self, name: str) -> Feature:
        """Return the first feature of this name.

        Raises
        ------
        ConfigError
            There is none; the message lists the existing ones.
        """
        for each in self.features:
            if each.name == name:
                return each
        have = ", ".join(sorted({each.name for each in self.features}))
        raise ConfigError(f"no feature {name!r} in this ballbar test; there are {have}")


def read_b5r(path: Path) -> BallbarTest:
    """Read one file.

    Raises
    ------
    ConfigError
        The file is not a ballbar test; the message states why.
    OSError
        The file cannot be read.
    """
    data = path.read_bytes()
    if len(data) > _MOST_BYTES:
        raise ConfigError(
            f"{path}: larger than {_MOST_BYTES} bytes, not a ballbar test",
            what_to_do="Name the file that the ballbar software saved.",
        )
    return parse_b5r(data, str(path))


def parse_b5r(data: bytes, where: str = "ballbar test") -> BallbarTest:
    """Parse the bytes of a b5r file.

    Raises
    ------
    ConfigError
        They are not a ballbar test.
    """
    if b"<!ENTITY" in data or "<!ENTITY".encode("utf-16-le") in data:
        raise ConfigError(f"{where}: declares entities, as no ballbar test does", what_to_do=_SAVE_AGAIN)
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise ConfigError(f"{where}: is no XML ({error})", what_to_do=_SAVE_AGAIN) from error
    features = tuple(_features(root, where))
    plane = root.find(".//PLANE")
    if plane is None or not features:
        lacking = "PLANE" if plane is None else "FEATURE"
        raise ConfigError(f"{where}: has no {lacking}, unlike a ballbar test", what_to_do=_SAVE_AGAIN)
    return BallbarTest(
        plane=plane.get("TEST_PLANE", "").upper(),
        axes=(_text(plane, "A_AXIS_NAME"), _text(plane, "B_AXIS_NAME")),
        test=_named(root, "TEST_SPEC"),
        operator=_text(root, "OPERATOR"),
        started=_text(root, "DATE_STARTED"),
        machine=_named(root, "MACHINE_TESTED"),
        serial=_text(root, "SERIAL_NUMBER"),
        last_calibrated=_text(root, "LAST_CALIBRATED"),
        part=_text(root, "PART_NUMBER"),
        features=features,
    )


def _features(root: ElementTree.Element, where: str) -> list[Feature]:
    analyses = {
        feature: each.get("NAME", "") for each in root.iter("ANALYSIS") for feature in each.iter("FEATURE")
    }
    found = []
    for element in root.iter("FEATURE"):
        name, text = element.get("NAME", ""), (element.text or "").strip()
        try:
            value = float(text.replace("_", "?"))  # Python reads 1_5 as 15
        except ValueError as error:
            raise ConfigError(
                f"{where}: feature {name!r} is {text!r}, not a number",
                what_to_do=_SAVE_AGAIN,
            ) from error
        if not math.isfinite(value):
            raise ConfigError(
                f"{where}: feature {name!r} is {text!r}, not a finite number",
                what_to_do=_SAVE_AGAIN,
            )
        found.append(Feature(analyses.get(element, ""), name, value, UNITS.get(element.get("DT", ""), "")))
    return found


def _text(root: ElementTree.Element, tag: str) -> str:
    return (root.findtext(f".//{tag}") or "").strip()


def _named(root: ElementTree.Element, tag: str) -> str:
    element = root.find(f".//{tag}")
    return "" if element is None else element.get("NAME", "").strip()

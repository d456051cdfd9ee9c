"""Draft of a robot file: its contents, and its text with comments on values to be checked."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from calib.arm import Load, Robot, load_robot
from calib.arm.robot import FORMAT, Convention
from calib.arm.weight import estimated_loads
from calib.array import Array
from calib.errors import DataError

_PARALLEL = 1e-9  # sine of alpha
_DIGITS = 9
CONVENTIONS: dict[Convention, str] = {
    "mdh": "Craig, modified DH: Rx(alpha) Tx(a) Rz(theta + q) Tz(d); alpha and a lead from the axis before to this one",
    "dh": "standard DH: Rz(theta + q) Tz(d) Tx(a) Rx(alpha); alpha and a lead from this axis to the next one",
}


@dataclass(frozen=True)
class DraftLink:
    """A link of a draft: DH parameters (deg, mm), joint limits and a comment.

    The limits are in deg, or mm if the joint slides.
    """

    alpha_deg: float
    a_mm: float
    theta_deg: float
    d_mm: float
    low: float
    high: float
    slides: bool = False
    comment: str = ""


@dataclass(frozen=True)
class Draft:
    """Contents of a robot file to be written.

    Attributes
    ----------
    remarks : tuple of str
        Sentences at its top.
    matrices : dict of str to (array, array)
        Joint matrices (N, N) and their offsets (N,), by name.
    """

    name: str
    maker: str
    convention: Convention
    source: str
    links: tuple[DraftLink, ...]
    loads: tuple[Load, ...] = ()
    loads_estimated: bool = False
    matrices: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    @property
    def parallel_axes(self) -> tuple[int, ...]:
        """Axes, from 2, that are parallel to the one before and not in line with it.

        Their twist can be identified.
        """
        behind = 1 if self.convention == "dh" else 0
        between = self.links[: len(self.links) - 1] if behind else self.links[1:]
        return tuple(
            k
            for k, link in enumerate(between, start=2)
            if abs(np.sin(np.radians(link.alpha_deg))) <= _PARALLEL and abs(link.a_mm) > 0.0
        )

    @property
    def text(self) -> str:
        """The text of the file."""
        return "\n".join(self._lines()) + "\n"

    def _lines(self) -> Iterator[str]:
        yield from (f"# {_plain(remark)}" for remark in self.remarks)
        yield f'format = "{FORMAT}"'
        yield f"name = {_quoted(self.name)}"
        yield f"maker = {_quoted(self.maker)}"
        yield f'convention = "{self.convention}"   # {CONVENTIONS[self.convention]}'
        if self.parallel_axes:
            axes = list(self.parallel_axes)
            yield f"parallel_axes = {axes}   # parallel to the axis before: their twist is identified as well"
        yield f"source = {_quoted(self.source)}"
        if self.loads_estimated:
            yield "loads_estimated = true   # nobody weighed the masses below; put published ones in their place"
        for name, (matrix, offset) in self.matrices.items():
            yield ""
            yield from matrix_lines(name, matrix, offset, [link.slides for link in self.links])
        for number, link in enumerate(self.links, start=1):
            yield ""
            yield f"[[link]]   # {number}{': ' + _plain(link.comment) if link.comment else ''}"
            yield from (f'joint = "{kind}"' for kind in ["slides"] * link.slides)
            for key in ("alpha_deg", "a_mm", "theta_deg", "d_mm"):
                yield f"{key} = {_number(getattr(link, key))}"
            unit = "mm" if link.slides else "deg"
            yield f"min_{unit} = {_number(link.low)}"
            yield f"max_{unit} = {_number(link.high)}"
        for load in self.loads:
            centre = ", ".join(_number(x) for x in load.cog_mm)
            yield from ("", "[[loads]]", f"link = {load.link}", f"mass_kg = {_number(load.mass_kg)}")
            yield f"cog_mm = [{centre}]"


def matrix_lines(name: str, matrix: Array, offset: Array, slides: Sequence[bool]) -> Iterator[str]:
    """Yield the lines of a joint matrix (N, N) with its offsets (N,), deg or mm.

    The matrix means: model joint = matrix x counted + offset.
    """
    yield f"[joint_matrices.{name}]   # model joint = matrix x what the controller counts + offset"
    yield "matrix = ["
    yield from (f"    [{', '.join(_number(x) for x in row)}]," for row in np.asarray(matrix))
    yield "]"
    for unit, of in (("deg", False), ("mm", True)):
        if any(x and kind == of for x, kind in zip(offset, slides, strict=True)):
            shown = [x if kind == of else 0.0 for x, kind in zip(offset, slides, strict=True)]
            yield f"offset_{unit} = [{', '.join(_number(float(x)) for x in shown)}]"


def written_robot(draft: Draft) -> Robot:
    """Read the robot from the draft's text, as every robot file is read.

    Raises
    ------
    DataError
        The text is not a valid robot file.
    """
    with TemporaryDirectory() as folder:
        (Path(folder) / "draft.toml").write_text(draft.text, encoding="utf-8")
        try:
            return load_robot("draft.toml", Path(folder))
        except DataError as error:  # the user has not seen that file
            raise DataError(error.what, do=error.do, key=error.key) from error


def weighed(draft: Draft, mass_kg: float) -> Draft:
    """Add estimated loads for a mass of the whole arm, kg, to a draft.

    Raises
    ------
    DataError
        The draft has masses already, or no arm has this mass.
    """
    if draft.loads:
        raise DataError("is given, but the file has masses.", do="Leave it out.", key="--mass")
    return replace(draft, loads=estimated_loads(written_robot(draft), mass_kg), loads_estimated=True)


def _number(value: float) -> str:
    """Write a number without rounding errors, with a decimal point."""
    return repr(round(float(value), _DIGITS) + 0.0)


def _quoted(text: str) -> str:
    """Write a TOML basic string: JSON's, whose escapes TOML shares, of one line."""
    return json.dumps(_plain(text), ensure_ascii=False)


def _plain(text: str) -> str:
    """Remove the control characters that TOML does not allow from a line."""
    return "".join(letter if letter.isprintable() else "?" for letter in " ".join(text.split()))

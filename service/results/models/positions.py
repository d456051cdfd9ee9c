"""Fitted positions of targets with a stated uncertainty, for the terminal and the report."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from calib.arm import with_sides
from calib.data import Dataset
from calib.fit import IdentificationFit, TargetOffset, offsets_of
from service import wording

_SAME_MM = 5e-4  # cups that the robot touched have those sides already
HEADINGS = ("Target", "Stated ± u, mm", "Offset x, y, z ± std. error, mm", "By the others, mm", "Sigma")


def by_the_bar(dataset: Dataset) -> str:
    """State the first three base balls with the side lengths that the ballbar measured.

    The text can be copied into the cell file. It is empty if the bar did not measure all three sides.

    They are laid over the stated positions, which the robot touched (Nubiola, thesis, 4.2). The triangle is then
    right to a micrometre, and lies where the robot believes it to be.
    """
    names = list(dataset.header.base_targets)[:3]
    sides = []
    for pair in combinations(names, 2):  # d12, d13, d23
        lengths = [s.length_mm for s in dataset.spans if not s.series and {s.one, s.other} == set(pair)]
        if not lengths:
            return ""
        sides.append(float(np.mean(lengths)))
    if len(sides) < 3:
        return ""
    stated = np.array([dataset.header.base_targets[name] for name in names])
    found = with_sides(stated, (sides[0], sides[2], sides[1]))
    places = ", ".join(
        f"{name} = [{', '.join(f'{x:.3f}' for x in place)}]" for name, place in zip(names, found, strict=True)
    )
    off = np.linalg.norm(found - stated, axis=1).max()
    elsewhere = f", up to {off:.3f} mm from the cell file" if off > _SAME_MM else ""
    return (
        f"The base balls with the sides that the bar measured{elsewhere}, for [world] of the cell file before the next "
        f"campaign: nests = {{ {places} }}"
    )


def rows_of(found: IdentificationFit) -> list[tuple[str, ...]]:
    """Create one row of text per target, for `HEADINGS`."""
    return [
        (
            f"{offset.name} ({offset.kind})",
            f"{offset.u_mm:g}",
            ", ".join(_with_error(x, std) for x, std in zip(offset.offset_mm, offset.std_mm, strict=True)),
            wording.millimetres(offset.judged.distance_mm),
            _sigma(offset),
        )
        for offset in offsets_of(found)
    ]


def _with_error(x: float, std: float) -> str:
    value, error = wording.with_uncertainty(x, std)
    return f"{value} ± {error}"


def _sigma(offset: TargetOffset) -> str:
    return f"{offset.judged.sigma:.1f}" + (": measure anew" if offset.judged.doubted else "")

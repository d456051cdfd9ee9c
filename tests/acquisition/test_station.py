"""Detection of a moved instrument, from nests measured twice.

False alarms are as rare as stated, and real moves are detected.
"""

from __future__ import annotations

import numpy as np
import pytest

from acquisition.cell.cell import FALSE_ALARM, SEAT_MM, NoiseFigures, moved_by

NESTS = {"N1": (2400.0, 900.0, -350.0), "N2": (1800.0, 900.0, -350.0), "N3": (2400.0, 300.0, -350.0)}
NOISE = NoiseFigures()


def measured(
    rng: np.random.Generator, shift: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> dict[str, tuple[float, ...]]:
    """Return the nests with the noise of a tracker and of the seat.

    The noise along the beam is smaller than across it.
    """
    out = {}
    for name, place in NESTS.items():
        point = np.array(place)
        distance = float(np.linalg.norm(point))
        beam = point / distance
        error = rng.normal(0.0, NOISE.transverse_mm + NOISE.transverse_ppm * 1e-6 * distance, 3)
        along = rng.normal(0.0, NOISE.range_mm + NOISE.range_ppm * 1e-6 * distance)
        error += (along - error @ beam) * beam + rng.normal(0.0, SEAT_MM, 3)
        out[name] = tuple(float(x) for x in point + error + shift)
    return out


def share_moved(shift_mm: float, tries: int) -> float:
    rng = np.random.default_rng(5)
    moved = 0
    for _ in range(tries):
        direction = rng.normal(size=3)
        shift = tuple(float(x) for x in shift_mm * direction / np.linalg.norm(direction))
        moved += moved_by(measured(rng), measured(rng, shift), NOISE) is not None
    return moved / tries


def test_noise_alone_moves_nothing() -> None:
    """Binomial counts of 4000 tries at 1 in 1000 are 4 +- 2; more than 12 has a chance of 3e-4."""
    assert 0 < share_moved(0.0, 4000) * 4000 <= 4000 * FALSE_ALARM + 8


def test_what_would_shift_the_world_beyond_the_noise_is_seen() -> None:
    """Half of all shifts of 0.1 mm and nearly all of 0.15 mm are detected.

    The tracker has 25 um across the beam.
    """
    assert share_moved(0.10, 500) > 0.5
    assert share_moved(0.15, 500) > 0.97


def test_a_change_in_figures() -> None:
    """One nest is 0.3 mm further along the beam, so T = 0.3^2 / 2 (range^2 + seat^2).

    Chi-squared with 3 d.o.f. gives 16.266.
    """
    moved = moved_by({"N1": (1000.0, 0.0, 0.0)}, {"N1": (1000.3, 0.0, 0.0)}, NOISE)
    assert moved is not None
    variance = 2.0 * ((0.010 + 2e-6 * 1000.0) ** 2 + SEAT_MM**2)
    assert moved[0] == pytest.approx(0.3)
    assert moved[1] == pytest.approx(0.3**2 / variance / 16.266, rel=1e-4)

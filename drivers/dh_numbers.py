"""The kinematic parameters with which a controller calculates, as it reports them."""

from __future__ import annotations

from dataclasses import dataclass

Row = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class DhNumbers:
    """Standard DH numbers, `Rz(theta) Tz(d) Tx(a) Rx(alpha)`, of six links; deg and mm."""

    alpha_deg: Row
    a_mm: Row
    theta_deg: Row
    d_mm: Row

    def minus(self, other: DhNumbers) -> DhNumbers:
        """Return the difference of each number from that of another robot."""
        names = ("alpha_deg", "a_mm", "theta_deg", "d_mm")
        rows = ((getattr(self, name), getattr(other, name)) for name in names)
        return DhNumbers(*(tuple(p - q for p, q in zip(mine, its, strict=True)) for mine, its in rows))

    def links(self) -> list[dict[str, float]]:
        """Return a table for each link, with the keys of a robot file's `[[link]]`."""
        names = ("alpha_deg", "a_mm", "theta_deg", "d_mm")
        return [{name: getattr(self, name)[i] for name in names} for i in range(6)]


@dataclass(frozen=True, slots=True)
class ControllerCalibration:
    """A calibration of the arm that its controller holds and calculates with.

    `name` and `checksum` identify it, `status` is the maker's own number, and `deltas` are its corrections to the
    nominal numbers. Where axes are nearly parallel, only the chain of all links has a meaning.
    """

    name: str
    checksum: tuple[int, ...]
    status: int | None
    deltas: DhNumbers

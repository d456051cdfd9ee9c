"""Acceptance of a calibration: its held-out error against limits with guard bands.

The decision rule is that of ISO 14253-1. An error below the limit by more than its expanded uncertainty is
accepted. An error above the limit by more than that is rejected. Between the two, nothing is decided.

Zones of the workspace may have separate limits. They are boxes in the base frame of the robot, named in a file.

    [[zone]]
    name = "left table"
    low_mm = [200.0, -400.0, 0.0]
    high_mm = [500.0, -100.0, 300.0]
    accept_rms_mm = 0.10
    accept_max_mm = 0.25     # either may be left out

A reading belongs to every zone in which the judged model expects its target.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from calib.array import Array
from calib.data import Dataset
from calib.errors import DataError
from calib.fit import errors_on
from calib.model import ModelStructure
from calib.text import TomlTable, read_toml
from calib.validation import targets_in_base
from service import wording
from service.results.shape import Real, ResponseBody, told

_KEYS = ("name", "low_mm", "high_mm", "accept_rms_mm", "accept_max_mm")
FARTHEST = 1e5  # mm


@dataclass(frozen=True)
class Zone:
    """A box with edges along the axes of the base frame, and the largest errors in it, mm.

    `rms` or `largest` is None if it has no limit.
    """

    name: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    rms: float | None
    largest: float | None

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Test which points (n, 3), mm, base frame, lie in the box or on its faces, shape (n,)."""
        return np.all((points >= self.low) & (points <= self.high), axis=1)

    @property
    def box(self) -> str:
        """Place of the box, as text."""
        spans = (f"{axis} {a:g} to {b:g}" for axis, a, b in zip("xyz", self.low, self.high, strict=True))
        return f"{', '.join(spans)} mm in the base frame"


def read_zones(path: Path) -> tuple[Zone, ...]:
    """Read the zones of a file.

    Raises
    ------
    DataError
        The file is invalid; the error names file and key.
    """
    _, values = read_toml(path)
    table = TomlTable(values, path)
    table.only(["zone"])
    zones = tuple(_zone(each) for each in table.tables("zone"))
    if not zones:
        raise DataError("names no zone.", do="Add a [[zone]] table.", file=path, key="zone")
    twice = [zone.name for k, zone in enumerate(zones) if zone.name in {other.name for other in zones[:k]}]
    if twice:
        raise DataError(f"has two zones named {twice[0]!r}.", do="Rename one.", file=path, key="zone.name")
    return zones


def _zone(table: TomlTable) -> Zone:
    table.only(_KEYS)
    name, low, high = table.text("name"), table.vector("low_mm"), table.vector("high_mm")
    if not name.strip():
        raise table.refuse("name", "is empty.", "Name the zone.")
    if not all(a < b for a, b in zip(low, high, strict=True)):
        raise table.refuse(
            "high_mm", "is not above low_mm on every axis.", "Give the two corners of the box."
        )
    limits = [
        table.number(key, low=1e-6, high=FARTHEST) if key in table.values else None
        for key in ("accept_rms_mm", "accept_max_mm")
    ]
    if limits == [None, None]:
        raise table.refuse(
            "accept_rms_mm", "is missing, and so is accept_max_mm.", "Give one of them or both."
        )
    return Zone(name, low, high, *limits)


Quantity = Literal["rms", "max"]
Verdict = Literal["accepted", "rejected", "not_decided"]
NAMES: dict[Verdict, str] = {"accepted": "Accepted", "rejected": "Rejected", "not_decided": "Not decided"}

RULE = (
    "Accepted where the figure plus its expanded uncertainty U (95 %) is within the limit, rejected where the figure "
    "less U is beyond it, otherwise not decided (guard bands as in ISO 14253-1)."
)

BASE, _EFFECTS = "identified base model", "base model with the effects found"
_RESAMPLES, _SEED = 2000, 1  # the seed is fixed: the same readings give the same verdict


def judged_as(effects: Sequence[object]) -> str:
    """Name the model by which a diagnosis is judged.

    It is the base model if the diagnosis found no effects.
    """
    return _EFFECTS if effects else BASE


@dataclass(frozen=True)
class AcceptanceLimits:
    """The largest errors allowed, mm; None if a value has no limit.

    `zones` are parts of the workspace with separate limits.
    """

    rms: float | None
    largest: float | None
    zones: Sequence[Zone] = ()

    @classmethod
    def of(
        cls, rms: float | None, largest: float | None, zones: Sequence[Zone] = ()
    ) -> AcceptanceLimits | None:
        """Create the limits of --accept-rms, --accept-max and --accept-zones; None if none is given.

        Raises
        ------
        DataError
            A limit is not above 0 mm.
        """
        for option, value in (("--accept-rms", rms), ("--accept-max", largest)):
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise DataError(f"is {value:g}.", do="Give an error above 0 mm.", file=option)
        return None if rms is None and largest is None and not zones else cls(rms, largest, zones)

    @classmethod
    def kept(cls, table: Mapping[str, Any] | None) -> AcceptanceLimits | None:
        """Create the limits from a table that `asdict` made; None from None."""
        if table is None:
            return None
        zones = [
            Zone(**{**z, "low": tuple(z["low"]), "high": tuple(z["high"])}) for z in table.get("zones", ())
        ]
        return cls(table["rms"], table["largest"], tuple(zones))

    def refuse_unjudged(self, dataset: Dataset) -> None:
        """Raise DataError for a data set in which no reading can judge."""
        if not dataset.validation_rows.any():
            raise DataError(
                "has no measured validation rows, so --accept-rms, --accept-max and --accept-zones cannot be judged.",
                do="Mark some rows set = validation, or leave the options out.",
                file=dataset.path,
                key="set",
            )


@dataclass(frozen=True)
class Criterion:
    """An error compared with its limit.

    Attributes
    ----------
    figure, limit, uncertainty : float
        Error, its limit and its expanded uncertainty (95 %), mm. The uncertainty is infinite if it is unknown. The
        error is NaN if no reading lies in the zone; nothing is decided then.
    zone : Zone or None
        Part of the workspace to which the error applies; None for all of it.
    """

    quantity: Quantity
    figure: float
    limit: float
    uncertainty: float
    basis: str  # of the uncertainty
    zone: Zone | None = None

    @property
    def verdict(self) -> Verdict:
        """The verdict by the rule."""
        if self.figure + self.uncertainty <= self.limit:
            return "accepted"
        return "rejected" if self.figure - self.uncertainty > self.limit else "not_decided"

    @property
    def name(self) -> str:
        """The name of the error, with its zone."""
        what = "RMS error" if self.quantity == "rms" else "Largest error"
        return what if self.zone is None else f"{what} in zone {self.zone.name}"

    @property
    def zone_name(self) -> str | None:
        """The name of its zone, if it has one."""
        return None if self.zone is None else self.zone.name

    @property
    def shown(self) -> tuple[str, str]:
        """Figure and uncertainty as text, mm."""
        if not math.isfinite(self.figure):
            return "none", "unknown"
        if not math.isfinite(self.uncertainty):
            return f"{self.figure:.4f}", "unknown"
        return f"{self.figure:.4f}", f"{self.uncertainty:.4f}"


@dataclass(frozen=True)
class AcceptanceResult:
    """Every figure that has a limit, of one model on n readings."""

    model: str
    n: int
    criteria: tuple[Criterion, ...]
    rule: ClassVar[str] = RULE

    @property
    def verdict(self) -> Verdict:
        """Rejected where one criterion is, accepted where all are."""
        verdicts = {each.verdict for each in self.criteria}
        if "rejected" in verdicts:
            return "rejected"
        return "accepted" if verdicts == {"accepted"} else "not_decided"

    @property
    def sentences(self) -> list[str]:
        """A sentence for each error that has a limit: the decision and its reason."""
        return [
            f"{each.name} {each.shown[0]} mm, U {each.shown[1]} mm, limit {each.limit:g} mm: "
            f"{NAMES[each.verdict].lower()}."
            if math.isfinite(each.figure)
            else f"{each.name}, limit {each.limit:g} mm: {NAMES[each.verdict].lower()}, {each.basis}."
            for each in self.criteria
        ]

    @property
    def zones(self) -> list[Zone]:
        """The zones that have limits, each once, in their order."""
        return list(dict.fromkeys(each.zone for each in self.criteria if each.zone is not None))


class CriterionResponse(ResponseBody):
    """One figure against its limit."""

    quantity: Annotated[Quantity, told("Which error.", "rms")]
    zone: Annotated[
        str | None, told("Of which zone; null: of all readings held out.", None, of="zone_name")
    ] = None
    figure_mm: Annotated[Real, told("The figure, mm; null: no reading lies in the zone.", 0.041, of="figure")]
    expanded_uncertainty_mm: Annotated[
        Real, told("Its expanded uncertainty U (95 %), mm.", 0.004, of="uncertainty")
    ]
    uncertainty_basis: Annotated[
        str, told("What that is based on.", "bootstrap over 40 whole poses", of="basis")
    ]
    limit_mm: Annotated[float, told("The limit, mm.", 0.05, of="limit")]
    verdict: Annotated[Verdict, told("The verdict.", "accepted")]


class AcceptanceShown(ResponseBody):
    """The error on readings held out, compared with limits with guard bands (ISO 14253-1)."""

    verdict: Annotated[Verdict, told("Rejected where one criterion is.", "accepted")]
    model: Annotated[str, told("The model that was judged.", "base model with the effects found")]
    readings: Annotated[int, told("Number of readings.", 120, of="n")]
    rule: Annotated[str, told("The decision rule in words.", "Accepted where ...")]
    criteria: Annotated[list[CriterionResponse], told("Every figure that has a limit.", [])]


def decide(
    limits: AcceptanceLimits,
    dataset: Dataset,
    rows: NDArray[np.bool_],
    model: ModelStructure,
    estimate: Array,
    name: str,
) -> AcceptanceResult:
    """Compare the errors of a model with limits.

    At least one of the rows of the mask (n,) must be measured.
    """
    errors = np.full(len(dataset), np.nan)
    errors[rows] = errors_on(dataset, rows, model, estimate)
    criteria = _held(dataset, rows, errors, limits.rms, limits.largest)
    if limits.zones:
        places = targets_in_base(dataset, model, estimate)
        for zone in limits.zones:
            criteria += _held(dataset, rows & zone.holds(places), errors, zone.rms, zone.largest, zone)
    return AcceptanceResult(name, int(rows.sum()), tuple(criteria))


def _held(
    dataset: Dataset,
    rows: NDArray[np.bool_],
    errors: Array,
    rms: float | None,
    largest: float | None,
    zone: Zone | None = None,
) -> list[Criterion]:
    """Compare the errors of the rows (n,) with the limits that are given; errors (n,) are in mm."""
    judged, criteria = errors[rows], []
    if not len(judged):
        none = (math.inf, "no held-out reading lies in it")
        asked: tuple[tuple[Quantity, float | None], ...] = (("rms", rms), ("max", largest))
        return [Criterion(q, math.nan, limit, *none, zone) for q, limit in asked if limit is not None]
    if rms is not None:
        _, poses = np.unique(
            dataset.conditions.pose[rows], return_inverse=True
        )  # visits of one pose err together
        figure = float(np.sqrt(np.mean(judged**2)))
        criteria.append(Criterion("rms", figure, rms, *_of_rms(judged, poses), zone))
    if largest is not None:
        figure = float(judged.max())
        criteria.append(Criterion("max", figure, largest, *_of_largest(dataset, rows, len(judged)), zone))
    return criteria


def _of_rms(errors: Array, pose: NDArray[np.int64]) -> tuple[float, str]:
    """Compute the expanded uncertainty of an RMS, mm, and its basis.

    The method is a bootstrap over whole poses. Poses are drawn with replacement. The standard deviation of the RMS
    of the draws is widened by sqrt(g / (g - 1)) for g poses and by Student's factor for g - 1 degrees of freedom.
    With a single pose the spread is unknown.
    """
    squares, counts = np.bincount(pose, errors**2), np.bincount(pose)
    g = len(counts)
    if g < 2:
        return math.inf, "a single pose has no spread: the uncertainty of its RMS is unknown"
    random = np.random.default_rng(_SEED)
    drawn = (random.integers(g, size=g) for _ in range(_RESAMPLES))
    spread = float(np.std([math.sqrt(squares[k].sum() / counts[k].sum()) for k in drawn]))
    factor = float(stdtrit(g - 1, 0.975))
    return (
        factor * math.sqrt(g / (g - 1)) * spread,
        f"bootstrap over {g} whole poses, k = {factor:.2f} (Student, 95 %); noise of the readings is in the figure",
    )


def _of_largest(dataset: Dataset, rows: NDArray[np.bool_], n: int) -> tuple[float, str]:
    """Compute the expanded uncertainty of the largest error, mm, and its basis.

    The basis is the largest declared noise of a reading.
    """
    pointed, spanned = rows & dataset.pointed, rows & dataset.spanned
    covariance = dataset.header.noise.of_points(dataset.points[pointed], dataset.u_point[pointed])
    of_points = np.sqrt(np.linalg.eigvalsh(covariance)[:, -1])
    own = dataset.u_length[spanned]
    of_lengths = np.where(np.isfinite(own), own, dataset.header.noise.length_mm)
    largest = float(np.concatenate([of_points, of_lengths]).max())
    return (
        wording.COVERAGE * largest,
        f"{wording.COVERAGE:g} times the largest declared standard uncertainty of a reading; "
        f"the figure is that of these {n} readings, not of all the workspace",
    )

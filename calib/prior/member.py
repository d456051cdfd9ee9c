"""A robot of a type: its model file, and what its readings alone determine of the robot's parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from calib.array import Array
from calib.compensate import Bounds
from calib.model.effect import Effect, Parameter
from calib.saved import SavedModel, load_model
from calib.text import read_json
from calib.units import to_display

_BOUNDS = Bounds(
    30.0, 500.0
)  # of a correction: nothing is driven by these models, and strangers are found anyway


@dataclass(frozen=True)
class Member:
    """A robot by the file of its model; sha256: of its contents, as the file says itself."""

    path: Path
    sha256: str
    saved: SavedModel

    @classmethod
    def read(cls, path: Path, *, robot_file: Path | None = None) -> Member:
        """The model of a file. Raises DataError naming file and key."""
        saved = load_model(path, robot_file=robot_file, bounds=_BOUNDS)
        return cls(path, str(read_json(path).get("content_sha256", "")), saved)

    @property
    def name(self) -> str:
        """The name of its file."""
        return self.path.name

    @cached_property
    def identity(self) -> tuple[str, ...]:
        """Marks of this robot alone: the data it was identified from, and its serial number where it is known."""
        serial = next((d.get("serial", "") for d in self.saved.devices if d.get("role") == "robot"), "")
        return tuple(key for key in (f"data {self.saved.data_sha256}", f"serial {serial}") if key[-1] != " ")

    @cached_property
    def groups(self) -> tuple[str, ...]:
        """The groups of parameters that its base model frees."""
        return tuple(
            e.label for e in self.saved.model.effects if e.group == "base model" and e.owner == "robot"
        )

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """The effects found beside the base model; no curves of gears, whose waves are too many to name, and
        nothing that happened once in one campaign, and no carried terms, whose labels are no causes."""
        return tuple(
            e
            for e in self.saved.model.effects
            if e.group not in ("base model", "carried")
            and e.owner == "robot"
            and not e.is_curve
            and "rank" not in e.shape
        )

    @cached_property
    def own(self) -> dict[str, Parameter]:
        """The robot's own parameters by name."""
        base = [e for e in self.saved.model.effects if e.label in self.groups]
        return {p.name: p for e in (*base, *self.effects) for p in e.parameters}

    @cached_property
    def open(self) -> frozenset[str]:
        """The robot's own parameters that its readings left open and others make up for."""
        gone = frozenset(d.name for d in self.saved.dropped if d.stand_ins)
        return gone & frozenset(name for name in self.own if not self.tells(name))

    def tells(self, name: str) -> bool:
        """Whether a parameter was fitted."""
        place = self.saved.model.index.get(name)
        return place is not None and bool(self.saved.covariance[place, place] > 0.0)

    def value(self, name: str) -> float:
        """Estimate of a parameter in its unit."""
        place = self.saved.model.index[name]
        return to_display(float(self.saved.estimate[place]), self.saved.model.parameters[place].unit)

    def told(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Precision (p, p) and right side (p,) of some parameters by the readings alone, internal units; zero for those
        that this model does not have."""
        saved, index = self.saved, self.saved.model.index
        assert saved.held_std is not None
        places = [(k, index[name]) for k, name in enumerate(names) if self.tells(name)]
        at, of = [k for k, _ in places], [i for _, i in places]
        scale = np.sqrt(np.diag(saved.covariance)[of])
        inverse = np.linalg.inv(saved.covariance[np.ix_(of, of)] / np.outer(scale, scale))
        inverse = inverse / np.outer(scale, scale)
        held = saved.held_std[of] ** -2.0
        precision, right = np.zeros((len(names), len(names))), np.zeros(len(names))
        right[at] = inverse @ saved.estimate[of] - held * saved.model.prior_mean[of]
        precision[np.ix_(at, at)] = _positive(inverse - np.diag(held), scale)
        return precision, right


def _positive(precision: Array, scale: Array) -> Array:
    """A covariance without the negative eigenvalues that rounding, and priors that decided nearly everything, left."""
    values, vectors = np.linalg.eigh(precision * np.outer(scale, scale))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T / np.outer(scale, scale)

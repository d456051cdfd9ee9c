"""The residual map that was asked for, and the error on validation readings without and with it."""

from __future__ import annotations

from dataclasses import dataclass

from calib.diagnose import Diagnosis
from calib.fit import ErrorStatistics
from calib.regression import Patch, error_with_patch, error_without_patch, patch_of


@dataclass(frozen=True)
class Patched:
    """A patch beside the model: never part of it, never an effect."""

    patch: Patch
    without: ErrorStatistics | None
    with_it: ErrorStatistics | None

    @classmethod
    def of(cls, diagnosis: Diagnosis) -> Patched:
        """The patch of what a diagnosis leaves."""
        dataset, final = diagnosis.dataset, diagnosis.final
        patch = patch_of(dataset, final)
        return cls(patch, error_without_patch(dataset, final), error_with_patch(dataset, final, patch))

"""The JSON documents of `identify` and `diagnose`: contracts that other programs rely on.

Values are in the units of files and screens; NaN never occurs (null instead); reading ids that are whole numbers
are numbers.

The document of `truepose sweeps`: error, reversal and axis of every joint that was turned alone.

The residual map that was asked for, and the error on validation readings without and with it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from acquisition.loop import FollowUpResult, campaign_table
from calib.array import Array
from calib.data import Dataset
from calib.diagnose import (
    SEPARATES,
    CarriedTerm,
    CarryOver,
    DiagnosedEffect,
    DiagnosisFit,
    FollowUp,
    HeldOutTest,
)
from calib.fit import ErrorStatistics, IdentificationFit, UncertaintyMap, left_out, uncertainty_map
from calib.regression import Patch, error_with_patch, error_without_patch, patch_of
from calib.sweeps import JointSweep
from calib.text import written_by
from calib.units import DEG, to_display
from service import wording
from service.results import typed
from service.results.common import DataShown, reading
from service.results.models import positions
from service.results.models.parameters import high_leverage, rows_of, strong_correlations
from service.results.shape import document_of

IDENTIFICATION_FORMAT = "truepose-identification/1"
DIAGNOSIS_FORMAT = "truepose-diagnosis/1"
FORMAT = "truepose-sweeps/1"


def of_identification(
    dataset: Dataset,
    found: IdentificationFit,
    error_nominal: ErrorStatistics | None,
    error_identified: ErrorStatistics | None,
) -> dict[str, Any]:
    """The document of `identify --json`."""
    return {
        "format": IDENTIFICATION_FORMAT,
        "data": document_of(DataShown.of(dataset)),
        "parameters": parameters_of(found),
        **_fit_of(dataset, found),
        "correlations": [
            {"between": [a, b], "correlation": _number(r)} for a, b, r in strong_correlations(found)
        ],
        "high_leverage": [
            {"reading": reading(dataset.reading_id[row]), "leverage": _number(share)}
            for row, share in high_leverage(found)
        ],
        "predicted_u_mm": _predicted(uncertainty_map(found)),
        "error_nominal_mm": _errors(error_nominal),
        "error_identified_mm": _errors(error_identified),
        "holdout": dataset.header.holdout,
    }


def _predicted(of_map: UncertaintyMap) -> dict[str, Any]:
    """Uncertainty of predicted positions, within the measured joint ranges and outside: k = 2, and the radius that
    contains 95 %."""

    def summary(u: Array) -> dict[str, Any] | None:
        if not len(u):
            return None
        return {
            "median": _number(np.median(u)),
            "p95": _number(np.quantile(u, 0.95)),
            "max": _number(u.max()),
        }

    return {
        "coverage_factor": 2,
        "measured_ranges": summary(of_map.u[of_map.measured]),
        "outside_them": summary(of_map.u[~of_map.measured]),
        "radius_95_measured_ranges": summary(of_map.radius_95[of_map.measured]),
        "radius_95_outside_them": summary(of_map.radius_95[~of_map.measured]),
    }


def of_diagnosis(
    diagnosis: DiagnosisFit, carried: CarryOver | None = None, patched: PatchResult | None = None
) -> dict[str, Any]:
    """The document of `diagnose --json`; with `carry_over` where another data set was judged as well, with `patch`
    where a residual map was asked for."""
    other: dict[str, Any] = {} if carried is None else {"carry_over": _carried(carried)}
    if patched is not None:
        other["patch"] = _patch(patched)
    return {
        "format": DIAGNOSIS_FORMAT,
        "program": written_by(),
        "simulated": diagnosis.dataset.header.simulated,
        "verdict": diagnosis.verdict,
        "finding": wording.verdict_in_words(diagnosis),
        "effects": [_effect(found, causes_known=diagnosis.causes_known) for found in diagnosis.effects],
        **_fit_of(diagnosis.dataset, diagnosis.final),
        "p_lack_of_fit": _number(diagnosis.p_lack_of_fit),
        "error_before_mm": _errors(diagnosis.error_before),
        "error_named_mm": _errors(diagnosis.error_named),
        "error_after_mm": _errors(diagnosis.error_after),
        "error_nominal_mm": _errors(diagnosis.error_nominal),
        "raises_held_out_error": list(diagnosis.harmful),
        "held_out_misfit": _held_out_misfit(diagnosis.surprise),
        "held_out_faults": [
            {**asdict(fault), "error_mm": _number(fault.error_mm)}
            for fault in diagnosis.held_out_faults.faults
        ],
        "error_without_faults_mm": _errors(diagnosis.held_out_faults.error_without),
        "holdout": diagnosis.dataset.header.holdout,
        "follow_up": [] if diagnosis.follow_up is None else follow_up_of(diagnosis.follow_up),
        "shares": {name: _number(x) for name, x in asdict(diagnosis.shares).items()},
        "carried": [_carried_term(term) for term in diagnosis.carried],
        "withdrawn": list(diagnosis.withdrawn),
        "brought_back": [reading(name) for name in diagnosis.back],
        "held_out_agrees": diagnosis.agrees,
        "next_measurements": list(diagnosis.next_measurements),
        "structure": [
            {
                "where": s.where,
                "acts_on": s.acts_on,
                "p_value": _number(s.p_value),
                "explained_variance": _number(s.explained_variance),
            }
            for s in diagnosis.structure
        ],
        "power": [
            {"label": v.label, "smallest": None if v.size is None else _number(v.size), "unit": v.unit}
            for v in diagnosis.power
        ],
        "notes": list(diagnosis.notes),
        "parameters": parameters_of(diagnosis.final, base_model_only=True),
        "data": document_of(DataShown.of(diagnosis.dataset)),
        **other,
        "seconds": round(diagnosis.seconds, 3),
    }


def follow_up_of(follow_up: FollowUp) -> list[dict[str, Any]]:
    """The next measurements: one entry of poses, with the campaign that measures them, and one a procedure.

    joints_deg as the controller counts them; sides +1 from below, -1 from above, of every joint of a pose;
    approach_deg: how far before the pose the last move begins.
    """
    joints, robot = follow_up.joints.shape[1], next(iter(follow_up.rivals.values())).model.robot
    poses = {
        "kind": "poses",
        "joints_deg": np.round(follow_up.joints / robot.joint_units, 4).tolist(),
        "sides": [[int(side)] * joints for side in follow_up.sides],
        "approach_deg": np.round(follow_up.approach / DEG, 4).tolist(),
        "targets": list(follow_up.targets),
        "separates": [
            {"effect": label, "rival": rival, "squared_distance": _number(square)}
            for (label, rival), square in follow_up.separations.items()
        ],
        "settles": SEPARATES,
        "campaign": campaign_table(follow_up),
    }
    return [poses, *({"kind": "procedure", "text": text} for text in follow_up.procedures)]


def of_middle_step(step: FollowUpResult) -> dict[str, Any]:
    """The middle step of a closed loop: the classes that were ambiguous, and what was measured to settle them."""
    return {
        "verdict_before": step.before.verdict,
        "effects_before": [
            {
                "label": found.effect.label,
                "candidates": {label: _number(w) for label, w in found.evidence.candidates.items()},
            }
            for found in step.before.effects
        ],
        "error_before_follow_up_mm": _errors(step.before.error_after),
        "poses": len(step.poses.joints),
        "readings": step.readings,
        "separates": follow_up_of(step.poses)[0]["separates"],
    }


def _patch(patched: PatchResult) -> dict[str, Any]:
    return {
        "meaning": "A smooth map of what no named effect explains; a patch, not a cause.",
        "block_rms_without_mm": _number(patched.patch.block_rms_without),
        "block_rms_with_mm": _number(patched.patch.block_rms_with),
        "worth_it": bool(patched.patch.worth_it),
        "width": patched.patch.width,
        "ridge": patched.patch.ridge,
        "landmarks": len(patched.patch.landmarks),
        "error_without_mm": _errors(patched.without),
        "error_with_mm": _errors(patched.with_it),
    }


def _carried(carried: CarryOver) -> dict[str, Any]:
    return {
        "data": carried.name,
        "error_base_mm": _errors(carried.base),
        "error_frozen_mm": _errors(carried.frozen),
        "error_refitted_mm": _errors(carried.refitted),
        "finding": carried.finding,
    }


def parameters_of(found: IdentificationFit, *, base_model_only: bool = False) -> list[dict[str, Any]]:
    """Every parameter of a model: value (counted from where the fit began), standard error, the absolute value with its
    own, nominal value and change from it, unit, owner; null where dropped."""
    return [
        {
            "name": row.name,
            "value": None if row.estimate is None else _number(row.estimate),
            "std": None if row.std is None else _number(row.std),
            "unit": row.unit,
            "nominal": row.nominal,
            "absolute": None if row.absolute is None else _number(row.absolute),
            "absolute_std": None if row.absolute_std is None else _number(row.absolute_std),
            "change_from_nominal": None if row.change is None else _number(row.change),
            "owner": row.owner,
            "dropped": row.estimate is None,
            "confounded_with": list(row.confounded_with),
        }
        for row in rows_of(found, base_model_only=base_model_only)
    ]


def _fit_of(dataset: Dataset, found: IdentificationFit) -> dict[str, Any]:
    return {
        "faulty_rows": [reading(name) for name in found.faulty_rows],
        "left_out": [
            {
                "reading": reading(row.reading_id),
                "joints_deg": list(row.joints_deg),
                "target": row.target,
                "error_mm": _number(row.error_mm),
                "times_noise": _number(row.times_noise),
            }
            for row in left_out(dataset, found)
        ],
        "relabelled_rows": [[reading(name), was, is_] for name, was, is_ in found.relabelled_rows],
        "noise_scale": _number(found.noise_scale),
        "degrees_of_freedom": found.degrees_of_freedom,
        "reduced_chi_square": _number(found.reduced_chi_square),
        "condition_number": _number(found.condition_number),
        "config_sha256": found.config_sha256,
        "converged": bool(found.converged),
        "ending": found.ending.value,
        "offsets": positions.document_of(found),
        "dropped": [{"name": d.name, "confounded_with": list(d.confounded_with)} for d in found.dropped],
        "warnings": list(found.warnings),
        **typed.document_of(found),
    }


def _carried_term(term: CarriedTerm) -> dict[str, Any]:
    value, std, unit = term.effect.amplitude(term.values, term.covariance)
    return {
        "label": term.effect.label,
        "finding": wording.carried_in_words(term),
        "acts_on": term.place,
        "slot": term.slot,
        "where": term.condition,
        "between": None if term.between is None else [reading(name) for name in term.between],
        "amplitude": {"value": _number(value), "std": _number(std), "unit": unit},
        "explained_variance": _number(term.explained),
        "p_value": _number(term.p_value),
        "confirmed": wording.exceeds(term),
        "usable": bool(term.effect.is_usable),
    }


def _effect(found: DiagnosedEffect, *, causes_known: bool) -> dict[str, Any]:
    spread = np.sqrt(np.diag(found.covariance))
    value, std, unit = found.amplitude
    return {
        "label": found.effect.label,
        "meaning": found.effect.meaning,
        "index": None if found.index is None else reading(found.index),
        "candidates": {label: _number(w) for label, w in found.evidence.candidates.items()},
        "parameters": {
            p.short: {"value": _shown(v, p.unit), "std": _shown(s, p.unit), "unit": p.unit}
            for p, v, s in zip(found.effect.parameters, found.values, spread, strict=True)
        },
        "amplitude": {"value": _number(value), "std": _number(std), "unit": unit},
        "evidence": {
            "delta_bic": _number(found.evidence.delta_bic),
            "p_value": _number(found.evidence.p_value),
            "explained_variance": _number(found.evidence.explained_variance),
        },
        "owner": found.effect.owner,
        "group": found.effect.group,
        "check": wording.advice_on(found, causes_known=causes_known),
        "shape": {name: _number(x) for name, x in found.effect.shape.items()},
        "shape_std": {name: _number(x) for name, x in found.shape_std.items()},
        "between": None if found.between is None else [reading(name) for name in found.between],
        "usual_size": None if found.usual is None else _number(found.usual),
        "confirmed": bool(found.confirmed),
        "imitates": not causes_known,
        "impossible": bool(found.impossible),
    }


def _errors(errors: ErrorStatistics | None) -> dict[str, Any] | None:
    return None if errors is None else {name: _number(x) for name, x in asdict(errors).items()}


def _held_out_misfit(surprise: HeldOutTest | None) -> dict[str, Any] | None:
    """Held-out readings against what noise and the parameters' covariance let expect; null where none were held out."""
    if surprise is None:
        return None
    return {
        "times_expected": _number(surprise.times),
        "p_value": _number(surprise.p_value),
        "beyond": surprise.real,
    }


def _shown(value: float, unit: str) -> float | None:
    return _number(to_display(float(value), unit))


def _number(value: float) -> float | int | None:
    """JSON knows neither NaN nor infinity."""
    if isinstance(value, int):
        return value
    return float(value) if math.isfinite(value) else None


def document(dataset: Dataset, sweeps: Sequence[JointSweep], remarks: Sequence[str]) -> dict[str, Any]:
    """The document of `sweeps --json`. Uncertainties are one standard deviation."""
    return {
        "format": FORMAT,
        "data": document_of(DataShown.of(dataset)),
        "sweeps": [_sweep(sweep) for sweep in sweeps],
        "warnings": list(remarks),
    }


def _sweep(sweep: JointSweep) -> dict[str, Any]:
    axis = sweep.axis
    return {
        "joint": sweep.joint,
        "series": sweep.series,
        "target": sweep.target,
        "readings": len(sweep.angle),
        "from_deg": float(sweep.angle.min()) / DEG,
        "to_deg": float(sweep.angle.max()) / DEG,
        "radius_mm": sweep.radius,
        "error_range_deg": sweep.error_range / DEG,
        "reversal_deg": None if sweep.reversal is None else sweep.reversal / DEG,
        "u_reversal_deg": None if sweep.u_reversal is None else sweep.u_reversal / DEG,
        "axis": None
        if axis is None
        else {
            "angle_deg": axis.angle / DEG,
            "u_angle_deg": axis.u_angle / DEG,
            "distance_mm": axis.distance,
            "u_distance_mm": axis.u_distance,
        },
        "places_deg": (sweep.places / DEG).tolist(),
        "error_deg": (sweep.error / DEG).tolist(),
        "angle_deg": (sweep.angle / DEG).tolist(),
        "tangential_deg": (sweep.tangential / DEG).tolist(),
        "radial_mm": sweep.radial.tolist(),
        "upwards": sweep.upwards.tolist(),
    }


@dataclass(frozen=True)
class PatchResult:
    """A patch beside the model: never part of it, never an effect."""

    patch: Patch
    without: ErrorStatistics | None
    with_it: ErrorStatistics | None

    @classmethod
    def of(cls, diagnosis: DiagnosisFit) -> PatchResult:
        """The patch of what a diagnosis leaves."""
        dataset, final = diagnosis.dataset, diagnosis.final
        patch = patch_of(dataset, final)
        return cls(patch, error_without_patch(dataset, final), error_with_patch(dataset, final, patch))

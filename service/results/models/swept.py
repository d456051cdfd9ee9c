"""Document of `truepose sweeps`: error, reversal and axis of each joint that turned alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from calib.data import Dataset
from calib.sweeps import JointSweep
from calib.units import DEG
from service.results.common import DataShown
from service.results.shape import document_of


def document(dataset: Dataset, sweeps: Sequence[JointSweep], remarks: Sequence[str]) -> dict[str, Any]:
    """Build the document of `sweeps --json`. Uncertainties are one standard deviation."""
    return {
        "format": "truepose-sweeps/1",
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

"""Member `prior` of result documents: the share of the type in each parameter of a fit."""

from __future__ import annotations

import math
from typing import Any

from calib.fit import IdentificationFit


def document_of(found: IdentificationFit) -> dict[str, Any]:
    """Return the member `prior` of a fit that used the type of the robot, otherwise nothing."""
    beside = found.beside
    if beside is None:
        return {}
    rows = [
        {
            "name": each.name,
            "unit": beside.prior.shares[each.name].unit,
            "centre": each.centre,
            "spread": each.spread,
            "weight_of_prior": each.decided,
            "z": each.z if math.isfinite(each.z) else None,
            "used": used,
        }
        for used, those in ((True, found.weighed), (False, beside.outside))
        for each in those
    ]
    return {
        "prior": {
            "robot": beside.prior.robot,
            "robots": beside.prior.robots,
            "content_sha256": beside.prior.sha256,
            "parameters": rows,
            "outside": [each.name for each in beside.outside],
            "not_comparable": dict(beside.open),
            "chi_square": beside.chi_square,
            "degrees_of_freedom": beside.freedom,
            "p_value": beside.p_value,
            "left_out": beside.left_out,
        }
    }

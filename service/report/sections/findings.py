"""Findings for the template: text, values and pictures of every effect and structure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from calib.data import Dataset
from calib.diagnose import DetectableEffect, DiagnosedEffect, DiagnosisFit, ResidualStructure, errors_without
from calib.effects import words_of
from calib.fit import ErrorStatistics
from calib.units import to_display
from service import effect_names, wording
from service.report.figures import panels, scatter, structure
from service.report.figures.residuals import PlotSample

_LISTED = 12  # parameters of an effect
DRAWN = 12  # effects with a separate picture, strongest first; all are listed
_PLACES_DRAWN = 6  # places where structure is left, most certain first; all are listed


def structure_of(
    left: ResidualStructure, number: int, dataset: Dataset, sample: PlotSample
) -> dict[str, Any]:
    picture = structure.picture_of(left, number + 1, dataset, sample) if number < _PLACES_DRAWN else None
    return {
        "where": left.where,
        "acts_on": left.acts_on,
        "caption": wording.structure_caption(left),
        "share": wording.share_in_words(left.explained_variance),
        "p_value": left.p_value,
        "picture": None if picture is None else Markup(picture),
    }


def power_of(power: Sequence[DetectableEffect]) -> list[dict[str, Any]]:
    """Return the smallest detectable size by kind of effect, from the best joint to the worst."""
    kinds: dict[tuple[str, str], list[tuple[float, str]]] = {}
    for each in power:
        size = math.inf if each.size is None else each.size
        kinds.setdefault((each.label.partition(":")[0], each.unit), []).append((size, each.label))
    return [
        {
            "kind": kind,
            "words": words_of(min(sizes)[1]),
            "unit": unit,
            "least": _smallest(min(sizes)[0]),
            "most": _smallest(max(sizes)[0]),
        }
        for (kind, unit), sizes in kinds.items()
    ]


def _smallest(size: float) -> str:
    return wording.two_figures(size) if math.isfinite(size) else "these readings cannot show it"


def effects_of(diagnosis: DiagnosisFit, sample: PlotSample) -> list[dict[str, Any]]:
    """Return the confirmed effects, in their order."""
    effects, known = diagnosis.confirmed, diagnosis.causes_known
    without = errors_without(diagnosis.dataset, sample.fitted, [found.effect for found in effects])
    return [
        effect_of(found, sample, number, error, causes_known=known)
        for number, (found, error) in enumerate(zip(effects, without, strict=True))
    ]


def effect_of(
    found: DiagnosedEffect,
    sample: PlotSample,
    number: int,
    without: ErrorStatistics | None,
    *,
    causes_known: bool,
) -> dict[str, Any]:
    value, uncertainty, unit = wording.amplitude(found)
    picture = None
    if number < DRAWN:
        picture = Markup(scatter.effect_figure(panels.of_effect(sample, found.effect), f"effect{number + 1}"))
    return {
        "label": found.effect.label,
        "members": effect_names.members_of(found),
        "sentence": wording.sentence_of(found),
        "amplitude": value,
        "uncertainty": uncertainty,
        "unit": unit,
        "number": number + 1,
        "parts": _parts(found),
        "owner": wording.OWNERS[found.effect.owner],
        "group": found.effect.group,
        "check": wording.advice_on(found, causes_known=causes_known),
        "usual": wording.usual_size(found),
        "shape": wording.shape_of(found),
        "without": without,
        "share": found.evidence.explained_variance,
        "evidence": found.evidence,
        "rivals": wording.rivals_of(found),
        "weight": found.evidence.candidates.get(found.effect.label, 1.0),
        "displacement": sample.displacement(found.effect),
        "picture": picture,
    }


def _parts(found: DiagnosedEffect) -> str:
    """Return every parameter of an effect that has more of them than its amplitude.

    The text is empty for the waves of a curve.
    """
    if not 3 <= len(found.effect.parameters) <= _LISTED:
        return ""
    texts = []
    for i, parameter in enumerate(found.effect.parameters):
        value = to_display(float(found.values[i]), parameter.unit)
        spread = to_display(float(np.sqrt(found.covariance[i, i])), parameter.unit)
        value_text, uncertainty = wording.with_uncertainty(value, wording.COVERAGE * spread)
        texts.append(f"{parameter.short} {value_text} ± {uncertainty} {parameter.unit}".replace("-", "−"))
    return "; ".join(texts)

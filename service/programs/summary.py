"""The summary of a corrected program: a table for people, a document for programs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
from rich import box
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from calib.compensate import Usable
from calib.units import DEG
from service import wording
from service.programs.compensation import CORRECTED, EMPTY, REFUSED, Compensation, TargetOutcome

FORMAT = "truepose-compensation/1"
_SHOWN = 40  # targets on a terminal; the JSON holds all


def document(done: Compensation) -> dict[str, Any]:
    """Counts, largest figures, and every target."""
    corrected = done.of(CORRECTED)
    return {
        "corrected": len(corrected),
        "refused": len(done.of(REFUSED)),
        "empty": len(done.of(EMPTY)),
        "largest_move_mm": _largest([o.moved[0] for o in corrected]),
        "largest_quantisation_mm": _largest([o.quantised[0] for o in corrected]),
        "targets": [
            {
                "target": o.target.name,
                "line": o.target.line,
                "kind": o.target.kind,
                "status": o.status,
                "reason": o.why or None,
                "moved_mm": _number(o.moved[0]),
                "moved_deg": _number(o.moved[1] / DEG),
                "largest_joint_change_deg": _number(o.turned / DEG),
                "largest_slide_change_mm": _number(o.slid),
                "quantised_mm": _number(o.quantised[0]),
                "quantised_deg": _number(o.quantised[1] / DEG),
                "outside_measured_range": list(o.beyond),
                "radius_95_mm": _number(o.radius_95),
                "notes": _notes(o),
            }
            for o in done.outcomes
        ],
    }


def of_carried(usable: Usable) -> dict[str, Any]:
    """The carried terms that a correction leaves out, and what that costs."""
    return {
        "carried_left_out": [effect.label for effect in usable.left_out],
        "carried_loss_mm": None if usable.loss is None else asdict(usable.loss),
    }


def _notes(outcome: TargetOutcome) -> list[str]:
    return [*outcome.target.notes, *([outcome.left] if outcome.left else [])]


def shown(done: Compensation) -> Iterator[RenderableType]:
    """Every target with its move and its rounding; what was refused comes first and whole."""
    for outcome in done.of(REFUSED):
        yield Text(f"{refusal(outcome)}.")
    table = Table(
        title="Targets", title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False
    )
    listed = [o for o in done.outcomes if o.status != REFUSED]
    slides = any(math.isfinite(o.slid) for o in listed)
    joints = ("joints deg", "slides mm") if slides else ("joints deg",)
    heads = ("target", "line", "moved mm", "moved deg", *joints, "rounded mm", "95 % within mm", "")
    for name in heads:
        table.add_column(name, justify="left" if name in ("target", "") else "right", overflow="fold")
    for o in listed[:_SHOWN]:
        if o.status == EMPTY:
            figures = ["-"] * (len(heads) - 3)
        else:
            figures = [
                f"{o.moved[0]:.3f}",
                f"{o.moved[1] / DEG:.3f}",
                f"{o.turned / DEG:.3f}",
                *([f"{o.slid:.3f}"] if slides else []),
                f"{o.quantised[0]:.5f}",
                f"{o.radius_95:.3f}",
            ]
        table.add_row(o.target.name, str(o.target.line), *figures, "; ".join(_notes(o)))
    if listed:
        yield table
    if len(listed) > _SHOWN:
        yield Text(f"... and {len(listed) - _SHOWN} more; --json lists all.")


def refusal(outcome: TargetOutcome) -> str:
    """A refused target as a sentence without its full stop."""
    return f"line {outcome.target.line}, target '{outcome.target.name}': {outcome.why}"


def in_words(done: Compensation) -> str:
    """One line for people."""
    corrected, empty = done.of(CORRECTED), done.of(EMPTY)
    parts = [f"{wording.counted(len(corrected), 'target')} corrected"]
    if corrected:
        parts.append(
            f"moved by {np.max([o.moved[0] for o in corrected]):.3f} mm at most, "
            f"rounded by {np.max([o.quantised[0] for o in corrected]):.5f} mm at most"
        )
    if empty:
        parts.append(f"{len(empty)} never taught")
    return ", ".join(parts)


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _largest(values: list[float]) -> float | None:
    return _number(max(values)) if values else None

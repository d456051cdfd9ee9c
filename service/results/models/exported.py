"""Content, losses and remaining error of every format of `truepose export`.

They are known before a format is chosen.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from service.results.common import ErrorStatisticsResponse
from service.results.shape import Real, ResponseBody, told

_NAMED = 6  # parameters named in one line; the document names all


def few(names: Sequence[str]) -> str:
    """List the first parameters of many, and count the others."""
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")


class ExportChoice(ResponseBody):
    """A format of an export, with the error that its file leaves."""

    kind: Annotated[str, told("Name of the format.", "urdf")]
    carries: Annotated[str, told("What the format carries.", "all frames between base and flange")]
    left_out: Annotated[list[str], told("Parameters that it cannot carry.", ["c2"])]
    left_mm: Annotated[
        Real,
        told(
            "Error that remains, RMS, mm: that of the file and the model's own on readings held out, or, without "
            "those, that of the robot at new poses (`verified_rms_mm`); null: neither is known, or the format does not "
            "suit.",
            0.96,
        ),
    ]
    loss_mm: Annotated[
        ErrorStatisticsResponse | None,
        told("The file, read back, against the whole model, mm; null: the format does not suit.", None),
    ]
    refused: Annotated[str | None, told("Why the model cannot be written in it.", None)] = None

    @property
    def lost(self) -> str:
        """Lost content, for a table."""
        return few(self.left_out) or "nothing"


class ExportChoices(ResponseBody):
    """Every format of a model's export (`truepose-model-exports/1`)."""

    format: Annotated[Literal["truepose-model-exports/1"], told("The format.", "truepose-model-exports/1")]
    model: Annotated[str, told("The id of the model.", "20261121-170459-3f9a1c07b2e")]
    robot: Annotated[str, told("The robot file's name.", "abb-irb120")]
    simulated: Annotated[bool, told("Whether the model was identified from simulators.", False)]
    held_out_rms_mm: Annotated[
        float | None, told("The model's own error on readings held out, RMS, mm.", 0.04)
    ]
    verified_rms_mm: Annotated[
        float | None,
        told("The robot at new poses, driven with the whole correction, RMS, mm; null: not verified.", 0.045),
    ] = None
    holds_for: Annotated[str, told("The conditions for which the numbers hold.", "approach from below")]
    judged_at: Annotated[str, told("The poses of the losses.", "random poses within the joint limits")]
    exports: Annotated[list[ExportChoice], told("The formats.", [])]

    @property
    def written(self) -> list[ExportChoice]:
        """The formats that suit the model."""
        return [each for each in self.exports if each.refused is None]

    @property
    def refusals(self) -> list[str]:
        """The other formats with the reason, those with the same one in one line."""
        kinds: dict[str, list[str]] = {}
        for each in self.exports:
            if each.refused is not None:
                kinds.setdefault(each.refused, []).append(each.kind)
        return [f"Not {', '.join(names)}: {reason}" for reason, names in kinds.items()]

"""The body of a model in another program's format (`truepose-model-export/1`)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from service.http.wire.bodies.results import ERRORS, Errors
from service.http.wire.bodies.targets import CarriedLeftOut, CarriedLoss, StatedConditions
from service.http.wire.bodies.told import Answered, told

ExportKind = Literal["ur-yaml", "urdf", "dh-csv", "dh-md", "mastering"]


class ModelExport(Answered):
    """The file's text, and what this format leaves out."""

    format: Annotated[Literal["truepose-model-export/1"], told("The format.", "truepose-model-export/1")]
    model: Annotated[str, told("The id of the model.", "20261121-170459-3f9a1c07b2e")]
    robot: Annotated[str, told("The robot file's name.", "abb-irb120")]
    kind: Annotated[ExportKind, told("As what it is written.", "urdf", alias="as")]
    text: Annotated[str, told("The whole text of the file.", "<?xml ...")]
    carries: Annotated[str, told("What the format carries.", "joint origins")]
    left_out: Annotated[list[str], told("Parameters that it cannot carry.", ["compliance:j2"])]
    conditions: Annotated[StatedConditions, told("For which it holds.", {"approach_deg": 5.0})]
    loss_mm: Annotated[
        Errors, told("The file, read back, against the whole model, at random poses, mm.", ERRORS)
    ]
    nominal_mm: Annotated[Errors, told("The nominal robot against the whole model, mm.", ERRORS)]
    held_out_rms_mm: Annotated[
        float | None, told("The model's own error on readings held out, RMS, mm.", 0.04)
    ]
    predicted_rms_mm: Annotated[float | None, told("Both together, RMS, mm.", 0.05)]
    carried_left_out: CarriedLeftOut = Field(default_factory=list)
    carried_loss_mm: CarriedLoss = None
    about: Annotated[list[str], told("The same in sentences.", [])]
    warnings: Annotated[list[str], told("What keeps it from meaning what it seems to.", [])]

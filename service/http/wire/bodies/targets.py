"""The bodies of targets and programs that are corrected with a model.

The body of a model in another program's format (`truepose-model-export/1`).
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from service.http.wire.bodies.fields import ResponseBody, told
from service.results.common import ERRORS, ErrorStatisticsResponse
from service.results.shape import DescribedAs

Millimetres = Annotated[float | None, told("A length, mm; null where it is not known.", 0.412)]
Degrees = Annotated[float | None, told("An angle, deg; null where it is not known.", 0.031)]
_Angle = Annotated[float, told("A joint angle as the controller counts it, deg.", 12.0)]
_Place = Annotated[float, told("A coordinate of the tool point in the base frame, mm.", 401.2)]
_Turn = Annotated[float, told("A part of the unit quaternion, w first; no unit.", 0.7071068)]


class TargetRow(TypedDict):
    """One target: joint angles `j1_deg` ..., or a pose with its `config`. Other members are kept as they are."""

    target_id: Annotated[str, told("Its name, each once.", "A")]
    j1_deg: NotRequired[_Angle]
    j2_deg: NotRequired[_Angle]
    j3_deg: NotRequired[_Angle]
    j4_deg: NotRequired[_Angle]
    j5_deg: NotRequired[_Angle]
    j6_deg: NotRequired[_Angle]
    x_mm: NotRequired[_Place]
    y_mm: NotRequired[_Place]
    z_mm: NotRequired[_Place]
    rot_w: NotRequired[_Turn]
    rot_x: NotRequired[_Turn]
    rot_y: NotRequired[_Turn]
    rot_z: NotRequired[_Turn]
    config: NotRequired[Annotated[str, told("The branch that a pose is meant in.", "front/up/noflip")]]


class StatedConditionsBody(ResponseBody):
    """The conditions for which a correction or an export holds."""

    side_of_model_joints: Annotated[
        list[int],
        told("From which side each joint of the model arrives, +1 from below; no unit.", [1, 1, 1, 1, 1, 1]),
    ]
    approach_deg: Annotated[float, told("How far before the target the last move begins, deg.", 5.0)]
    temperature_c: Annotated[float | None, told("The air, degC.", 22.1)]
    time_s: Annotated[float | None, told("Since the start of the campaign, s.", 3600.0)]
    mass_kg: Annotated[float | None, told("The tool on the last link, kg; null: the load of the data.", 2.7)]
    series: Annotated[str | None, told("The set-up of base and tool.", "main")]
    absolute_accuracy: Annotated[str, told("The controller's own correction: on, off or unknown.", "off")] = (
        "unknown"
    )


class TargetDone(ResponseBody):
    """The correction of one target."""

    target: Annotated[str, told("Its name.", "A")]
    line: Annotated[int, told("Its line in the program, a number from 1.", 2)]
    kind: Annotated[str, told("The kind of target, as the program has it.", "joints")]
    status: Annotated[
        Literal["corrected", "refused", "empty"],
        told("`refused`: it stays as it was; `empty`: never taught.", "corrected"),
    ]
    reason: Annotated[str | None, told("Why it was refused.", None)]
    moved_mm: Millimetres
    moved_deg: Degrees
    largest_joint_change_deg: Degrees
    largest_slide_change_mm: Annotated[
        float | None, told("The largest change of a joint that slides, mm; null: none does.", None)
    ]
    quantised_mm: Annotated[float | None, told("What the program's digits round away, mm.", 0.0004)]
    quantised_deg: Annotated[float | None, told("What the program's digits round away, deg.", 0.00003)]
    outside_measured_range: Annotated[
        list[str],
        told(
            "Joints and other quantities outside the range of the readings, where carried terms are held.",
            ["joint 3"],
        ),
    ] = Field(default_factory=list)
    radius_95_mm: Annotated[
        float | None,
        told(
            "Radius that contains 95 % of the positions that the model allows, mm; null: not corrected.", 0.08
        ),
    ] = None
    notes: Annotated[list[str], told("What else is to be known.", [])]


CarriedLeftOut = Annotated[
    list[str], told("Carried terms that the correction leaves out, by label.", ["carried:d5:time:1"])
]

CarriedLoss = Annotated[
    ErrorStatisticsResponse | None,
    told(
        "How far they move the tool, at random poses and times of the campaign, mm; null: none left out.",
        None,
    ),
]


class CorrectionResponse(ResponseBody):
    """The correction of the targets (`truepose-compensation/1`)."""

    format: Annotated[Literal["truepose-compensation/1"], told("The format.", "truepose-compensation/1")]
    model: Annotated[str, told("The id of the model.", "20261121-170459-3f9a1c07b2e")]
    robot: Annotated[str, told("The robot file's name.", "abb-irb120")]
    direction: Annotated[
        Literal["nominal to actual", "actual to nominal"], told("The direction.", "nominal to actual")
    ]
    conditions: Annotated[StatedConditionsBody, told("For which it holds.", {"approach_deg": 5.0})]
    corrected: Annotated[int, told("Number of targets that were corrected.", 12)]
    refused: Annotated[int, told("Number of targets that stay as they were.", 0)]
    empty: Annotated[int, told("Number of targets that were never taught.", 0)]
    largest_move_mm: Millimetres
    largest_quantisation_mm: Millimetres
    carried_left_out: CarriedLeftOut = Field(default_factory=list)
    carried_loss_mm: CarriedLoss = None
    targets: Annotated[list[TargetDone], told("Every target.", [])]
    warnings: Annotated[list[str], told("What keeps the correction from meaning what it seems to.", [])]


class CorrectedTargets(CorrectionResponse):
    """Corrected targets, as `csv` and as `rows`, and what became of each."""

    csv: Annotated[str, told("The table as text.", "target_id,j1_deg\nA,10.012\n")]
    rows: Annotated[
        list[Annotated[dict[str, Any], DescribedAs(TargetRow)]],
        told("The table as rows, numbers as they are written.", [{"target_id": "A", "j1_deg": 10.012}]),
    ]


class CorrectedProgram(CorrectionResponse):
    """A corrected program, and what became of each of its targets."""

    name: Annotated[str, told("The name of the program that was sent.", "WELD.mod")]
    program_base64: Annotated[
        str, told("The whole corrected program, byte for byte as base64.", "TU9EVUxFIFdFTEQK")
    ]


ExportKind = Literal[
    "ur-yaml",
    "urdf",
    "dh-csv",
    "dh-md",
    "mastering",
    "abb-frames",
    "fanuc-frames",
    "kuka-frames",
    "ur-frames",
    "yaskawa-frames",
    "abb-offsets",
    "fanuc-offsets",
    "kuka-offsets",
    "ur-offsets",
    "yaskawa-offsets",
    "ur-calibration",
]


class ModelExport(ResponseBody):
    """The file's text, and what this format leaves out."""

    format: Annotated[Literal["truepose-model-export/1"], told("The format.", "truepose-model-export/1")]
    model: Annotated[str, told("The id of the model.", "20261121-170459-3f9a1c07b2e")]
    robot: Annotated[str, told("The robot file's name.", "abb-irb120")]
    kind: Annotated[ExportKind, told("As what it is written.", "urdf", alias="as")]
    text: Annotated[str, told("The whole text of the file.", "<?xml ...")]
    carries: Annotated[str, told("What the format carries.", "joint origins")]
    left_out: Annotated[list[str], told("Parameters that it cannot carry.", ["compliance:j2"])]
    conditions: Annotated[StatedConditionsBody, told("For which it holds.", {"approach_deg": 5.0})]
    loss_mm: Annotated[
        ErrorStatisticsResponse,
        told("The file, read back, against the whole model, at random poses, mm.", ERRORS),
    ]
    nominal_mm: Annotated[
        ErrorStatisticsResponse, told("The nominal robot against the whole model, mm.", ERRORS)
    ]
    held_out_rms_mm: Annotated[
        float | None, told("The model's own error on readings held out, RMS, mm.", 0.04)
    ]
    verified_rms_mm: Annotated[
        float | None,
        told("The robot at new poses, driven with the whole correction, RMS, mm; null: not verified.", 0.045),
    ] = None
    predicted_rms_mm: Annotated[
        float | None,
        told(
            "The loss together with `held_out_rms_mm`, or, where that is null, with `verified_rms_mm`, RMS, mm.",
            0.05,
        ),
    ]
    carried_left_out: CarriedLeftOut = Field(default_factory=list)
    carried_loss_mm: CarriedLoss = None
    about: Annotated[list[str], told("The same in sentences.", [])]
    warnings: Annotated[list[str], told("What keeps it from meaning what it seems to.", [])]

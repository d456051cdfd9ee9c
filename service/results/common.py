"""Parts that results share, and the body of a model file (`truepose-model/1`, `--model`)."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, SkipValidation

from acquisition import CampaignTable
from calib.data import Dataset
from calib.fit import IdentificationFit, TargetOffset, left_out, offsets_of
from service.results.judgement.acceptance import AcceptanceShown
from service.results.shape import DescribedAs, Real, ResponseBody, told
from service.results.typed import TypeAgreementResponse

_SHA = "a93c6fe109b1ae117f0e7f2bb0621db385ac9f84da4fc45fa30a1e73de499bda"
ERRORS = {"n": 120, "rms": 0.04, "mean": 0.036, "p95": 0.067, "max": 0.09}

Campaign = Annotated[dict[str, Any], DescribedAs(CampaignTable)]
"""What `campaign.toml` holds, as JSON; `acquisition.campaign` describes and reads it."""

Joints = Annotated[
    list[float],
    told("Joint angles as the controller counts them, deg.", [12.0, 45.0, -10.0, 80.0, -35.0, 10.0]),
]

Warnings = Annotated[
    list[str], told("What keeps the figures from meaning what they seem to, in sentences.", [])
]

Share = Annotated[Real, told("A share from 0 to 1, no unit.", 0.97)]
Number = Annotated[Real, told("A number without a unit; null: not known.", 1.02)]
Unit = Annotated[str, told("The unit of value and std.", "deg")]


def reading(name: int | str) -> int | str:
    """Convert a reading id to the type that the data set uses: a whole number, or text."""
    text = str(name)
    return int(text) if text.isascii() and text.isdigit() and str(int(text)) == text else name


ReadingId = Annotated[int | str, BeforeValidator(reading)]
Reading = Annotated[
    ReadingId, told("The id of a reading, a number or text as in the data set.", 17, of="reading_id")
]


class ErrorStatisticsResponse(ResponseBody):
    """Errors of n readings, mm."""

    n: Annotated[int, told("Number of readings.", 120)]
    rms: Annotated[Real, told("Root mean square, mm.", 0.04)]
    mean: Annotated[Real, told("Mean, mm.", 0.036)]
    p95: Annotated[Real, told("95 % of them are less, mm.", 0.067)]
    max: Annotated[Real, told("The largest, mm.", 0.09)]


class DeviceResponse(ResponseBody):
    """A device that the readings come from."""

    role: Annotated[str, told("robot or instrument.", "robot")] = ""
    model: Annotated[str, told("Its type.", "IRB 120")] = ""
    serial: Annotated[str, told("Its serial number.", "120-500321")] = ""
    firmware: Annotated[str, told("Its firmware.", "5.61")] = ""


class MeasuredPeriod(ResponseBody):
    """Times of the first and the last reading, as text."""

    began: Annotated[str, told("The first.", "2026-03-02 09:15 UTC")]
    ended: Annotated[str, told("The last.", "2026-03-02 11:40 UTC")]


class DataShown(ResponseBody):
    """The readings that a result is based on."""

    name: Annotated[str, told("The name of the table.", "data.csv")]
    sha256: Annotated[str, told("Hash of table and header.", _SHA)]
    robot: Annotated[str, told("The robot file's name.", "abb-irb120")]
    instrument: Annotated[str, told("The instrument.", "faro-ion")]
    simulated: Annotated[bool, told("Whether simulators were measured.", False)]
    readings: Annotated[int, told("Number of readings.", 300)]
    fit: Annotated[int, told("Number of readings that took part in the fit.", 180)]
    validation: Annotated[int, told("Number of readings that only judge.", 120)]
    devices: Annotated[
        list[DeviceResponse], told("Robot and instrument, as far as they said who they are.", [])
    ] = Field(default_factory=list)
    measured: Annotated[
        MeasuredPeriod | None, told("When they were made; left out where nobody knows.", None)
    ] = None

    @classmethod
    def of(cls, dataset: Dataset) -> Self:
        """Describe a data set for a result."""
        header, known = dataset.header, {}
        if header.devices:
            known["devices"] = [dict(each) for each in header.devices]
        if header.occasion is not None:
            known["measured"] = header.occasion
        return cls(
            name=dataset.name,
            sha256=dataset.sha256,
            robot=header.robot.name,
            instrument=header.instrument,
            simulated=header.simulated,
            readings=len(dataset),
            fit=int(dataset.fit_rows.sum()),
            validation=int(dataset.validation_rows.sum()),
            **known,
        )


class Figure(ResponseBody):
    """A value with its standard error."""

    value: Annotated[Real, told("The value, in `unit`.", 0.131)]
    std: Annotated[Real, told("Its standard error, in `unit`.", 0.002)]
    unit: Unit

    @classmethod
    def of(cls, value: float, std: float, unit: str) -> Self:
        """Create the figure from a value, its standard error and its unit."""
        return cls(value=value, std=std, unit=unit)


class ParameterResponse(Figure):
    """A parameter of a model.

    `value` and `std` count from the start value of the fit, for a link from nominal.
    """

    name: Annotated[str, told("Its name.", "theta2")]
    nominal: Annotated[
        Real,
        told("Nominal value by robot file or header, in `unit`; null where there is none.", -90.0),
    ]
    absolute: Annotated[
        Real, told("The value itself, in `unit`; of a base its pose, turns about x, y, z.", -90.1)
    ] = None
    absolute_std: Annotated[Real, told("Its standard error, in `unit`.", 0.002)] = None
    change_from_nominal: Annotated[
        Real, told("Absolute less nominal, in `unit`; null where there is no nominal value.", -0.1)
    ] = None
    owner: Annotated[str, told("To whom it belongs: robot, mounting, tool, instrument ...", "robot")]
    dropped: Annotated[bool, told("These readings do not determine it.", False)] = False
    confounded_with: Annotated[list[str], told("Names of what it cannot be distinguished from.", [])] = Field(
        default_factory=list
    )


class DroppedParameterResponse(ResponseBody):
    """A parameter that the readings do not determine."""

    name: Annotated[str, told("Its name.", "d3")]
    confounded_with: Annotated[list[str], told("Names of what it cannot be distinguished from.", ["d2"])]


class LeftOutResponse(ResponseBody):
    """A reading that took no part in the fit."""

    reading: Reading
    joints_deg: Annotated[list[float], told("The joints as the controller counts them, deg.", [12.0, 45.0])]
    target: Annotated[str, told("The target.", "T1")]
    error_mm: Annotated[Real, told("Its error, mm.", 1.9)]
    times_noise: Annotated[Real, told("Its error as a number of times the declared noise.", 44.0)]


class TargetOffsetResponse(ResponseBody):
    """A target that is not at its stated position."""

    name: Annotated[str, told("The target.", "N1")]
    kind: Annotated[str, told("base target or tool target.", "base target")]
    u_mm: Annotated[float, told("Stated standard uncertainty per axis, mm.", 0.3)]
    offset_mm: Annotated[list[float], told("Where it lies against the stated place, mm.", [0.1, 0.0, -0.2])]
    std_mm: Annotated[list[float], told("Standard errors of that, mm.", [0.01, 0.01, 0.01])]
    distance_mm: Annotated[Real, told("Its length, mm.", 0.22)]
    sigma: Number
    doubted: Annotated[bool, told("It should be measured anew.", False)]
    rivals: Annotated[list[str], told("Names of what it cannot be distinguished from.", [])]

    @classmethod
    def of(cls, found: TargetOffset) -> Self:
        """Describe the offset of a target that a fit found."""
        return cls(
            name=found.name,
            kind=found.kind,
            u_mm=found.u_mm,
            offset_mm=list(found.offset_mm),
            std_mm=list(found.std_mm),
            **asdict(found.judged),
        )


class FitShown(ResponseBody):
    data: Annotated[DataShown, told("The readings.", {"readings": 300})]
    faulty_rows: Annotated[list[ReadingId], told("Ids of readings that do not belong.", [])]
    left_out: Annotated[list[LeftOutResponse], told("Readings that took no part.", [])]
    relabelled_rows: Annotated[
        list[list[int | str]], told("Reading, target as labelled, target as believed.", [[17, "T1", "T2"]])
    ]
    noise_scale: Annotated[Real, told("Number of times the declared noise that is left.", 0.99)]
    degrees_of_freedom: Annotated[
        float, SkipValidation, told("Number of observations less that of parameters.", 149.0)
    ]
    reduced_chi_square: Number
    condition_number: Number
    config_sha256: Annotated[str, told("Hash of model and options.", _SHA)]
    converged: Annotated[bool, told("Whether the fit ended well.", True)]
    ending: Annotated[
        Literal["converged", "round limit", "no descent"], told("Why the fit ended.", "converged")
    ]
    offsets: Annotated[list[TargetOffsetResponse], told("Targets that lie elsewhere than stated.", [])]
    dropped: Annotated[
        list[DroppedParameterResponse], told("Parameters that the readings do not determine.", [])
    ]
    warnings: Warnings
    holdout: Annotated[str, told("How readings were held out.", "random")]
    error_nominal_mm: Annotated[
        ErrorStatisticsResponse | None,
        told("Of the nominal robot, placed, on readings held out, mm.", ERRORS),
    ]
    acceptance: Annotated[AcceptanceShown | None, told("Where limits were given.", None)] = None
    prior: Annotated[
        TypeAgreementResponse | None, told("The robot compared with its type, if that was given.", None)
    ] = None

    @staticmethod
    def fit_members(dataset: Dataset, found: IdentificationFit) -> dict[str, Any]:
        """Return the members that depend only on the fit, in the order of the document.

        `prior` is included if the fit used the type of the robot.
        """
        same = (
            "noise_scale",
            "degrees_of_freedom",
            "reduced_chi_square",
            "condition_number",
            "config_sha256",
        )
        of_type = TypeAgreementResponse.of(found)
        return {
            "faulty_rows": found.faulty_rows,
            "left_out": left_out(dataset, found),
            "relabelled_rows": [[reading(name), was, is_] for name, was, is_ in found.relabelled_rows],
            **{name: getattr(found, name) for name in same},
            "converged": bool(found.converged),
            "ending": found.ending.value,
            "offsets": [TargetOffsetResponse.of(each) for each in offsets_of(found)],
            "dropped": found.dropped,
            "warnings": found.warnings,
            **({} if of_type is None else {"prior": of_type}),
        }


class LoadShown(ResponseBody):
    """A mass on the arm."""

    link: Annotated[int, told("Number of the link that bears it.", 6)]
    mass_kg: Annotated[float, told("Its mass, kg.", 2.7)]
    cog_mm: Annotated[list[float], told("Its centre in the frame of the link, mm.", [0.0, 0.0, 60.0])]


class RobotTable(ResponseBody):
    """The nominal robot: its DH table and limits."""

    name: Annotated[str, told("The robot file's name.", "abb-irb120")]
    maker: Annotated[str, told("Who makes it.", "ABB")]
    convention: Annotated[str, told("The convention of the table.", "mdh")]
    alpha: Annotated[list[float], told("Twists, rad.", [0.0, -1.5707963])]
    a: Annotated[list[float], told("Lengths of links, mm.", [0.0, 270.0])]
    theta: Annotated[list[float], told("Joint offsets, rad.", [0.0, -1.5707963])]
    d: Annotated[list[float], told("Offsets along the axes, mm.", [290.0, 0.0])]
    lower: Annotated[list[float], told("Lower joint limits, rad.", [-2.88, -1.92])]
    upper: Annotated[list[float], told("Upper joint limits, rad.", [2.88, 1.92])]


class ModelEffect(ResponseBody):
    """An effect of a model. Its terms state on which slots of the chain it acts."""

    label: Annotated[str, told("Its label.", "backlash:j4")]
    group: Annotated[str, told("The family of effects.", "transmission")]
    owner: Annotated[str, told("To whom it belongs.", "robot")]
    meaning: Annotated[str, told("What it means, for people.", "Joint 4 has play.")]


class HoldsFor(ResponseBody):
    """The conditions at which a model was identified."""

    approach: Annotated[list[str], told("The side of approach of each joint.", ["both sides", "from below"])]
    temperature_c: Annotated[float | None, told("The mean of the air, degC.", 22.1)]
    absolute_accuracy: Annotated[
        str, told("Whether the controller corrected by its maker's calibration: on, off or unknown.", "off")
    ] = "unknown"
    joints: Annotated[
        list[list[float]] | None,
        told("The range of each joint, deg or mm, as the controller counts.", [[-90.0, 90.0]]),
    ] = None


class HoldOutErrorsResponse(ResponseBody):
    """The error on held-out readings."""

    kind: Annotated[str, told("How readings were held out.", "random")]
    error_mm: Annotated[ErrorStatisticsResponse, told("The error, mm.", ERRORS)]


class ModelShown(ResponseBody):
    """A model. Further members are only for the program that wrote it."""

    format: Annotated[
        Literal["truepose-model/1", "truepose-model/2"],
        told("The format; /2 holds carried terms.", "truepose-model/1"),
    ]
    robot: Annotated[str, told("The robot file's name.", "abb-irb120")]
    robot_table: Annotated[RobotTable, told("The nominal robot.", {"name": "abb-irb120"})]
    robot_sha256: Annotated[str, told("Hash of the robot.", "2cb1834862e993f8")]
    loads: Annotated[list[LoadShown], told("Masses on the arm.", [])]
    gravity_base: Annotated[list[float], told("Gravity in the base frame, m/s2.", [0.0, 0.0, -9.81])]
    joint_coupling: Annotated[str, told("How the controller counts coupled joints.", "none")]
    groups: Annotated[list[str], told("Labels of the base model.", ["base", "geometry"])]
    parameters: Annotated[list[ParameterResponse], told("Every parameter.", [])]
    effects: Annotated[list[ModelEffect], told("Every effect.", [])]
    covariance_internal_units: Annotated[
        list[list[float]], told("Lower triangle of the covariance, in mm and rad.", [[1.4e-05]])
    ]
    tool_targets_mm: Annotated[
        dict[str, dict[str, list[float]]],
        told("Targets on the flange by series and name, mm.", {"main": {"T1": [0.0, 0.0, 125.0]}}),
    ]
    base_targets_mm: Annotated[
        dict[str, list[float]], told("Targets on the base by name, mm.", {"N1": [0.0, 0.0, 0.0]})
    ]
    station_mm: Annotated[list[float], told("Where the instrument stood, mm.", [2400.0, -900.0, 350.0])]
    data_sha256: Annotated[str, told("Hash of the readings.", "a93c6fe109b1ae11")]
    simulated: Annotated[bool, told("Whether the readings came from simulators.", True)] = False
    holds_for: Annotated[HoldsFor, told("At which conditions it was identified.", {"temperature_c": 22.1})]
    held_out: Annotated[HoldOutErrorsResponse | None, told("Its error on readings held out.", None)]
    noise_scale: Annotated[float, told("Number of times the declared noise that is left.", 0.99)]
    content_sha256: Annotated[
        str, told("Hash of all the rest: a change by hand is noticed.", "22aa677ddb782e9a")
    ]

"""The body of a model, as `--model` of the command line writes it (`truepose-model/1`)."""

from __future__ import annotations

from typing import Annotated, Literal

from service.http.wire.bodies.results import ERRORS, Errors, Parameter
from service.http.wire.bodies.told import Answered, told


class LoadShown(Answered):
    """A mass on the arm."""

    link: Annotated[int, told("Number of the link that bears it.", 6)]
    mass_kg: Annotated[float, told("Its mass, kg.", 2.7)]
    cog_mm: Annotated[list[float], told("Its centre in the frame of the link, mm.", [0.0, 0.0, 60.0])]


class RobotTable(Answered):
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


class ModelEffect(Answered):
    """An effect of a model; its terms say on which slots of the chain it acts."""

    label: Annotated[str, told("Its label.", "backlash:j4")]
    group: Annotated[str, told("The family of effects.", "transmission")]
    owner: Annotated[str, told("To whom it belongs.", "robot")]
    meaning: Annotated[str, told("What it means, for people.", "Joint 4 has play.")]


class HoldsFor(Answered):
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


class HeldOut(Answered):
    """The error on readings held out."""

    kind: Annotated[str, told("How readings were held out.", "random")]
    error_mm: Annotated[Errors, told("The error, mm.", ERRORS)]


class ModelShown(Answered):
    """A model: what it holds beside these members is for the program that wrote it."""

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
    parameters: Annotated[list[Parameter], told("Every parameter.", [])]
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
    held_out: Annotated[HeldOut | None, told("Its error on readings held out.", None)]
    noise_scale: Annotated[float, told("Number of times the declared noise that is left.", 0.99)]
    content_sha256: Annotated[
        str, told("Hash of all the rest: a change by hand is noticed.", "22aa677ddb782e9a")
    ]

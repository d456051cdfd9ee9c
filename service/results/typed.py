"""Results about the type of a robot.

These are the agreement of a fit with it, and the statistics of a type (`truepose-prior/1`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Self

from service.results.shape import Real, ResponseBody, told

if TYPE_CHECKING:
    from calib.fit import IdentificationFit

_NAMED = Annotated[str, told("Name of the parameter.", "theta2")]
_UNIT = Annotated[str, told("The unit of the parameter.", "deg")]
_SHA = Annotated[str, told("Hash of the content.", "22aa677ddb782e9a")]


class TypeWeightResponse(ResponseBody):
    """The weight of the type's statistics in a parameter of a fit."""

    name: _NAMED
    unit: _UNIT
    centre: Annotated[float, told("Mean of the type, in `unit`.", 0.137)]
    spread: Annotated[float, told("Standard deviation of a further robot of the type, in `unit`.", 0.06)]
    weight_of_prior: Annotated[float, told("Share of it that the type decides, 0 to 1.", 0.16)]
    z: Annotated[Real, told("Number of spreads from the mean; null if the readings do not show it.", 1.0)]
    used: Annotated[
        bool, told("False: the robot lies outside its type here, and the type was not used.", True)
    ]


class TypeAgreementResponse(ResponseBody):
    """A fit that used the statistics of the robot's type, compared with them."""

    robot: Annotated[str, told("The type: the robot file's name.", "abb-irb120")]
    robots: Annotated[int, told("Number of robots that the statistics are of.", 8)]
    content_sha256: _SHA
    parameters: Annotated[list[TypeWeightResponse], told("Every parameter that the type knows.", [])]
    outside: Annotated[list[str], told("Names of those in which the robot lies outside its type.", [])]
    not_comparable: Annotated[
        dict[str, str], told("Why the type says nothing of a parameter, by its name.", {})
    ]
    chi_square: Annotated[float, told("Squared distance of the robot from its type, no unit.", 21.0)]
    degrees_of_freedom: Annotated[int, told("Number of directions of which it is the sum.", 25)]
    p_value: Annotated[float, told("Probability of a larger distance for a robot of the type.", 0.68)]
    left_out: Annotated[bool, told("Whether the robot lies outside as a whole, and no type was used.", False)]

    @classmethod
    def of(cls, found: IdentificationFit) -> Self | None:
        """Compare a fit with its type; None if it used none."""
        beside = found.beside
        if beside is None:
            return None
        prior = beside.prior
        return cls(
            robot=prior.robot,
            robots=prior.robots,
            content_sha256=prior.sha256,
            parameters=[
                TypeWeightResponse(
                    name=each.name,
                    unit=prior.shares[each.name].unit,
                    centre=each.centre,
                    spread=each.spread,
                    weight_of_prior=each.decided,
                    z=each.z,
                    used=used,
                )
                for used, those in ((True, found.weighed), (False, beside.outside))
                for each in those
            ],
            outside=[each.name for each in beside.outside],
            not_comparable=dict(beside.open),
            chi_square=beside.chi_square,
            degrees_of_freedom=beside.freedom,
            p_value=beside.p_value,
            left_out=beside.left_out,
        )


class TypeModelResponse(ResponseBody):
    """A model file that the statistics were learned from."""

    name: Annotated[str, told("Name of the file.", "0.json")]
    content_sha256: _SHA


class LearnedParameterResponse(ResponseBody):
    """A parameter over the robots of a type; std is a standard uncertainty."""

    name: _NAMED
    unit: _UNIT
    mean: Annotated[float, told("Mean, in `unit`.", 0.137)]
    mean_std: Annotated[float, told("Its standard uncertainty, in `unit`.", 0.02)]
    spread: Annotated[float, told("Standard deviation over the robots, in `unit`.", 0.055)]
    spread_std: Annotated[float, told("Its standard uncertainty, in `unit`.", 0.014)]
    robots: Annotated[int, told("Number of robots whose readings determine it.", 8)]
    of_next: Annotated[float, told("Standard deviation of a further robot about the mean, in `unit`.", 0.06)]
    usual: Annotated[float | None, told("Usual size without the type, in `unit`; null if free.", 0.1)]
    kept: Annotated[bool, told("Whether the type says more than the usual size.", True)]


class StandInsResponse(ResponseBody):
    """A parameter that no robot of the type determines."""

    name: _NAMED
    stand_ins: Annotated[
        list[tuple[str, float]],
        told("What takes its place, and how far, in mm or rad, per unit.", [["d2", 1.0]]),
    ]


class TypeEffectResponse(ResponseBody):
    """An effect in addition to the base model."""

    label: Annotated[str, told("Its label.", "backlash:j4")]
    shape: Annotated[
        dict[str, float], told("What fixes its shape, by name, in units of files or no unit.", {})
    ]
    robots: Annotated[int, told("Number of robots that have it.", 3)]


class OutlierResponse(ResponseBody):
    """A robot outside the type in one parameter; the statistics leave its value out."""

    robot: Annotated[str, told("Name of its model.", "3.json")]
    parameter: _NAMED
    value: Annotated[float, told("Its value, in `unit`.", 0.9)]
    unit: _UNIT
    z: Annotated[float, told("Number of spreads from the mean.", 6.1)]


class UnlikeRobotResponse(ResponseBody):
    """A robot that the statistics leave out."""

    model: Annotated[str, told("Name of its model.", "5.json")]
    because: Annotated[str, told("Why.", "most of its parameters lie outside the type")]


class TypeStatisticsResult(ResponseBody):
    """What robots of one type share (`truepose-prior/1`), as `calib.prior` writes and checks it."""

    format: Annotated[Literal["truepose-prior/1"], told("The format.", "truepose-prior/1")]
    program: Annotated[str, told("The version of the program; another one refuses it.", "0.1.0")]
    robot: Annotated[str, told("The robot file's name.", "abb-irb120")]
    robot_sha256: Annotated[str, told("Hash of the robot.", "2cb1834862e993f8")]
    joint_coupling: Annotated[str, told("How the controller counts coupled joints.", "none")]
    simulated: Annotated[bool, told("Whether the models are of simulators.", False)]
    groups: Annotated[list[str], told("Groups of parameters that the models free.", ["geometry"])]
    robots: Annotated[int, told("Number of robots.", 8)]
    models: Annotated[list[TypeModelResponse], told("The models.", [])]
    parameters: Annotated[list[LearnedParameterResponse], told("Every parameter.", [])]
    redundant: Annotated[list[StandInsResponse], told("Parameters that no robot determines.", [])]
    found: Annotated[list[TypeEffectResponse], told("Effects with the number of robots that have them.", [])]
    outliers: Annotated[list[OutlierResponse], told("What lies outside the type.", [])]
    left_out: Annotated[list[UnlikeRobotResponse], told("Robots that were left out.", [])]
    content_sha256: _SHA

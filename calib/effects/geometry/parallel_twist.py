"""Parallel twist: two axes that are parallel by design are not, Hayati's beta of link K. 0.01 deg cost 0.1 mm.

On other links the DH parameters contain it. Source: Hayati 1983.
"""

from __future__ import annotations

from calib.effects.kind import Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import Constant
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "parallel_twist",
        words="twisted axes at link {joint}",
        check=(
            "Nothing to repair: the axes at link {joint} were machined so; look for a past collision if the "
            "value has changed since the last calibration."
        ),
        apart=(),
    ),
)


def parallel_twist(link: int) -> Effect:
    """Twist of `link` about y; parameter beta, deg."""
    return effect(
        f"parallel_twist:j{link}",
        "structure",
        "robot",
        f"The axes that link {link} should hold parallel are twisted.",
        {"beta": ("deg", 0.1, [(f"beta{link}", Constant())])},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each link between parallel axes, except those whose twist the base model identifies."""
    return [Candidate(parallel_twist(k)) for k in survey.robot.parallel_axes]

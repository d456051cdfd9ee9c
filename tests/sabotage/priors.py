"""Changes to what robots of one type share."""

from __future__ import annotations

from tests.sabotage.change import Change

_PRIOR = ("tests/calib/test_prior.py",)
_DIAGNOSIS = ("tests/calib/test_prior_diagnosis.py",)

CHANGES = (
    Change(
        "calib/prior/type_statistics.py",
        "_positive(inverse - np.diag(held), scale)",
        "_positive(inverse, scale)",
        "a robot that knew its type confirms it",
        _PRIOR,
    ),
    Change(
        "calib/prior/reml.py",
        "self.weights - self.weights @ self.covariance @ self.weights)",
        "self.weights)",
        "the spread of a type forgets that its mean was found from the same robots",
        _PRIOR,
    ),
    Change(
        "calib/fit/least_squares.py",
        "held**2 * (at.estimate - mean)[active]",
        "held**2 * at.estimate[active]",
        "a fit is pulled to nominal, not to its type",
        _PRIOR,
    ),
    Change(
        "calib/fit/type_prior.py",
        "return worst if abs(worst.z) > limit else None",
        "return None",
        "a parameter outside the type is held to it",
        _PRIOR,
    ),
    Change(
        "calib/fit/type_prior.py",
        "return len(self.outside) > MOST_OUTSIDE or self.p_value < TOGETHER",
        "return False",
        "a robot that is no member is held to a type",
        _PRIOR,
    ),
    Change(
        "calib/fit/type_prior.py",
        "            gone.add(drop.name)",
        "            pass",
        "a redundant parameter takes what its stand-in was held to",
        _PRIOR,
    ),
    Change(
        "calib/prior/file.py",
        "if spread <= 0.0:",
        "if spread < -1e9:",
        "a prior without spread is believed",
        _PRIOR,
    ),
    Change(
        "calib/selection/choose.py",
        "fine = curve_of(candidates, selection, 1, known, beyond=1.0)",
        "fine = curve_of(candidates, selection, 1, None, beyond=1.0)",
        "the number of poses is that without the prior",
        _PRIOR,
    ),
    Change(
        "calib/scan/scores.py",
        "return 1.0 / (0.5 / alike",
        "return 1.0 / (1.0 / alike",
        "what a type has comes free of tries",
        _DIAGNOSIS,
    ),
    Change(
        "calib/diagnose/diagnosis.py",
        "model = centred(fitted.model, beside.prior, wanted)",
        "model = fitted.model",
        "effects that were found do not know the sizes of their type",
        _DIAGNOSIS,
    ),
)

"""Changes to the model, its fit and its diagnosis."""

from __future__ import annotations

from tests.sabotage.change import Change

FIT = (
    "tests/calib/test_identify.py",
    "tests/calib/test_identify_estimate.py",
    "tests/calib/test_identify_invariance.py",
    "tests/calib/test_certified.py",
)
_EFFECTS = (
    "tests/calib/test_effects.py",
    "tests/calib/test_effects_offers.py",
    "tests/calib/test_kinematics.py",
)
COMPENSATE = ("tests/calib/test_compensate.py", "tests/calib/test_compensate_controllers.py")
OFFSETS = ("tests/calib/test_offsets.py",)
VISITS = ("tests/calib/test_visits.py",)

CHANGES = (
    Change(
        "calib/fit/readings.py",
        "* ~several[:, None, None]",
        "* 1.0",
        "readings of a visit are whitened for the arm's repeatability twice",
        VISITS,
    ),
    Change(
        "calib/model/observations.py",
        "h = 1.0 / (grown * (grown + 1.0))",
        "h = 1.0 / grown**2",
        "readings of a visit are whitened by their inverse covariance, not its root",
        VISITS,
    ),
    Change(
        "calib/fit/identify.py",
        "    alone, wrong = observed.alone, robust.FEW\n",
        "    alone, wrong = observed, robust.FEW\n",
        "a wrong reading takes the others of its visit with it",
        VISITS,
    ),
    Change(
        "calib/fit/readings.py",
        "(first * parts // len(visit))[place.reshape(-1)]",
        "np.arange(len(visit)) * parts // len(visit)",
        "a large fit cuts visits in two",
        VISITS,
    ),
    Change(
        "calib/scan/scores.py",
        "return observed.by_visit(columns).reshape",
        "return columns.reshape",
        "columns of candidates are not whitened by visit",
        VISITS,
    ),
    Change(
        "calib/scan/scores.py",
        "return observed.by_visit(rows.T.reshape(-1, *self.residual.shape)).reshape",
        "return rows.T.reshape(-1, *self.residual.shape).reshape",
        "structure that differs within a visit is looked for where it is not",
        VISITS,
    ),
    Change(
        "calib/fit/least_squares.py",
        " + tied.T @ tied\n",
        "\n",
        "measured sides of a triangle count for less than they are worth",
        ("tests/calib/test_spans.py",),
    ),
    Change(
        "calib/model/model.py",
        "moves[k, position] = sign",
        "moves[k, position] = 1.0",
        "the second ball of a distance moves it as the first does",
        ("tests/calib/test_spans.py",),
    ),
    Change(
        "calib/fit/identify.py",
        "        missed = missed + hat[:, worst] * off\n",
        "",
        "a wrong distance accuses its neighbours",
        ("tests/calib/test_spans.py",),
    ),
    Change(
        "calib/fit/least_squares.py",
        "- held**2 * (at.estimate - mean)[active] + tied.T @ left) / size",
        "- 0.0 * at.estimate[active] + tied.T @ left) / size",
        "the prior pulls to wherever the fit stands and not to zero",
        FIT,
    ),
    Change(
        "calib/fit/least_squares.py",
        "        return _back(self.triangle, np.eye(len(self.size))) / self.size[:, None]",
        "        return _back(self.triangle, np.eye(len(self.size)))",
        "covariances have the scale of the columns",
        FIT,
    ),
    Change(
        "calib/fit/least_squares.py",
        "    seen = scale * usual > _MOVES_NOTHING",
        "    seen = scale * usual >= 0.0",
        "a parameter that moves nothing is kept",
        FIT,
    ),
    Change(
        "calib/fit/identify.py",
        "    covariance = solution.covariance * max(scale, 1.0) ** 2",
        "    covariance = solution.covariance * max(scale, 1.0)",
        "uncertainties of noisy readings come out too small",
        FIT,
    ),
    Change(
        "calib/fit/identify.py",
        "    dof = readings.observed.count - int(active.sum())",
        "    dof = readings.observed.count - 0 * int(active.sum())",
        "the noise is estimated as if nothing had been fitted",
        FIT,
    ),
    Change(
        "calib/fit/identify.py",
        "    readings = readings.take(~faulty)\n",
        "",
        "readings that do not belong stay in the fit",
        FIT,
    ),
    Change(
        "calib/model/base_model.py",
        'None if axis[0] == "r" else sizes.get(target)',
        "None",
        "tool targets known to an uncertainty are fitted as if nothing were known of them",
        OFFSETS,
    ),
    Change(
        "calib/fit/offsets.py",
        "        m, p = m + gain @ m[at], p + gain @ p[at]\n",
        "",
        "cups beside the one out of place are accused with it",
        OFFSETS,
    ),
    Change(
        "calib/fit/offsets.py",
        "        if chance * len(rows) >= FALSE_ALARM:",
        "        if chance * len(rows) >= 50.0 * FALSE_ALARM and one.sigma < 2.0:",
        "cups as good as stated are doubted",
        OFFSETS,
    ),
    Change(
        "calib/fit/offsets.py",
        "    square = float(np.sum(along**2 / share[seen]))",
        "    square = float(np.sum(along**2))",
        "how far off cups are is judged as if the fit had not been pulled to where they are stated",
        OFFSETS,
    ),
    Change(
        "calib/model/regressors.py",
        "        return conditions.temperature - self.reference_c",
        "        return self.reference_c - conditions.temperature",
        "an arm grows when it cools down",
        _EFFECTS,
    ),
    Change(
        "calib/model/model.py",
        "        previous=joints - sides * np.asarray(stated.approach) * model.robot.steps,",
        "        previous=joints + sides * np.asarray(stated.approach) * model.robot.steps,",
        "a correction holds for the other side of approach",
        COMPENSATE,
    ),
    Change(
        "calib/fit/robust.py",
        "    return limits(freedom) * max(noise_scale(residual, freedom, wrong), 1.0)",
        "    return limits(freedom) * 1.0",
        "most readings are rejected where the noise was declared too small",
        FIT,
    ),
    Change(
        "calib/diagnose/select.py",
        "return min(1.0, float(left @ left) / space.rows / max(along, 1e-300))",
        "return 1.0",
        "noise counts as alike in all directions, and names appear beside a law outside the library",
        ("tests/calib/test_structure.py",),
    ),
    Change(
        "calib/diagnose/select.py",
        "in (conditions.pose, in_time * STRETCHES // n)",
        "in (conditions.pose,)",
        "noise counts as independent in time, and what lasts looks like steps",
        ("tests/calib/test_structure.py",),
    ),
    Change(
        "calib/diagnose/curves.py",
        "block[rows] = of_pose[pose]",
        "block[rows] = stretch",
        "curves of gears are confirmed on the poses that they were fitted to",
        ("tests/calib/test_gear_curves.py",),
    ),
    Change(
        "calib/scan/scores.py",
        "columns, left, ratio)) * multiplicity)",
        "columns, left, ratio)))",
        "of many candidates one is claimed by chance",
        ("tests/calib/test_scores.py", "tests/calib/test_diagnose.py", "tests/calib/test_diagnose_sets.py"),
    ),
    Change(
        "calib/fit/identification.py",
        "    return 2.0 * np.sqrt(np.maximum(largest, 0.0))",
        "    return np.sqrt(np.maximum(largest, 0.0))",
        "an expanded uncertainty is the standard one",
        ("tests/calib/test_figures.py",),
    ),
    Change(
        "calib/selection/exchange.py",
        " + m * float(np.log(excess))",
        "",
        "the bound of a selection is no bound",
        ("tests/calib/test_selection.py", "tests/calib/test_selection_poses.py"),
    ),
    Change(
        "calib/fit/statistics.py",
        "np.quantile(errors, 0.95)",
        "np.quantile(errors, 0.9)",
        "one reading in ten lies beyond the 95 % error",
        ("tests/calib/test_figures.py",),
    ),
)

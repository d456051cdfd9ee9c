"""Changes to the mathematics."""

from __future__ import annotations

from tests.sabotage.change import Change

_FIT = ("tests/calib/test_identify.py", "tests/calib/test_certified.py")
_EFFECTS = (
    "tests/calib/test_effects.py",
    "tests/calib/test_effects_offers.py",
    "tests/calib/test_kinematics.py",
)
_COMPENSATE = ("tests/calib/test_compensate.py", "tests/calib/test_compensate_poses.py")
_VALIDATION = ("tests/calib/test_validation.py", "tests/calib/test_validation_iso9283.py")

CHANGES = (
    Change(
        "calib/least_squares.py",
        "prior**2 * estimate[active]) / size",
        "0.0 * estimate[active]) / size",
        "the prior pulls to wherever the fit stands and not to zero",
        _FIT,
    ),
    Change(
        "calib/least_squares.py",
        "    inverse = _back(triangle, np.eye(len(size))) / size[:, None]",
        "    inverse = _back(triangle, np.eye(len(size)))",
        "covariances have the scale of the columns",
        _FIT,
    ),
    Change(
        "calib/least_squares.py",
        "    seen = scale * usual > _MOVES_NOTHING",
        "    seen = scale * usual >= 0.0",
        "a parameter that moves nothing is kept",
        _FIT,
    ),
    Change(
        "calib/identify.py",
        "    covariance = solution.covariance * max(scale, 1.0) ** 2",
        "    covariance = solution.covariance * max(scale, 1.0)",
        "uncertainties of noisy readings come out too small",
        _FIT,
    ),
    Change(
        "calib/identify.py",
        "    dof = readings.observed.count - int(active.sum())",
        "    dof = readings.observed.count - 0 * int(active.sum())",
        "the noise is estimated as if nothing had been fitted",
        _FIT,
    ),
    Change(
        "calib/identify.py",
        "    readings = readings.take(~faulty)\n",
        "",
        "readings that do not belong stay in the fit",
        _FIT,
    ),
    Change(
        "calib/noise.py",
        "across[:, None, None] ** 2 * (np.eye(3) - outer) + along[:, None, None] ** 2 * outer",
        "along[:, None, None] ** 2 * (np.eye(3) - outer) + across[:, None, None] ** 2 * outer",
        "a tracker's range and its angles are exchanged",
        ("tests/calib/test_observations.py", "tests/calib/test_selection.py", *_FIT),
    ),
    Change(
        "calib/noise.py",
        "np.linalg.inv(lower).transpose(1, 2, 0), dtype",
        "np.linalg.inv(lower).transpose(2, 1, 0), dtype",
        "readings are whitened by the transpose of what whitens them",
        ("tests/calib/test_observations.py", *_FIT),
    ),
    Change(
        "calib/dataset.py",
        '        return self.usable & (self.sets != "validation")',
        "        return self.usable",
        "validation rows enter the fit",
        ("tests/calib/test_dataset.py", *_FIT),
    ),
    Change(
        "calib/csv_text.py",
        "out.append((reader.line_num, row))",
        "out.append((reader.line_num - 1, row))",
        "a refusal names the line before the damaged one",
        ("tests/calib/test_bad_input.py",),
    ),
    Change(
        "calib/regressors.py",
        "        return conditions.temperature - self.reference_c",
        "        return self.reference_c - conditions.temperature",
        "an arm grows when it cools down",
        _EFFECTS,
    ),
    Change(
        "calib/arrivals.py",
        "    own, way = joints - previous, previous - before",
        "    own, way = previous - joints, previous - before",
        "sides of approach that are not recorded are derived with the wrong sign",
        ("tests/calib/test_arrivals.py", "tests/calib/test_dataset.py"),
    ),
    Change(
        "calib/kinematics.py",
        "        return cross(axis, self.p - self.origin[slot]), axis",
        "        return cross(self.p - self.origin[slot], axis), axis",
        "a joint moves the tool the other way round",
        ("tests/calib/test_kinematics.py", *_COMPENSATE),
    ),
    Change(
        "calib/compensate/stated.py",
        "        previous=joints - sides * np.asarray(stated.approach),",
        "        previous=joints + sides * np.asarray(stated.approach),",
        "a correction holds for the other side of approach",
        _COMPENSATE,
    ),
    Change(
        "calib/compensate/calibrated.py",
        'CORRECTED_OWNERS = ("robot", "mounting")',
        'CORRECTED_OWNERS = ("robot", "mounting", "instrument")',
        "errors of the instrument are sent to the robot",
        _COMPENSATE,
    ),
    Change(
        "calib/compensate/inverse.py",
        "    turn = wanted[:, :3, :3] @ reached[:, :3, :3].transpose(0, 2, 1)",
        "    turn = reached[:, :3, :3] @ wanted[:, :3, :3].transpose(0, 2, 1)",
        "orientations are corrected away from where they should be",
        _COMPENSATE,
    ),
    Change(
        "calib/validation/iso9283.py",
        "    return float(lengths.mean() + 3.0 * lengths.std(ddof=1))",
        "    return float(lengths.mean() + 3.0 * lengths.std())",
        "repeatability is divided by n and not by n - 1",
        _VALIDATION,
    ),
    Change(
        "calib/validation/iso9283.py",
        "np.flatnonzero(np.bincount(direction) > 1)",
        "np.flatnonzero(np.bincount(direction) > 0)",
        "a single visit counts as a direction of approach",
        _VALIDATION,
    ),
    Change(
        "calib/validation/orientation.py",
        "Rotation.from_quat(measured, scalar_first=True)",
        "Rotation.from_quat(measured, scalar_first=False)",
        "measured orientations are read with their scalar last",
        _VALIDATION,
    ),
    Change(
        "calib/world_frame.py",
        "        return turn.as_quat(canonical=True, scalar_first=True)",
        "        return turn.as_quat(canonical=True, scalar_first=False)",
        "orientations are recorded with their scalar last",
        (
            "tests/calib/test_world_frame.py",
            "tests/acquisition/test_world_frame.py",
            "tests/acquisition/test_store.py",
        ),
    ),
    Change(
        "calib/robust.py",
        "    return _limits(freedom) * max(noise_scale(residual, freedom), 1.0)",
        "    return _limits(freedom) * 1.0",
        "most readings are rejected where the noise was declared too small",
        _FIT,
    ),
    Change(
        "calib/diagnose/evidence.py",
        "columns, left)) * multiplicity)",
        "columns, left)))",
        "of many candidates one is claimed by chance",
        ("tests/calib/test_scores.py", "tests/calib/test_diagnose.py", "tests/calib/test_diagnose_sets.py"),
    ),
    Change(
        "calib/inverse_kinematics/turns.py",
        "TURN * np.clip(wanted, first, last)",
        "TURN * wanted",
        "the nearest whole turn may lie beyond the limits of the joint",
        ("tests/calib/test_inverse_kinematics.py",),
    ),
    Change(
        "calib/uncertainty.py",
        "    return 2.0 * np.sqrt(np.maximum(largest, 0.0))",
        "    return np.sqrt(np.maximum(largest, 0.0))",
        "an expanded uncertainty is the standard one",
        ("tests/calib/test_figures.py",),
    ),
    Change(
        "calib/selection/bound.py",
        " + m * float(np.log(excess))",
        "",
        "the bound of a selection is no bound",
        ("tests/calib/test_selection.py", "tests/calib/test_selection_poses.py"),
    ),
    Change(
        "calib/statistics.py",
        "np.quantile(errors, 0.95)",
        "np.quantile(errors, 0.9)",
        "one reading in ten lies beyond the 95 % error",
        ("tests/calib/test_figures.py",),
    ),
)

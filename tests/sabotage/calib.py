"""Changes to the rest of the mathematics: arms, data, effects, compensation, validation, regression."""

from __future__ import annotations

from tests.sabotage.change import Change

_FIT = (
    "tests/calib/test_identify.py",
    "tests/calib/test_identify_estimate.py",
    "tests/calib/test_identify_invariance.py",
    "tests/calib/test_certified.py",
)
_COMPENSATE = ("tests/calib/test_compensate.py", "tests/calib/test_compensate_poses.py")
_OFFSETS = ("tests/calib/test_offsets.py",)
_HEXAPOD = ("tests/calib/test_hexapod_pose.py",)
_VALIDATION = ("tests/calib/test_validation.py", "tests/calib/test_validation_iso9283.py")
_REGRESSION = ("tests/calib/test_regression.py", "tests/service/test_regress_command.py")
_VISITS = ("tests/calib/test_visits.py",)

CHANGES = (
    Change(
        "calib/data/visits.py",
        "begins | turned | ~(still | same_move)",
        "begins | turned",
        "a robot that comes again from elsewhere never left",
        _VISITS,
    ),
    Change(
        "calib/convert/hexapod_legs.py",
        "    if measured:\n",
        "    if not measured:\n",
        "poses are solved with the stated sides where they were measured",
        ("tests/calib/test_hexapod_legs.py",),
    ),
    Change(
        "calib/validation/ballbar.py",
        "                length_differences(dataset, sphere, model, estimate),\n",
        "                np.abs(length_differences(dataset, sphere, model, estimate)),\n",
        "the radial error of a sphere has no sign",
        ("tests/calib/test_validation_ballbar.py",),
    ),
    Change(
        "calib/sweeps/joint.py",
        "rows=sweep.rows[pattern.reshape(-1) == int(np.argmax(count))]",
        "rows=sweep.rows",
        "readings of other sweeps lend theirs to this joint's reversal",
        ("tests/calib/test_sweeps.py",),
    ),
    Change(
        "calib/sweeps/circle.py",
        "        weight = 1.0 / np.maximum(scatter, max(scatter.max() * 1e-6, 1e-18))\n",
        "",
        "the error of a joint bends the circle that it is measured on",
        ("tests/calib/test_sweeps.py",),
    ),
    Change(
        "calib/effects/kind.py",
        "dict.fromkeys([*one.apart, *other.apart])",
        "dict.fromkeys(one.apart)",
        "what tells an effect apart is advised of one side of a pair only",
        ("tests/calib/test_made_up_effect.py",),
    ),
    Change(
        "calib/regression/mls_svr.py",
        "np.where(np.arange(outputs) == 0, float(outputs), 0.0)",
        "0.0",
        "outputs of a regression have nothing in common",
        _REGRESSION,
    ),
    Change(
        "calib/comparison/comparison.py",
        "_predictors(without(dataset, away), plan, waypoint)",
        "_predictors(dataset, plan, waypoint)",
        "what is left out of a regression takes part in it",
        _REGRESSION,
    ),
    Change(
        "calib/regression/choose.py",
        "bool(gains.sum() > _SURE * spread)",
        "True",
        "a regression on residuals stays though it gains nothing",
        _REGRESSION,
    ),
    Change(
        "calib/regression/region.py",
        "within & near & (along <= self.reach).all(axis=1)",
        "within & near",
        "a tilted tool lies in the region of a regression",
        _REGRESSION,
    ),
    Change(
        "calib/compensate/correct.py",
        "        (Status.OUTSIDE_REGION, outside),\n",
        "",
        "a regression corrects where it was never trained",
        _REGRESSION,
    ),
    Change(
        "calib/compensate/calibrated.py",
        "            poses[:, :3, 3] += np.einsum",
        "            _ = np.einsum",
        "a correction forgets the regression of its model",
        _REGRESSION,
    ),
    Change(
        "calib/data/header.py",
        "return dict.fromkeys(names, u_mm) if u_mm > 0.0 else {}",
        "return {}",
        "positions known to one uncertainty for all of them count as exact cups",
        _OFFSETS,
    ),
    Change(
        "calib/arm/hexapod_pose.py",
        "t3 = trilaterated(t2, second, t1, t23, r23, t31, s3)",
        "t3 = trilaterated(t2, second, t1, t23, r23, t31, -s3)",
        "two assembly modes of the hexapod are exchanged",
        _HEXAPOD,
    ),
    Change(
        "calib/arm/hexapod_pose.py",
        "rows[:, :, each, _ENDS[:, 1]] = -span",
        "rows[:, :, each[3:], _ENDS[3:, 1]] = -span[:, :, 3:]",
        "the base triangle of the hexapod is exact in its uncertainty",
        _HEXAPOD,
    ),
    Change(
        "calib/data/noise.py",
        "across[:, None, None] ** 2 * (np.eye(3) - outer) + along[:, None, None] ** 2 * outer",
        "along[:, None, None] ** 2 * (np.eye(3) - outer) + across[:, None, None] ** 2 * outer",
        "a tracker's range and its angles are exchanged",
        ("tests/calib/test_observations.py", "tests/calib/test_selection.py", *_FIT),
    ),
    Change(
        "calib/data/noise.py",
        "np.linalg.inv(lower).transpose(1, 2, 0), dtype",
        "np.linalg.inv(lower).transpose(2, 1, 0), dtype",
        "readings are whitened by the transpose of what whitens them",
        ("tests/calib/test_observations.py", *_FIT),
    ),
    Change(
        "calib/data/dataset.py",
        '        return self.usable & (self.sets != "validation")',
        "        return self.usable",
        "validation rows enter the fit",
        ("tests/calib/test_dataset.py", *_FIT),
    ),
    Change(
        "calib/text/csv_text.py",
        "out.append((reader.line_num, row))",
        "out.append((reader.line_num - 1, row))",
        "a refusal names the line before the damaged one",
        ("tests/calib/test_bad_input.py",),
    ),
    Change(
        "calib/data/header.py",
        'repeatability=table.number("repeatability_deg", 0.0, low=0.0)',
        'repeatability=table.number("repeatability_deg", 0.01, low=0.0)',
        "a default of a file is another than the documentation says",
        ("tests/docs/test_keys.py",),
    ),
    Change(
        "calib/data/read.py",
        'arrivals_told="approach1" in table or "prev1_deg" in table',
        "arrivals_told=True",
        "nobody is told that the order of rows stood in for the way of the robot",
        ("tests/calib/test_arrivals.py",),
    ),
    Change(
        "calib/data/arrivals.py",
        "    own, earlier = joints - previous, previous - before",
        "    own, earlier = previous - joints, previous - before",
        "sides of approach that are not recorded are derived with the wrong sign",
        ("tests/calib/test_arrivals.py", "tests/calib/test_dataset.py"),
    ),
    Change(
        "calib/arm/kinematics.py",
        "        return cross(axis, self.p - self.origin[slot]), axis",
        "        return cross(self.p - self.origin[slot], axis), axis",
        "a joint moves the tool the other way round",
        ("tests/calib/test_kinematics.py", *_COMPENSATE),
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
        "calib/arm/world_frame.py",
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
        "calib/arm/inverse_kinematics/turns.py",
        "TURN * np.clip(wanted, first, last)",
        "TURN * wanted",
        "the nearest whole turn may lie beyond the limits of the joint",
        ("tests/calib/test_inverse_kinematics.py",),
    ),
    Change(
        "calib/data/conditions.py",
        "        places[self.waypoint >= 0] = 0\n",
        "",
        "samples of one waypoint are poses of their own",
        ("tests/calib/test_dataset.py",),
    ),
    Change(
        "calib/convert/table.py",
        '            joints = [self.columns["waypoint"]]',
        "            pass",
        "samples of one waypoint fall on both sides of a hold-out",
        ("tests/calib/test_convert.py",),
    ),
)

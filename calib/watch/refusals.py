"""Refusals, before any judgement, of readings that cannot be compared with a baseline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from calib.data.dataset import Dataset
from calib.errors import DataError
from calib.model.regressors import Temperature
from calib.saved import CalibratedModel
from calib.validation import refuse_other_robot
from calib.watch.baseline import too_few_poses

WARMER_K = 3.0
"""Difference of the air, K, up to which a baseline without a law of temperature is compared: 0.03 mm on 1 m."""

_STATION_MM = 1.0
_SAME_MM, _SAME_KG = 1e-3, 1e-3


def refuse_unlike(
    saved: CalibratedModel,
    dataset: Dataset,
    path: Path,
    *,
    frame_known: bool,
    missing_allowed: bool,
    warmth_known: bool = True,
) -> tuple[str, ...]:
    """Refuse readings that cannot be judged by a baseline.

    Parameters
    ----------
    path : Path
        File of the baseline, for the messages.
    frame_known : bool
        False if robot or instrument were moved on purpose.
    missing_allowed : bool
        Whether poses may be missing.
    warmth_known : bool, optional
        False if the readings are to show how warm the robot is.

    Returns
    -------
    tuple of str
        Conditions that could not be checked, and other notes.

    Raises
    ------
    DataError
        The readings are from another robot, tool, load, temperature or frame, or some are missing.
    """
    refuse_other_robot(saved, dataset, path)
    notes = _robot(saved, dataset, path)
    conditions = dataset.conditions
    if not dataset.fit_rows.any():
        raise DataError(
            "has no usable reading outside the validation set.",
            do="Measure the check poses.",
            file=dataset.path,
        )
    if len(conditions.series_names) != 1 or len(saved.model.targets) != 1:
        raise DataError(
            "holds several series, or the baseline does: a watch compares one with one.",
            do="Export and calibrate the set-ups apart.",
            file=dataset.path,
            key="series",
        )
    _same_tool(saved, dataset)
    notes += _same_warmth(saved, dataset) if warmth_known else ()
    notes += _same_frame(saved, dataset) if frame_known else ()
    _same_sides(saved, dataset)
    gone = missing(dataset)
    if gone and not missing_allowed:
        raise DataError(
            f"lacks {_listed(gone)}: a change that only they show would not be detected.",
            do="Measure again, or judge without with --allow-missing.",
            file=dataset.path,
            key="status",
        )
    if gone:
        notes += (f"Judged without {_listed(gone)}.",)
    if few := too_few_poses(saved):
        notes += (few,)
    if saved.held_out_rms_mm is None and (saved.left_open is None or saved.left_open.scatter is None):
        notes += (
            f"{path.name} has no held-out error: what it lacks is taken from its fit. Calibrate with validation rows.",
        )
    if saved.left_open is None:
        notes += (
            f"{path.name} does not say what its readings left open (written by an older version): unchanged robots "
            "raise more alarms than stated. Diagnose its data again with --model.",
        )
    return notes


def missing(dataset: Dataset) -> list[str]:
    """List the missing readings as text.

    These are rejected readings that were not taken again, and readings that the header lists but the file does not
    contain.
    """
    conditions = dataset.conditions
    keys = np.column_stack([conditions.pose, conditions.target, conditions.anchor])
    good = {tuple(key) for key in keys[dataset.usable]}
    out: dict[str, None] = {}
    for i in np.flatnonzero(~dataset.usable):
        if tuple(keys[i]) not in good:
            joints = ", ".join(f"{q:.1f}" for q in conditions.joints[i] / dataset.header.robot.joint_units)
            target = conditions.target_names[conditions.target[i]]
            why = str(dataset.status[i]).removeprefix("rejected:") or "not measured"
            out[f"{target} at the pose ({joints}) deg ({why})"] = None
    there, header = set(dataset.reading_id), dataset.header
    deleted = [f"reading {name} (no row)" for name in header.readings if name not in there]
    return [*out, *deleted, *[f"{header.not_taken} readings that were not taken yet"][: header.not_taken]]


def _robot(saved: CalibratedModel, dataset: Dataset, path: Path) -> tuple[str, ...]:
    """Refuse another robot by its serial number; return notes on serial numbers not reported."""
    was, now = (_serial(devices, "robot") for devices in (saved.devices, dataset.header.devices))
    if was and now and was != now:
        raise DataError(
            f"is of the robot {now}; the baseline is of the robot {was}.",
            do="Use the model of this robot.",
            file=dataset.path,
            key="device.serial",
        )
    notes: tuple[str, ...] = ()
    if not was:
        notes += (
            f"{path.name} names no serial number (written by an older version, or none was reported): that it is this "
            "robot's was not checked.",
        )
    elif not now:
        notes += (f"{dataset.name} names no serial number: that it is the robot {was} was not checked.",)
    was, now = (_serial(devices, "instrument") for devices in (saved.devices, dataset.header.devices))
    if was and now and was != now:
        notes += (f"Measured with the instrument {now}, the baseline with {was}: their scales may differ.",)
    return notes


def _serial(devices: Sequence[Mapping[str, str]], role: str) -> str:
    return next((each.get("serial", "") for each in devices if each.get("role") == role), "")


def _same_tool(saved: CalibratedModel, dataset: Dataset) -> None:
    """Refuse tool targets or a load that differ from those of the baseline."""
    conditions, header = dataset.conditions, dataset.header
    known = next(iter(saved.model.targets.values()))
    stated = header.targets_of(conditions.series_names[0])
    for t in np.unique(conditions.target[dataset.fit_rows]):
        name = conditions.target_names[t]
        # a model that has found its tool starts from its own nominal positions
        found = any(p.name.startswith(f"{name}.") for p in saved.model.parameters)
        if name not in known or (
            not found and np.max(np.abs(np.subtract(known[name], stated[name]))) > _SAME_MM
        ):
            raise DataError(
                f"has the target '{name}', which the tool of the baseline has not, or has elsewhere.",
                do="Measure with the tool of the calibration, or calibrate this one.",
                file=dataset.path,
                key="tool_targets",
            )
    was, now = (
        sum(load.mass_kg for load in loads if load.link == saved.model.robot.joints)
        for loads in (saved.loads, saved.loads_in(header, dataset.path))
    )
    if abs(was - now) > _SAME_KG:
        raise DataError(
            f"declares {now:g} kg on the last link; the baseline was measured with {was:g} kg.",
            do="Measure with the tool of the calibration, or correct its load data.",
            file=dataset.path,
            key="loads",
        )


def _same_warmth(saved: CalibratedModel, dataset: Dataset) -> tuple[str, ...]:
    was = saved.holds_for.get("temperature_c")
    air = dataset.conditions.temperature[dataset.fit_rows]
    air = air[np.isfinite(air)]
    if was is None or not len(air):
        return ("No air temperature on both sides: that the robot is as warm as it was is not checked.",)
    follows = any(isinstance(t.regressor, Temperature) for e in saved.model.effects for t in e.terms)
    now = float(np.mean(air))
    if abs(now - was) > WARMER_K and not follows:
        raise DataError(
            f"was measured at {now:.1f} degC, the baseline at {was:.1f}; its model has no law of temperature.",
            do=f"Measure within {WARMER_K:g} K of it, or calibrate over the range and diagnose.",
            file=dataset.path,
            key="t_air_c",
        )
    return ()


def _same_frame(saved: CalibratedModel, dataset: Dataset) -> tuple[str, ...]:
    """Refuse different frames: both campaigns need nests, or an instrument that was not moved."""
    header = dataset.header
    if header.nests or not dataset.pointed.any():
        return ()
    moved = float(np.linalg.norm(np.subtract(header.noise.station_mm, saved.model.station)))
    if header.world == "free" or (header.noise.kind == "tracker" and moved > _STATION_MM):
        what = (
            "is in a separate frame" if header.world == "free" else f"is from a station {moved:.0f} mm away"
        )
        raise DataError(
            f"{what}, and names no nests that tie it to the frame of the baseline.",
            do="Set the frame up on the nests of the calibration (key 'nests'), or fit it again with --new-frame, "
            "which does not detect a moved base.",
            file=dataset.path,
            key="nests",
        )
    return (f"{dataset.name} names no nests: its frame is taken for exactly that of the baseline.",)


def refuse_copies(dataset: Dataset) -> None:
    """Refuse a copy of a reading under another id, because it averages no noise.

    If no times are known, readings of a coarse instrument may agree by chance. Then only a file that consists of copies
    is refused.

    Raises
    ------
    DataError
        A reading is repeated; the message names it.
    """
    rows, conditions = dataset.fit_rows, dataset.conditions
    columns = [conditions.joints, conditions.side, dataset.points, dataset.lengths, conditions.time]
    read = np.column_stack([*columns, conditions.target, conditions.anchor])[rows]
    _, first, count = np.unique(np.nan_to_num(read, nan=-1e9), axis=0, return_index=True, return_counts=True)
    twice = count > 1
    times = conditions.time[rows]
    timed = np.isfinite(times) & (len(np.unique(times)) > 1)  # one common time is no information
    copied = twice & (timed[first] | twice.all())
    if copied.any():
        name = np.array(dataset.reading_id)[rows][first[copied][0]]
        raise DataError(
            f"has the reading '{name}' again under another id, at the same time with the same result.",
            do="Leave the copies out.",
            file=dataset.path,
            key="reading_id",
        )


def _same_sides(saved: CalibratedModel, dataset: Dataset) -> None:
    """Refuse sides of approach that the baseline does not know: old backlash must not look new."""
    side = dataset.conditions.side[dataset.fit_rows]
    for k, holds in enumerate(saved.holds_for.get("approach") or ()):
        wrong = {"from below": -1.0, "from above": 1.0}.get(holds)
        if wrong is not None and np.any(side[:, k] == wrong):
            raise DataError(
                f"approaches joint {k + 1} from both sides; the baseline only knows it {holds}, so that backlash "
                "which was always there would look new.",
                do="Calibrate with approach sides = 'both', or plan the watch for one side with --one-side.",
                file=dataset.path,
                key=f"approach{k + 1}",
            )


def _listed(readings: Sequence[str]) -> str:
    few = "; ".join(readings[:3])
    return f"{few} and {len(readings) - 3} more" if len(readings) > 3 else few

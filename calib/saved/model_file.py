"""`MODEL.json`: an identified model on disk (`truepose-model/1`), sufficient to predict.

The hash is no signature: it shows that a file was changed, not who wrote it. A fit that did not converge is refused.
A regression that is based on the model is kept in the same file, under the same hash (`calib.saved.regression`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib.arm.capsules import parse_capsules
from calib.arm.joint_kinds import JointMatrix
from calib.arm.kinematics import statics
from calib.arm.robot import (
    Load,
    Robot,
    built_in_robots,
    load_robot,
    parse_loads,
    refuse_impossible,
    robot_hash,
)
from calib.array import Array
from calib.compensate import Bounds, Usable, refuse_unlikely, usable
from calib.data.dataset import Dataset
from calib.data.header import ABSOLUTE_ACCURACY, Header
from calib.diagnose.diagnosis import DiagnosisFit
from calib.errors import DataError
from calib.fit.identification import IdentificationFit
from calib.fit.least_squares import DroppedParameter
from calib.fit.statistics import ErrorStatistics, worse
from calib.model.effect import Effect
from calib.model.model import ModelStructure, StatedConditions, without
from calib.regression.regression import Regression
from calib.saved.document import FORMAT, WITH_CARRIED, model_document, scope_of
from calib.saved.model_checks import (
    content_hash,
    covariance_of,
    dropped_of,
    estimate_of,
    held_std_of,
    numbers_of,
    refuse_changed,
    refuse_effects,
    refuse_other_table,
    rigid,
)
from calib.saved.regression import refuse_unlikely_shift, regression_of
from calib.saved.unresolved_effects import KEY, LeftOpen
from calib.text.json_text import read_json
from calib.text.text_file import replace_file
from calib.text.toml_table import FARTHEST_MM, Vector

SIMULATED = "SIMULATED: the model was identified from a simulated robot and instrument; it says nothing of a real one."
_SAVED = "; to save it all the same, give --save-anyway (save_anyway over HTTP and in Python)"
_SIDES = ("from below", "from above", "both sides")
_MOST_GRAVITY, _HOTTEST_C, _NOISIEST = 10.0, 1000.0, 1e6


@dataclass(frozen=True)
class CalibratedModel:
    """Model that was read from a file.

    Predict with `BoundModel(model, conditions).predict(estimate)`. If the file contains a regression, use
    `regression.predict(model, estimate, conditions)` within its region.
    """

    model: ModelStructure
    estimate: Array
    covariance: Array
    loads: tuple[Load, ...]
    gravity: Vector
    coupling: str
    data_sha256: str
    holds_for: dict[str, Any]
    held_out_rms_mm: float | None = None
    verified_rms_mm: float | None = (
        None  # error of the robot at new poses, driven with corrections of this model
    )
    began: str | None = None  # when its clock began, as the header of the data says it; None if it does not
    notes: tuple[str, ...] = ()  # information for the user of the model
    regression: Regression | None = None
    simulated: bool = False  # whether the readings came from simulators
    noise_scale: float = 1.0  # ratio of the noise found by the fit to the declared noise
    devices: tuple[Mapping[str, str], ...] = ()  # robot and instrument, as the header of the data names them
    updates: tuple[Mapping[str, Any], ...] = ()  # changes found by watches since, oldest first
    # (m,) standard deviation of every prior in the fit, internal units; None in files that do not state it
    held_std: Array | None = None
    dropped: tuple[DroppedParameter, ...] = ()  # parameters that its readings did not determine
    left_open: LeftOpen | None = None  # unresolved effects; None in files that do not state them
    sha256: str = ""  # content_sha256 of the source file; empty if there is none

    @property
    def usual(self) -> StatedConditions:
        """Conditions under which the readings were taken."""
        air = self.holds_for.get("temperature_c")
        return StatedConditions(
            temperature_c=np.nan if air is None else air, loads=self.loads, gravity=self.gravity
        )

    def refuse_other_accuracy(
        self, there: str, file: Path | None = None, key: str = "absolute_accuracy"
    ) -> bool:
        """Refuse a controller whose absolute accuracy is not as it was during the calibration.

        The state of the controller's own correction is `there`.

        Returns
        -------
        bool
            Whether both states are known.

        Raises
        ------
        DataError
            One is on and the other is off.
        """
        own = str(self.holds_for.get("absolute_accuracy", "unknown"))
        if {own, there} == {"on", "off"}:
            raise DataError(
                f"is {there}, and the model was identified with the controller's absolute accuracy {own}.",
                do=f"Switch it {own} on the controller, or identify the model again.",
                file=file,
                key=key,
            )
        return "unknown" not in (own, there)

    def loads_in(self, header: Header, file: Path | None = None) -> tuple[Load, ...]:
        """Return the loads under which this model predicts readings of a header.

        They are those of the model if the header declares none. Loads that the header declares on the last link replace
        the tool, and the arm keeps the masses of the fit. Estimated loads of the robot file are ignored if the model is
        older than these.

        Raises
        ------
        DataError
            Header and model declare different masses of the arm, or only one was measured with the controller's
            absolute accuracy.
        """
        self.refuse_other_accuracy(header.absolute_accuracy, file)
        estimates = header.robot.loads if header.robot.loads_estimated else ()
        there = header.loads if any(load in estimates for load in self.loads) else header.declared_loads
        last = self.model.robot.joints
        arm, arm_there = ([load for load in loads if load.link != last] for loads in (self.loads, there))
        if not there:
            return self.loads
        if not arm_there and arm:
            tools = [load for load in self.loads if load.link == last]
            return (*arm, *tools[: max(0, len(tools) - len(there))], *there)
        if self.loads and arm_there != arm:
            links = sorted({load.link for load in (*arm, *arm_there) if (load in arm) != (load in arm_there)})
            raise DataError(
                f"declares other masses of link {', '.join(map(str, links))} than the model was fitted with.",
                do="Use the robot file of the calibration, or identify the model again with these loads.",
                file=file,
                key="loads",
            )
        return there

    def loaded(self, dataset: Dataset) -> Dataset:
        """Recompute the torques of readings with the loads from `loads_in`."""
        loads = self.loads_in(dataset.header, dataset.path)
        if loads == dataset.header.loads:
            return dataset
        there = statics(self.model.robot, dataset.conditions.joints, loads, dataset.header.gravity)
        conditions = replace(
            dataset.conditions,
            torque=there.torque,
            moment=there.moment,
            overturning=there.overturning,
            unit_load=there.unit_load,
        )
        return replace(dataset, conditions=conditions)

    def for_use(
        self, *, named_only: bool = False, bounds: Bounds | None = None
    ) -> tuple[CalibratedModel, Usable]:
        """Return the model for corrections, without carried terms that cannot be used.

        A regression corrects the error that the whole model leaves, so it is then left out too.

        Parameters
        ----------
        named_only : bool, optional
            Whether all carried terms are left out.
        bounds : Bounds, optional
            Largest permitted correction.

        Returns
        -------
        model : CalibratedModel
        usable : Usable
            Terms that were left out, and the cost.

        Raises
        ------
        DataError
            The model without these terms corrects beyond `bounds`.
        """
        part = usable(
            self.model,
            self.estimate,
            self.covariance,
            self.usual,
            named_only=named_only,
            coupling=self.coupling,
        )
        if not part.left_out:
            return self, part
        refuse_unlikely(part.model, part.estimate, self.usual, bounds or Bounds(), coupling=self.coupling)
        notes = part.in_words
        if self.regression is not None:
            notes += ("The regression is left out: it corrects what the whole model leaves.",)
        held = (
            None
            if self.held_std is None
            else self.held_std[[self.model.index[p.name] for p in part.model.parameters]]
        )
        less = replace(
            self,
            model=part.model,
            estimate=part.estimate,
            covariance=part.covariance,
            held_std=held,
            left_open=None,
            regression=None,
            notes=(*self.notes, *notes),
        )
        return less, part


def as_saved(identification: IdentificationFit, diagnosis: DiagnosisFit | None = None) -> CalibratedModel:
    """Convert an identification to a model as it would be read from its file."""
    header = identification.header
    judged = None if diagnosis is None else diagnosis.error_after
    return CalibratedModel(
        identification.model,
        identification.estimate,
        identification.covariance,
        loads=header.loads,
        gravity=header.gravity,
        coupling=header.coupling,
        data_sha256=identification.data_sha256,
        holds_for=scope_of(identification),
        held_out_rms_mm=None if judged is None else judged.rms,
        began=None if header.occasion is None else header.occasion.began,
        notes=(SIMULATED,) if header.simulated else (),
        simulated=header.simulated,
        noise_scale=identification.noise_scale,
        devices=header.devices,
        held_std=identification.held_std,
        dropped=identification.dropped,
        left_open=LeftOpen.of(identification, None if diagnosis is None else diagnosis.held_out),
    )


def refuse_worse(
    nominal: ErrorStatistics | None,
    found: ErrorStatistics | None,
    file: Path | None = None,
    use: str = _SAVED,
) -> None:
    """Refuse a model whose held-out error exceeds that of the nominal robot in its place.

    Nothing is refused if no readings were held out. The text `use` states the refused action, and how to insist.

    Raises
    ------
    DataError
        The held-out error is larger.
    """
    if nominal is not None and found is not None and worse(found, nominal):
        raise DataError(
            f"the model misses held-out readings by {found.rms:.3f} mm RMS, the nominal robot in its place by "
            f"{nominal.rms:.3f} mm: it would make the robot less accurate.",
            do=f"Look at the warnings of the fit and at the readings left out{use}.",
            file=file,
        )


def save_model(
    path: Path | None,
    identification: IdentificationFit,
    diagnosis: DiagnosisFit | None = None,
    regression: Regression | None = None,
    *,
    save_anyway: bool = False,
    verified: ErrorStatistics | None = None,
) -> str:
    """Write a model, together with the regression that is based on it.

    Parameters
    ----------
    path : Path or None
        None writes nothing.
    save_anyway : bool, optional
        Whether to save a diagnosed model that is worse on held-out readings than the nominal robot in its place.
    verified : ErrorStatistics, optional
        Errors of the robot at new poses, driven with corrections of this model, mm.

    Returns
    -------
    str
        The `content_sha256` of the model.

    Raises
    ------
    DataError
        The fit did not converge, or the diagnosed model is worse than the nominal robot.
    """
    if not identification.converged:
        raise DataError(
            "the fit did not converge: it is not saved as a model.", do="Look at its warnings.", file=path
        )
    if path is not None and diagnosis is not None and not save_anyway:
        refuse_worse(*diagnosis.gain, file=path)
    document = model_document(identification, diagnosis, regression, verified)
    if path is not None:
        replace_file(path, json.dumps(document, indent=1, allow_nan=False) + "\n")
    return document["content_sha256"]


def load_model(
    path: Path, *, robot_file: Path | None = None, bounds: Bounds | None = None
) -> CalibratedModel:
    """Read a model; refuse one that was changed, or that corrects beyond `bounds`.

    Its robot must be that of `robot_file`, or the built-in one of its name. For a custom robot without a robot file the
    table in the model is used, and `notes` states this.

    Raises
    ------
    DataError
        The model is refused; the message names file and key.
    """
    document = read_json(path)
    if not isinstance(document, dict) or document.get("format") not in (FORMAT, WITH_CARRIED):
        raise DataError(
            "is not a model file.", do=f'It must hold "format": "{FORMAT}" or "{WITH_CARRIED}".', file=path
        )
    notes = refuse_changed(document, path)
    try:
        saved = _saved(document, path)
    except (TypeError, AttributeError, ValueError, IndexError) as error:
        if isinstance(error, DataError):
            raise
        raise DataError(
            f"is damaged ({error}).", do="Write the model again with this version.", file=path
        ) from error
    except KeyError as error:
        raise DataError(
            "key is missing, or names what this version does not know.",
            do="Write the model again with this version.",
            file=path,
            key=str(error.args[0]),
        ) from error
    robot = saved.model.robot
    if robot_file is not None or robot.name in built_in_robots():
        reference = load_robot(robot.name if robot_file is None else str(robot_file.absolute()))
        refuse_other_table(robot, reference, path)
        # Its capsules and estimated loads are those of today's robot file; models of older versions have none.
        robot = replace(
            robot,
            capsules=reference.capsules,
            loads=reference.loads,
            loads_estimated=reference.loads_estimated,
        )
        saved = replace(saved, model=replace(saved.model, robot=robot))
    else:
        notes += (
            f"The table and limits of '{robot.name}' are those of {path.name}; --robot FILE checks them.",
        )
    bounds = bounds or Bounds()
    of_campaign = [effect for effect in saved.model.effects if not effect.is_usable]
    model, estimate, _ = without(saved.model, saved.estimate, saved.covariance, of_campaign)
    refuse_unlikely(model, estimate, saved.usual, bounds, coupling=saved.coupling, file=path)
    if saved.regression is not None:
        refuse_unlikely_shift(saved.regression, robot, bounds.shift_mm, path)
    if saved.updates:
        notes += (
            f"{path.name} was updated by {len(saved.updates)} of its watches: its held-out error is from before.",
        )
    return replace(saved, notes=(*((SIMULATED,) if saved.simulated else ()), *notes))


def _saved(document: Mapping[str, Any], path: Path) -> CalibratedModel:
    """Build the model of a document.

    An invalid document leads to a DataError, or to the TypeError, KeyError or similar that its form causes.
    """
    robot = _robot(document["robot_table"], path)
    if document["robot"] != robot.name or document.get("robot_sha256", robot_hash(robot)) != robot_hash(
        robot
    ):
        raise DataError(
            f"is {document['robot']!r}, which is not the robot of robot_table.",
            do="Use the model of this robot as it was written.",
            file=path,
            key="robot",
        )

    def points(table: Mapping[str, Any], key: str) -> dict[str, Vector]:
        return {
            name: _vector(numbers_of(v, (3,), f"{key}.{name}", path, FARTHEST_MM))
            for name, v in table.items()
        }

    model = ModelStructure(
        robot=robot,
        effects=tuple(Effect.from_json(entry) for entry in document["effects"]),
        targets={
            series: points(own, f"tool_targets_mm.{series}")
            for series, own in document["tool_targets_mm"].items()
        },
        placements={
            name: rigid(pose, 4, f"placements.{name}", path) for name, pose in document["placements"].items()
        },
        station=_vector(numbers_of(document["station_mm"], (3,), "station_mm", path, FARTHEST_MM)),
        turns={
            name: rigid(turn, 3, f"tool_turns.{name}", path)
            for name, turn in document.get("tool_turns", {}).items()
        },
        anchors=points(document.get("base_targets_mm", {}), "base_targets_mm"),
    )
    if not model.targets:
        raise DataError("names no series.", do="Write the model again.", file=path, key="tool_targets_mm")
    refuse_effects(model, path)
    coupling, data, holds = document["joint_coupling"], document["data_sha256"], document["holds_for"]
    if coupling != "none" and coupling not in robot.joint_matrices:
        raise DataError(
            f"is {coupling!r}.", do="Use a joint matrix of the robot.", file=path, key="joint_coupling"
        )
    simulated = document.get("simulated", False)  # models of older versions do not state it
    if not isinstance(simulated, bool):
        raise DataError(f"is {simulated!r}.", do="Write the model again.", file=path, key="simulated")
    if not isinstance(data, str):
        raise DataError(f"is {data!r}.", do="Write the model again.", file=path, key="data_sha256")
    return CalibratedModel(
        model,
        estimate_of(document["parameters"], model, path),
        covariance_of(document["covariance_internal_units"], len(model.parameters), path),
        loads=parse_loads(document["loads"], robot.joints, path),
        gravity=_vector(numbers_of(document["gravity_base"], (3,), "gravity_base", path, _MOST_GRAVITY)),
        coupling=coupling,
        data_sha256=data,
        holds_for=_holds_for(holds, robot, path),
        held_out_rms_mm=_rms_of(document.get("held_out")),
        verified_rms_mm=_rms_of(document.get("verified")),
        began=_began(document),
        regression=regression_of(document["regression"], robot, path) if "regression" in document else None,
        simulated=simulated,
        noise_scale=float(numbers_of(document.get("noise_scale", 1.0), (), "noise_scale", path, _NOISIEST)),
        devices=_tables(document.get("device", []), "device", path),
        updates=_tables(document.get("updates", []), "updates", path),
        held_std=held_std_of(document["parameters"], model, path),
        dropped=dropped_of(document.get("dropped", []), path),
        left_open=LeftOpen.from_json(document[KEY], model, path) if KEY in document else None,
        sha256=content_hash(document),
    )


def _robot(table: dict[str, Any], path: Path) -> Robot:
    """Build the nominal robot as it was for the fit, regardless of later changes to its file."""
    matrices = {
        name: JointMatrix(tuple(tuple(row) for row in entry["matrix"]), tuple(entry["offset"]))
        for name, entry in table["joint_matrices"].items()
    }
    plain = {key: tuple(value) if isinstance(value, list) else value for key, value in table.items()}
    counts = {len(plain[key]) for key in ("alpha", "a", "theta", "d", "lower", "upper")}
    if len(counts) != 1 or plain["convention"] not in ("mdh", "dh"):
        raise DataError(
            "does not describe a robot.", do="Write the model again.", file=path, key="robot_table"
        )
    joints = counts.pop()
    plain["external"] = tuple((link, name) for link, name in table.get("external", []))
    loads = parse_loads(table["loads"], joints, path)
    capsules = parse_capsules(table.get("capsules", []), joints, path)
    robot = Robot(**{**plain, "loads": loads, "joint_matrices": matrices, "capsules": capsules})
    refuse_impossible(robot, path)
    return robot


def _holds_for(table: Any, robot: Robot, path: Path) -> dict[str, Any]:
    approach, air = table.get("approach"), table.get("temperature_c")
    if approach is not None and (len(approach) != robot.joints or not set(approach) <= set(_SIDES)):
        raise DataError(
            f"is {approach!r}.",
            do=f"Give one of {', '.join(_SIDES)} per joint.",
            file=path,
            key="holds_for.approach",
        )
    if air is not None:
        numbers_of(air, (), "holds_for.temperature_c", path, _HOTTEST_C)
    if table.get("absolute_accuracy", "unknown") not in ABSOLUTE_ACCURACY:
        raise DataError(
            f"is {table['absolute_accuracy']!r}.",
            do=f"Give one of {', '.join(ABSOLUTE_ACCURACY)}.",
            file=path,
            key="holds_for.absolute_accuracy",
        )
    if table.get("joints") is not None:
        numbers_of(table["joints"], (robot.joints, 2), "holds_for.joints", path)
    return table


def _tables(entries: Any, key: str, path: Path) -> tuple[Mapping[str, Any], ...]:
    if not isinstance(entries, list) or not all(isinstance(each, dict) for each in entries):
        raise DataError("is not a list of objects.", do="Write the model again.", file=path, key=key)
    return tuple(entries)


def _rms_of(table: Any) -> float | None:
    rms = None if table is None else table["error_mm"]["rms"]
    return float(rms) if isinstance(rms, int | float) else None


def _began(document: Mapping[str, Any]) -> str | None:
    """Return when the clock of the model began; None for an update, whose readings are others."""
    measured = document.get("measured")
    return None if measured is None or document.get("updates") else str(measured["began"])


def _vector(numbers: Array) -> Vector:
    x, y, z = (float(value) for value in numbers)
    return x, y, z

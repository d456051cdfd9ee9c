"""A workflow takes the same options from the command line, over HTTP and in Python.

This would catch: an option that one of the three has and the others lack, as when only the command knew what robots of
a type share.
"""

from __future__ import annotations

import inspect
from dataclasses import fields
from typing import Any

import pytest

import truepose
from service.commands.cell.select import select
from service.commands.models.compensate import compensate_command
from service.commands.models.diagnose import diagnose_command
from service.commands.models.identify import identify_command
from service.commands.models.sweeps import sweeps_command
from service.commands.models.validate import validate_command
from service.commands.watch import judge_command, plan_command, upkeep_command
from service.http.routes.work.program_routes import correct_program
from service.http.wire.bodies import (
    SelectionAsked,
    SweepsAsked,
    TargetsToCorrect,
    ToDiagnose,
    ToIdentify,
    ValidationAsked,
)
from service.http.wire.bodies.watches import UpkeepAsked, WatchPlanAsked, WatchRequestBody
from service.results.cell.selected import SelectionRequest
from service.results.judgement.validation import ValidationRequest
from service.results.models.diagnosed import DiagnosisRequest

# What has a meaning at one front only: files that a command writes or reads, a certificate of them, a job that is kept.
AT_THE_TERMINAL = {"json", "predictions", "model", "report", "follow_up", "dcc", "dcc_about", "preliminary"}
# Of a fit Python asks the result (`truepose.validate`, `Diagnosis.errors`).
LIMITS = {"accept_rms", "accept_max", "accept_zones", "accept_rms_mm", "accept_max_mm", "limits"}
# How the file of a model is read: `truepose.load` in Python; the service judges models of its own.
READING = {"robot", "largest_correction"}
DRAWING = {"picture"}
KEPT = {"save_anyway"}  # Python saves by a call of its own
OF_THE_SERVICE = {"cell"}  # the cell of the service, named as it starts
CALLS = {"data", "dataset_id", "progress", "any_cell"}


def names_of(of: Any) -> set[str]:
    """The names of the parameters of a function, or of the fields of a class."""
    if inspect.isfunction(of):
        return set(inspect.signature(of).parameters)
    if hasattr(of, "model_fields"):
        return set(of.model_fields)
    return {field.name for field in fields(of)}


def options(of: object) -> set[str]:
    """The names of the options of a fit."""
    return names_of(of) - AT_THE_TERMINAL - LIMITS - KEPT - OF_THE_SERVICE - CALLS - DRAWING


@pytest.mark.parametrize(
    "fronts",
    [
        (diagnose_command, ToDiagnose, truepose.diagnose, DiagnosisRequest),
        (identify_command, ToIdentify, truepose.identify),
        (sweeps_command, SweepsAsked, truepose.sweeps),
    ],
    ids=["diagnose", "identify", "sweeps"],
)
def test_three_fronts_have_the_same_options(fronts: tuple[object, ...]) -> None:
    first, *others = fronts
    assert options(first)
    for other in others:
        assert options(other) == options(first)


def test_a_validation_has_the_same_options() -> None:
    """Limits included; `_id` and `_mm` say over HTTP what a value is."""

    def of(front: object, without: set[str]) -> set[str]:
        return {name.removesuffix("_id").removesuffix("_mm") for name in names_of(front) - without}

    wanted = of(validate_command, AT_THE_TERMINAL - {"model"} | READING | DRAWING | {"data"})
    assert len(wanted) == 8
    assert of(ValidationAsked, {"dataset_id"}) == wanted
    assert of(truepose.validate, {"data"}) == wanted
    asked = {*(f.name for f in fields(ValidationRequest)), "model", "compare"}
    assert asked == {name for name in wanted if not name.startswith("accept")} | {"limits"}


def test_a_selection_has_the_same_options() -> None:
    wanted = {field.name for field in fields(SelectionRequest)}
    assert names_of(select) - {"cell", "out", "json"} == wanted
    assert {name.removesuffix("_mm") for name in names_of(SelectionAsked)} == wanted
    assert names_of(truepose.select) - {"cell"} == wanted


def test_corrections_have_the_same_options() -> None:
    """Programs are corrected at the terminal and over HTTP; Python corrects joints.

    Python has single conditions as arguments.
    """
    files = {"model", "program", "out", "robot", "json", "here", "job_id"}
    largest = {"largest_deg", "largest_mm"}
    over_http = names_of(correct_program) - files - largest
    assert {name.removesuffix("_mm") for name in over_http} == names_of(compensate_command) - files - {
        "largest_correction"
    }
    assert largest < names_of(correct_program)
    of_programs = {"frame", "pulses", "external_apart"}
    assert names_of(TargetsToCorrect) - {"csv", "targets"} == over_http - of_programs | largest
    conditions = {"side", "approach_deg", "temperature_c", "time_s", "series"}
    joints = {"model", "joints_deg", "target", "limits_deg"}
    options = over_http - of_programs - {"conditions", "tool", "keep_refused"}
    assert names_of(truepose.compensate) - joints - conditions == {
        name.removesuffix("_mm") for name in options
    }


def test_a_watch_has_the_same_options_at_the_terminal_and_over_http() -> None:
    """Over HTTP the history is that of the service, and the updated model is kept with the job."""
    at_the_terminal = {"model", "data", "cell", "out", "robot", "json", "history", "update"}
    over_http = {"model_id", "model_document", "dataset_id", "run_id", "average"}
    other_names = {"rate": "false_alarms", "rounds": "visits", "repeats": "readings"}
    by_hand = {"touch", "touch_mm"}  # a person touches balls; such campaigns are planned at the terminal
    for command, body, without in (
        (plan_command, WatchPlanAsked, by_hand),
        (judge_command, WatchRequestBody, set[str]()),
        (upkeep_command, UpkeepAsked, set[str]()),
    ):
        own = {other_names.get(name, name) for name in names_of(command) - at_the_terminal}
        assert own - without == names_of(body) - over_http


def test_what_is_left_out_over_http_is_as_at_the_terminal() -> None:
    usual = DiagnosisRequest()
    assert ToDiagnose.model_fields["most"].default == usual.most
    assert ToDiagnose.model_fields["patch"].default == usual.patch

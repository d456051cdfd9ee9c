"""A diagnosis and an identification take the same options from the command line, over HTTP and in Python.

This would catch: an option that one of the three has and the others lack, as when only the command knew what robots of
a type share.
"""

from __future__ import annotations

import inspect
from dataclasses import fields

import pytest

import truepose
from service.commands.models.diagnose import diagnose_command
from service.commands.models.identify import identify_command
from service.http.wire.bodies import ToDiagnose, ToIdentify
from service.results.models.diagnosed import DiagnosisRequest

# What has a meaning at one front only: files that a command writes or reads, a certificate of them, a job that is kept.
AT_THE_TERMINAL = {"json", "predictions", "model", "report", "follow_up", "dcc", "dcc_about", "preliminary"}
# Limits are numbers and a file there, a request here; Python asks the result (`truepose.validate`, `Diagnosis.errors`).
LIMITS = {"accept_rms", "accept_max", "accept_zones", "accept_rms_mm", "accept_max_mm", "limits"}
KEPT = {"save_anyway"}  # Python saves by a call of its own
OF_THE_SERVICE = {"cell"}  # the cell of the service, named as it starts
CALLS = {"data", "dataset_id", "progress", "any_cell"}


def options(of: object) -> set[str]:
    """The names of the parameters of a function, or of the fields of a class."""
    if inspect.isfunction(of):
        names = set(inspect.signature(of).parameters)
    elif hasattr(of, "model_fields"):
        names = set(of.model_fields)  # type: ignore[attr-defined]
    else:
        names = {field.name for field in fields(of)}  # type: ignore[arg-type]
    return names - AT_THE_TERMINAL - LIMITS - KEPT - OF_THE_SERVICE - CALLS


@pytest.mark.parametrize(
    "fronts",
    [
        (diagnose_command, ToDiagnose, truepose.diagnose, DiagnosisRequest),
        (identify_command, ToIdentify, truepose.identify),
    ],
    ids=["diagnose", "identify"],
)
def test_three_fronts_have_the_same_options(fronts: tuple[object, ...]) -> None:
    first, *others = fronts
    assert options(first)
    for other in others:
        assert options(other) == options(first)


def test_what_is_left_out_over_http_is_as_at_the_terminal() -> None:
    usual = DiagnosisRequest()
    assert ToDiagnose.model_fields["most"].default == usual.most
    assert ToDiagnose.model_fields["patch"].default == usual.patch

"""Test that a model worse than the nominal robot is saved by consent only.

Worse refers to the held-out readings and the nominal robot in its place.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from calib.data import Dataset, read_dataset
from calib.diagnose import DiagnosisFit, diagnose
from calib.errors import DataError
from calib.model import BoundModel
from calib.saved import load_model, refuse_worse, save_model
from service.cli import main
from tests.calib.campaigns import simulate, write_files


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Dataset, DiagnosisFit]:
    folder = tmp_path_factory.mktemp("worse")
    _, data = simulate(folder, seed=3, n=70, n_validation=20, effects=[])
    return data, diagnose(data)


def worse(diagnosis: DiagnosisFit) -> DiagnosisFit:
    """Return the diagnosis with a model error that is ten times that of the nominal robot."""
    nominal, faults = diagnosis.error_nominal, diagnosis.held_out_faults
    assert nominal is not None
    return replace(
        diagnosis, held_out_faults=replace(faults, error_without=replace(nominal, rms=10.0 * nominal.rms))
    )


def test_a_worse_model_is_refused_with_both_figures(
    diagnosed: tuple[Dataset, DiagnosisFit], tmp_path: Path
) -> None:
    found = worse(diagnosed[1])
    assert found.worse_than_nominal
    assert found.error_nominal is not None
    with pytest.raises(DataError) as refused:
        save_model(tmp_path / "model.json", found.final, found)
    assert f"{found.error_nominal.rms:.3f}" in refused.value.what
    assert f"{10.0 * found.error_nominal.rms:.3f}" in refused.value.what
    assert not (tmp_path / "model.json").exists()


def test_a_worse_model_is_saved_by_consent(diagnosed: tuple[Dataset, DiagnosisFit], tmp_path: Path) -> None:
    found = worse(diagnosed[1])
    save_model(tmp_path / "model.json", found.final, found, save_anyway=True)
    assert len(load_model(tmp_path / "model.json").estimate) == len(found.final.estimate)


def test_a_better_model_and_one_without_held_out_readings_are_saved(
    diagnosed: tuple[Dataset, DiagnosisFit], tmp_path: Path
) -> None:
    found = diagnosed[1]
    assert not found.worse_than_nominal
    save_model(tmp_path / "model.json", found.final, found)
    refuse_worse(None, found.error_after)
    refuse_worse(found.error_nominal, None)


@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_the_commands_ask_for_consent(command: str, tmp_path: Path) -> None:
    """The commands ask for consent if held-out readings are of another base position.

    Any fit misses these; the nominal robot misses them a little less.
    """
    campaign, _ = simulate(tmp_path, seed=3, n=70, n_validation=20, effects=[])
    rows = [dict(row) for row in campaign.rows]
    data = write_files(tmp_path, rows, campaign.header)
    dataset = read_dataset(data)
    found = diagnose(dataset)
    toward = BoundModel(found.nominal, dataset.conditions).predict(found.nominal_estimate)
    for row, point in zip(rows, toward, strict=True):
        if row["set"] == "validation":
            row |= dict(zip(("x_mm", "y_mm", "z_mm"), point.tolist(), strict=True))
    data = write_files(tmp_path, rows, campaign.header)
    model = tmp_path / "model.json"
    asked = [command, str(data), "--model", str(model)]
    assert main(asked) == 2
    assert not model.exists()
    assert main([*asked, "--save-anyway"]) == 0
    assert model.exists()

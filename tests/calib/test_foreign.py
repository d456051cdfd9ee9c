"""Measurements as people export them (`tests.calib.exports`): read right, or refused with the right remedy.

These would catch: a separator, decimal, encoding, unit, convention, target or pairing read wrongly, a question that is
guessed in place of asked, and a cell that is passed over in silence.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.data.header import header_of
from calib.data.read import dataset_of
from calib.errors import DataError
from calib.foreign import converted, propose, read_map, text_of
from calib.text.columns import Columns
from calib.text.toml_text import parse_toml
from calib.units import DEG
from tests.calib.exports import CASES, ROBOT, TRUTH, Case, N


def converted_text(case: Case, folder: Path) -> tuple[str, str]:
    """CSV and header of a case, the map kept in a file between proposing and converting. Raises DataError."""
    files = case.write(folder)
    first = propose(files, {"robot": ROBOT, **{k: v for k, v in case.answers.items() if k == "robot"}})
    if first.missing:
        raise DataError(f"no file holds {' and '.join(first.missing)}.", do="Give the file.", file=files[0])
    assert {question.key for question in first.questions} == set(case.asks)
    proposal = propose(files, {**case.answers, "robot": ROBOT}) if case.asks else first
    assert not proposal.questions
    kept = folder / "map.toml"
    kept.write_text(text_of(proposal.made, ["kept"]), encoding="utf-8")
    table = converted(read_map(kept), files, kept, folder).table
    return table.text, table.header


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_a_file_is_read_right_or_refused_with_its_remedy(case: Case, tmp_path: Path) -> None:
    if case.refuses:
        with pytest.raises(DataError, match=case.refuses):
            converted_text(case, tmp_path)
        return
    csv, header = converted_text(case, tmp_path)
    data = dataset_of(
        Columns.of_text(csv, tmp_path / "out.csv"),
        header_of(parse_toml(header, "h"), tmp_path / "out.toml", header),
    )
    row, target = np.repeat(np.arange(N), case.targets), np.tile(np.arange(case.targets), N)
    assert len(data) == N * case.targets
    np.testing.assert_allclose(data.conditions.joints / DEG, joints_of(case)[row], atol=2e-5)
    lost = np.isin(row, case.lost)
    np.testing.assert_allclose(data.points[~lost], TRUTH.points[row, target][~lost], atol=case.within)
    assert np.isnan(data.points[lost]).all()
    assert (data.usable == ~(lost | np.isin(row, case.rejected))).all()
    assert np.isfinite(data.orientation).all() == case.turned
    if case.turned:
        turns = Rotation.from_quat(data.orientation, scalar_first=True)
        assert (turns.inv() * Rotation.from_quat(TRUTH.turns, scalar_first=True)).magnitude().max() < 1e-5
    if case.targets > 1:
        names = np.array(data.conditions.target_names)[data.conditions.target]
        assert names.tolist() == [f"T{t + 1}" for t in target]


def joints_of(case: Case) -> np.ndarray:
    return np.round(TRUTH.joints) if case.name == "thousands_unclear" else TRUTH.joints


def test_as_many_files_as_were_promised() -> None:
    assert len(CASES) >= 30

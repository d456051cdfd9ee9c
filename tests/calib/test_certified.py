"""Test certified problems.

Their answers come from a second implementation in fifty digits that shares no line with the program. They would
catch a wrong model, derivative, weight or standard error in any kind of reading. Vectors of the thesis's model, the
truth, and the files of the reference would catch a wrong reference.
"""

from __future__ import annotations

import json
import subprocess
import sys
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from calib import identify, read_dataset
from calib.fit import uncertainty_map
from calib.units import to_display
from tests.certified.digits import PROBLEMS, count, table
from tests.reference.adjustment import adjust
from tests.reference.chain import gravity_torques, target_frame
from tests.reference.decimals import degrees, precise
from tests.reference.files import FOLDER, make
from tests.reference.problem import read_problem
from tests.reference.problems import PLANS
from tests.reference.robots import IRB120, LR_MATE

VECTORS = json.loads((Path(__file__).parent.parent / "vectors" / "fk_thesis.json").read_text("utf-8"))[
    "vectors"
][::3]
SLOTS = [f"base.{k}" for k in ("x", "y", "z", "rx", "ry", "rz")] + [
    f"{kind}{k}" for k in range(2, 7) for kind in ("alpha", "a", "theta", "d")
]


def certified(name: str) -> dict[str, dict[str, Decimal]]:
    """Name of a parameter -> truth, estimate and standard error."""
    rows = json.loads((FOLDER / f"{name}.json").read_text("utf-8"))["parameters"]
    return {
        p: {key: Decimal(row[key]) for key in ("truth", "estimate", "standard_error")}
        for p, row in rows.items()
    }


class TestProgram:
    def test_every_problem_is_there(self) -> None:
        assert set(PROBLEMS) == set(PLANS)

    @pytest.mark.parametrize("name", PROBLEMS)
    def test_ten_digits(self, name: str) -> None:
        """Parameters, standard errors and the sum of squares agree to ten digits."""
        got = count(name)
        assert got.converged
        assert min(got.values.values()) >= 10.0, got.values
        assert min(got.errors.values()) >= 10.0, got.errors
        assert got.sum_of_squares >= 10.0

    @pytest.mark.parametrize("name", PROBLEMS)
    def test_identify_ends_there_too(self, name: str) -> None:
        """`identify` agrees although it has priors, robust weights and an early stop.

        It stops at 0.02 standard errors. No reading is left out.
        """
        result = identify(read_dataset(FOLDER / f"{name}.csv"))
        rows = certified(name)
        assert (result.dropped, result.faulty_rows, result.relabelled_rows) == ((), (), ())
        for i, p in enumerate(result.model.parameters):
            if result.model.turns and p.name.startswith("T1.r"):
                continue  # counts from an orientation found, not from the nominal one
            error = float(rows[p.name]["standard_error"])
            off = to_display(float(result.estimate[i]), p.unit) - float(rows[p.name]["estimate"])
            assert abs(off) < 0.05 * error, p.name
            found = to_display(float(result.standard_errors[i]), p.unit) / max(result.noise_scale, 1.0)
            assert found == pytest.approx(error, rel=0.003), p.name

    def test_table(self) -> None:
        """Shown by `pytest -s` and by `python -m tests.reference --table`."""
        text = table()
        sys.stdout.write(f"\n{text}\n")
        assert [line.split()[0] for line in text.splitlines()[2:]] == list(PROBLEMS)


class TestReference:
    def test_it_imports_nothing_of_the_program(self) -> None:
        code = (
            "import sys, tests.reference.files; "
            "print(*{m.partition('.')[0] for m in sys.modules}"
            " & {'calib', 'drivers', 'acquisition', 'service', 'mocks'})"
        )
        found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        assert found.stdout.strip() == ""

    @pytest.mark.parametrize("name", sorted(PLANS))
    def test_the_truth_lies_where_the_standard_errors_say(self, name: str) -> None:
        """Whitened with the reference's own noise, estimates scatter about the truth as they should."""
        rows = certified(name).values()
        off = np.array([float((row["estimate"] - row["truth"]) / row["standard_error"]) for row in rows])
        table = json.loads((FOLDER / f"{name}.json").read_text("utf-8"))
        if not PLANS[name].noisy:
            assert np.abs(off).max() < 1e-9
            return
        assert np.abs(off).max() < 4.5
        assert 1e-3 < chi2.sf(float(table["sum_of_squares"]), table["degrees_of_freedom"]) < 1.0 - 1e-3

    def test_files_are_made_again_to_the_last_byte(self, tmp_path: Path) -> None:
        make("irb120_exact", tmp_path)
        for kind in ("csv", "toml", "json"):
            again = (tmp_path / f"irb120_exact.{kind}").read_text("utf-8")
            assert again == (FOLDER / f"irb120_exact.{kind}").read_text("utf-8")

    @pytest.mark.parametrize("name", PROBLEMS)
    def test_every_problem_has_a_map_of_its_uncertainty(self, name: str) -> None:
        """Every problem has an uncertainty map, even if its series have separate tool targets."""
        found = uncertainty_map(identify(read_dataset(FOLDER / f"{name}.csv")))
        assert np.all(found.u > 0.0)
        assert np.all(np.isfinite(found.radius_95))

    def test_points_poses_and_lengths_end_where_they_are_certified_to(self) -> None:
        """One step from the certified numbers moves none of them by a digit that is printed."""
        stored = certified("irb120_mixed")
        problem = read_problem(FOLDER / "irb120_mixed.csv")
        found = adjust(problem, {p: row["estimate"] for p, row in stored.items()}, Decimal("1e-12"))
        assert found.iterations == 1
        for p, row in stored.items():
            assert abs(found.estimate[p] - row["estimate"]) <= Decimal("1e-18") * abs(row["estimate"])
            assert (
                abs(found.standard_error[p] - row["standard_error"])
                <= Decimal("1e-15") * row["standard_error"]
            )

    @pytest.mark.parametrize("case", VECTORS, ids=lambda case: f"{case['robot']} {case['q_deg'][0]}")
    @precise
    def test_chain_and_torque_give_the_vectors_of_the_thesis(self, case: dict[str, Any]) -> None:
        arm = {"IRB120": IRB120, "LRMATE200iC": LR_MATE}[case["robot"]]
        angles = [degrees(Decimal(q)) for q in case["q_deg"]]
        loads = [(link, Decimal(mass), np.array([Decimal(x) for x in cog])) for link, mass, cog in arm.loads]
        torques = gravity_torques(arm, angles, loads)
        add = {name: Decimal(value) for name, value in zip(SLOTS, case.get("p31", ()), strict=False)}
        for k, c in enumerate(case.get("p31", ())[26:], start=2):
            add[f"theta{k}"] += Decimal(c) * torques[k - 1]
        pose = target_frame(arm, angles, add).astype(np.float64)
        np.testing.assert_allclose(pose[:3, 3], np.array(case["T_world_flange"])[:3, 3], rtol=0, atol=1e-9)
        np.testing.assert_allclose(pose[:3, :3], np.array(case["T_world_flange"])[:3, :3], rtol=0, atol=1e-12)
        np.testing.assert_allclose(np.array(torques, dtype=np.float64), case["tau_Nmm"], rtol=0, atol=1e-6)

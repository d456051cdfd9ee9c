"""Diagnoses in Python: effects that the base model lacks, with evidence, rivals and power."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from acquisition.cell import read_cell
from calib.diagnose import MOST_EFFECTS, DiagnosisFit
from calib.fit import ErrorStatistics, silent
from calib.prior import load_prior
from calib.saved import as_saved
from calib.text import replace_file
from calib.units import to_display
from service import wording
from service.results.models.diagnosed import DiagnosisOutcome, DiagnosisRequest
from truepose.data import Data, data_of
from truepose.frames import frame_of_rows
from truepose.model import Model

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Diagnosis:
    """The findings of a diagnosis.

    `outcome` is the same for the packages below.

    >>> found = truepose.diagnose("irb120.csv")
    >>> found.verdict
    'attributed'
    >>> found.effects[["value", "std", "unit"]].round(3)
                         value    std unit
    effect
    backlash:j4          0.144  0.002  deg
    >>> found.errors["rms"].round(3).to_dict()  # mm, on validation rows
    {'nominal': 1.335, 'base model': 0.272, 'with effects': 0.038}
    """

    outcome: DiagnosisOutcome

    @property
    def findings(self) -> DiagnosisFit:
        """The diagnosis of `calib`."""
        return self.outcome.diagnosis

    @property
    def carry_over(self) -> str:
        """Whether the effects hold on the other data set, as text; empty without one."""
        return "" if self.outcome.carried is None else self.outcome.carried.finding

    def __repr__(self) -> str:
        return f"<diagnosis of {self.findings.dataset.name}: {self.sentence}>"

    def _repr_html_(self) -> str:
        known = "" if self.findings.causes_known else "<p>Imitated by:</p>"
        return f"<p>{self.sentence}</p>{known}{self.effects.to_html(float_format=lambda x: f'{x:.4g}')}"

    @property
    def verdict(self) -> str:
        """complete, attributed, ambiguous, unexplained or excess_noise."""
        return self.findings.verdict

    @property
    def sentence(self) -> str:
        """The verdict as text, with its gain."""
        return wording.verdict_in_words(self.findings)

    @property
    def model(self) -> Model:
        """The robot with the effects that were found."""
        found = self.findings
        return Model(as_saved(found.final, found), found.final, Data(found.dataset), found)

    @property
    def base(self) -> Model:
        """The robot before the search: its base model."""
        found = self.findings
        return Model(as_saved(found.base), found.base, Data(found.dataset))

    @property
    def effects(self) -> pandas.DataFrame:
        """Table of the effects found, one row per parameter.

        Columns are label, parameter, value, std, unit, usual_size, p_value and explained variance. Others are whether
        its size is confirmed (exceeds U), and whether it may only imitate an unknown law. The last are the rivals
        that these readings cannot distinguish it from, with their weights. usual_size is that of the whole effect, in
        the unit of its amplitude.
        """
        rows = [
            {
                "effect": found.effect.label,
                "parameter": parameter.name,
                "value": to_display(float(value), parameter.unit),
                "std": to_display(float(variance) ** 0.5, parameter.unit),
                "unit": parameter.unit,
                "usual_size": found.usual,
                "p_value": found.evidence.p_value,
                "explained_variance": found.evidence.explained_variance,
                "confirmed": found.confirmed,
                "imitates": not self.findings.causes_known,
                "rivals": {k: w for k, w in found.evidence.candidates.items() if k != found.effect.label},
            }
            for found in self.findings.effects
            for parameter, value, variance in zip(
                found.effect.parameters, found.values, found.covariance.diagonal(), strict=True
            )
        ]
        columns = (
            *("parameter", "value", "std", "unit", "usual_size", "p_value", "explained_variance"),
            *("confirmed", "imitates", "rivals"),
        )
        return frame_of_rows(rows, columns, "effect")

    @property
    def next_measurements(self) -> tuple[str, ...]:
        """Sentences on the next measurements; empty if the causes are known."""
        return self.findings.next_measurements

    @property
    def errors(self) -> pandas.DataFrame:
        """Ladder of errors on validation rows, mm: n, rms, mean, p95, max.

        Rows are nominal, base model, named effects (if terms are carried), and with effects (carried terms included).
        """
        found = self.findings
        steps: dict[str, ErrorStatistics | None] = {
            "nominal": found.error_nominal,
            "base model": found.error_before,
            "named effects": found.error_named if found.carried else None,
            "with effects": found.error_after,
        }
        columns = ("n", "rms", "mean", "p95", "max")
        rows = [
            {"model": name, **{key: getattr(step, key) for key in columns}}
            for name, step in steps.items()
            if step is not None
        ]
        return frame_of_rows(rows, columns, "model")

    @property
    def power(self) -> pandas.DataFrame:
        """Smallest detectable size of every effect that was looked for.

        These readings would have shown it 95 times in 100.
        """
        rows = [{"effect": v.label, "smallest": v.size, "unit": v.unit} for v in self.findings.power]
        return frame_of_rows(rows, ("smallest", "unit"), "effect")

    @property
    def document(self) -> dict[str, Any]:
        """The document that `truepose diagnose --json` writes."""
        return self.outcome.document()

    def report(self, path: str | Path) -> Path:
        """Write the report, one HTML file.

        Raises
        ------
        OSError
            The file cannot be written.
        """
        from service.report import diagnosis_report  # drawing takes long to import

        outcome = self.outcome
        page = diagnosis_report(outcome.diagnosis, self.document, outcome.carried, outcome.patched)
        replace_file(Path(path), page)
        return Path(path)

    def plot_residuals(self) -> Figure:
        """Draw the errors before and after on all measured readings."""
        from truepose.pictures import before_and_after

        return before_and_after(self.base.residuals, self.model.residuals)


def diagnose(
    data: Data | str | Path,
    *,
    most: int = MOST_EFFECTS,
    prior: str | Path | None = None,
    carry_to: Data | str | Path | None = None,
    patch: bool = False,
    cell: str | Path | None = None,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Find effects that the base model of a data set lacks.

    Parameters
    ----------
    most :
        Largest number of effects that may be added.
    prior :
        File of the statistics of this robot type (`truepose fleet learn`).
    carry_to :
        Another data set of the robot, on which the effects are judged as well.
    patch :
        Whether the remaining residuals are mapped.
    cell :
        Cell file within which the next poses are proposed.
    progress :
        Called with the text of each step.

    Raises
    ------
    DataError
        The data, the prior or the cell cannot be used.

    >>> print(truepose.diagnose("irb120.csv").sentence)
    Found 1 effect that the base model lacks: play of joint 4. ...
    """
    asked = DiagnosisRequest(
        most=most,
        prior=None if prior is None else load_prior(Path(prior)),
        carry_to=None if carry_to is None else data_of(carry_to).dataset,
        patch=patch,
        cell=None if cell is None else read_cell(Path(cell)),
    )
    return Diagnosis(DiagnosisOutcome.of(data_of(data).dataset, asked, progress or silent))

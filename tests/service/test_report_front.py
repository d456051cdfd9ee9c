"""The first page of a report: its figures, what it must not state, and that it prints on one sheet.

These would catch: a figure that is not the result's, a verdict without limits, a proof that nobody measured, a cause
that the readings do not show, and a page that cannot be signed because its last lines are on the second sheet.
"""

from __future__ import annotations

import base64
import html
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from acquisition.record import Verification
from calib.data import Dataset, read_dataset
from calib.diagnose import DiagnosisFit, ResidualStructure, diagnose
from calib.fit import ErrorStatistics
from calib.saved import as_saved
from service.cli import main
from service.exports import listed
from service.report import diagnosis_report
from service.report.certificate import CertificateParties
from service.report.front import who_of
from service.results.judgement.acceptance import AcceptanceLimits, AcceptanceResult, Zone, decide
from service.results.models.diagnosed import DiagnosisOutcome
from service.wording import millimetres
from tests.service.browser import CHROMIUM, browser
from tests.service.campaigns import edit_rows, edit_text, write_data, write_narrow_data
from tests.service.workplace import violations

LONG = "Gesellschaft for Welding and Joining of Structures " * 4


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> DiagnosisFit:
    return diagnose(read_dataset(write_data(tmp_path_factory.mktemp("known"))))


@pytest.fixture(scope="module")
def narrow(tmp_path_factory: pytest.TempPathFactory) -> DiagnosisFit:
    return diagnose(read_dataset(write_narrow_data(tmp_path_factory.mktemp("narrow"))))


def errors(rms: float) -> ErrorStatistics:
    return ErrorStatistics(n=60, rms=rms, mean=0.9 * rms, p95=1.7 * rms, max=2.5 * rms)


def driven(floor_mm: float = 0.039) -> Verification:
    return Verification(
        uncorrected=errors(1.642),
        verified=errors(0.0443),
        floor_mm=floor_mm,
        poses=20,
        refused=(),
        nests_off_mm=0.0,
        approach="from below",
    )


def decided(diagnosis: DiagnosisFit, rms: float, *zones: Zone) -> AcceptanceResult:
    data, limits = diagnosis.dataset, AcceptanceLimits(rms, 3.0 * rms, zones)
    final = (diagnosis.final.model, diagnosis.final.estimate)
    return decide(limits, data, data.validation_rows, *final, "base model with the effects found")


def page_of(
    diagnosis: DiagnosisFit,
    *,
    acceptance: AcceptanceResult | None = None,
    verified: Verification | None = None,
    parties: CertificateParties | None = None,
) -> str:
    return diagnosis_report(
        diagnosis,
        DiagnosisOutcome(diagnosis).document(),
        acceptance=acceptance,
        verified=verified,
        parties=parties,
    )


def front_of(page: str) -> str:
    """The text of the first page, without elements."""
    found = re.search(r'<article class="front".*?</article>', page, re.DOTALL)
    assert found is not None
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", found[0])).split())


def test_its_figures_are_those_of_the_result(known: DiagnosisFit) -> None:
    acceptance = decided(known, 0.1)
    text = front_of(page_of(known, acceptance=acceptance, verified=driven()))
    nominal, base, after = known.error_nominal, known.error_before, known.error_after
    assert nominal is not None
    assert base is not None
    assert after is not None
    assert f"{nominal.rms:.2f} → {after.rms:.2f} mm" in text
    assert f"on {after.n} readings that took no part" in text
    for each in (nominal, base, after):
        assert f" {millimetres(each.rms)} mm" in text
    assert f"the largest {millimetres(nominal.max)} mm" in text
    assert f"the largest {millimetres(after.max)} mm" in text
    assert "Accepted" in text
    for criterion in acceptance.criteria:
        assert " ".join((criterion.name, *criterion.shown, f"{criterion.limit:g}")) in text
    assert "at 20 new poses: 1.642 → 0.044 mm RMS" in text
    assert "Play of joint 4" in text
    assert "Not verified" not in text
    assert "Prove it" not in text


def test_what_was_not_measured_is_not_stated(tmp_path: Path) -> None:
    data = write_data(tmp_path)
    edit_rows(data, lambda rows: [row.update(set="calibration") for row in rows])
    edit_text(data.with_suffix(".toml"), "simulated = true", "simulated = false")
    report = tmp_path / "report.html"
    for command in ("diagnose", "identify"):
        assert main([command, str(data), "--report", str(report), "--overwrite"]) == 0
        page = report.read_text("utf-8")
        text = front_of(page)
        assert "→" not in text
        assert 'class="front-steps"' not in page
        assert "Not judged" in text
        assert "Keep readings aside" in text
        assert "No limits set" in text
        assert "ccepted" not in text
        assert "Not verified on the robot" in text
        assert "SIMULATED" not in text
    assert "Not looked for" in text


def test_a_calibration_without_readings_kept_aside_is_judged_by_what_the_robot_showed(tmp_path: Path) -> None:
    data = write_data(tmp_path)
    edit_rows(data, lambda rows: [row.update(set="calibration") for row in rows])
    text = front_of(page_of(diagnose(read_dataset(data)), verified=driven()))
    assert "1.64 → 0.04 mm" in text
    assert "at 20 new poses: 1.642 → 0.044 mm RMS" in text
    assert "Measured, uncorrected" in text
    for without in ("Not judged", "Keep readings aside", "Kept aside:", "Prove it"):
        assert without not in text


def test_a_report_without_limits_or_proof_says_so_and_simulation_is_marked(known: DiagnosisFit) -> None:
    text = front_of(page_of(known))
    assert "No limits set Neither accepted nor rejected." in text
    assert "Predicted by the model. Not verified on the robot" in text
    assert text.startswith("SIMULATED")
    assert "Measured on the simulated robot" in front_of(page_of(known, verified=driven()))


def test_a_model_that_is_worse_is_not_praised(known: DiagnosisFit) -> None:
    text = front_of(page_of(replace(known, error_after=errors(2.9), error_named=errors(2.9))))
    assert "MORE: it is worse than before" in text
    assert "not carry over to the held-out readings" in text
    missed = front_of(page_of(known, acceptance=decided(known, 0.001), verified=driven(floor_mm=0.01)))
    assert "Rejected" in missed
    assert "Do not release the robot" in missed
    assert "Run corrected programs" not in missed
    assert "does not reach what the readings allow" in missed


@pytest.mark.parametrize("verdict", ["unexplained", "excess_noise"])
def test_a_cause_that_is_not_known_is_not_named(known: DiagnosisFit, verdict: str) -> None:
    left = (ResidualStructure("side of approach of joint 4", 1e-9, 0.4, "joint 4"),)
    text = front_of(page_of(replace(known, verdict=verdict, structure=left)))
    assert "Not explained" in text
    assert "The cause" not in text
    assert "What to check" not in text
    assert "Measure again" in text


def test_causes_that_look_alike_are_listed_with_their_weights(narrow: DiagnosisFit) -> None:
    text = front_of(page_of(narrow))
    found = narrow.effects[0]
    assert f"One of {len(found.evidence.candidates)} causes that look alike" in text
    for weight in found.evidence.candidates.values():
        assert f"{100.0 * weight:.0f}\u00a0%" in text or f"{100.0 * weight:.0f} %" in text
    assert narrow.follow_up is not None
    assert f"Measure {len(narrow.follow_up.joints)} more poses" in text


def test_the_header_is_filled_from_what_is_known_and_blank_elsewhere(known: DiagnosisFit) -> None:
    blank = dict(who_of(known.dataset, CertificateParties(), fitted=80))
    assert [blank[what] for what in ("Customer", "Place", "Robot serial number", "Measured on")] == [""] * 4
    assert "abb-irb120" in blank["Robot"]
    about = CertificateParties("Lab North", "Dresden", "DE", "Acme <Welding>", "R. Roe")
    page = page_of(known, parties=about)
    text = front_of(page)
    assert all(each in text for each in ("Lab North", "Dresden", "Acme <Welding>", "R. Roe"))
    assert "not stated" not in text
    assert re.search(r"TP-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}", text)
    assert page.count('<dl class="signature"') == 1


def test_parties_are_read_for_a_report_alone(tmp_path: Path) -> None:
    data, about, report = write_data(tmp_path), tmp_path / "about.toml", tmp_path / "r.html"
    about.write_text('customer = "Acme Welding"\n', "utf-8")
    for command in ("identify", "diagnose"):
        assert (
            main([command, str(data), "--report", str(report), "--dcc-parties", str(about), "--overwrite"])
            == 0
        )
        assert "Acme Welding" in front_of(report.read_text("utf-8"))
        assert main([command, str(data), "--dcc-parties", str(about)]) == 2


def test_the_contents_lead_to_every_section(known: DiagnosisFit) -> None:
    page = page_of(known, verified=driven())
    contents = re.findall(r'<li><a href="#([^"]+)">(.*?)</a></li>', page)
    headings = re.findall(r'<h2 id="([^"]+)">(.*?)</h2>', page)
    assert contents == headings
    assert "Verified on the robot" in [title for _, title in contents]
    assert contents[-1][1] == "What a file for another program leaves"


def test_the_last_section_states_what_every_export_leaves(known: DiagnosisFit) -> None:
    section = page_of(known).rpartition("What a file for another program leaves")[2]
    choices = listed(*as_saved(known.final, known).for_use(), "")
    assert all(html.escape(line) in section for line in choices.refusals)
    for each in choices.written:
        row = section.partition(f"<code>{each.kind}</code>")[2].partition("</tr>")[0]
        assert html.escape(each.lost) in row
        assert (each.left_mm is None) or f"{millimetres(each.left_mm)}</td>" in row


def test_a_validation_shows_the_errors_of_its_result(tmp_path: Path) -> None:
    data, model, result = write_data(tmp_path), tmp_path / "m.json", tmp_path / "v.json"
    assert main(["diagnose", str(data), "--model", str(model)]) == 0
    report = tmp_path / "v.html"
    order = ["validate", str(data), "--model", str(model), "--report", str(report), "--json", str(result)]
    assert main(order) == 0
    text, judged = front_of(report.read_text("utf-8")), json.loads(result.read_text("utf-8"))["judgements"]
    assert "Robot validation report" in text
    assert f"{judged[0]['position_mm']['rms']:.2f} → {judged[1]['position_mm']['rms']:.2f} mm" in text
    assert f"Model m {judged[1]['position_mm']['rms']:.3f} mm" in text
    assert "The cause" not in text


def named(data: Dataset) -> Dataset:
    """The readings of a robot and an instrument with long names."""
    devices = tuple(
        {"role": role, "maker": LONG, "model": LONG, "serial": 9 * "0123456789"}
        for role in ("robot", "instrument")
    )
    return replace(data, header=replace(data.header, devices=devices))


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
def test_it_prints_on_one_sheet_and_axe_finds_nothing(
    known: DiagnosisFit, narrow: DiagnosisFit, tmp_path: Path
) -> None:
    zones = tuple(Zone(f"table {k}", (-1e3, -1e3, -1e3), (1e3, 1e3, 1e3), 0.1, 0.3) for k in range(3))
    parties = CertificateParties(LONG, LONG, "DE", LONG, LONG)
    left = (ResidualStructure("side of approach of joint 4", 1e-9, 0.4, "joint 4"),)
    long = replace(narrow, dataset=named(narrow.dataset), harmful=("periodic:j5:n2", "base_shift") * 3)
    pages = {
        "usual": page_of(known, acceptance=decided(known, 0.1), verified=driven()),
        "unexplained": page_of(replace(known, verdict="unexplained", structure=left), parties=parties),
        "longest": page_of(
            long, acceptance=decided(long, 0.001, *zones), verified=driven(floor_mm=0.001), parties=parties
        ),
    }
    for name, text in pages.items():
        (tmp_path / f"{name}.html").write_text(text, "utf-8")
    with browser(f"file://{tmp_path}/usual.html", tmp_path / "browser") as page:
        for name in pages:
            page.open(f"file://{tmp_path}/{name}.html")
            for scheme in ("light", "dark"):
                feature = {"name": "prefers-color-scheme", "value": scheme}
                page.do("Emulation.setEmulatedMedia", features=[feature])
                assert not (found := violations(page)), (name, scheme, found)
            page.width(390)
            assert page.value("document.querySelector('.front').scrollWidth") <= 390, name
            page.width(1280)
            page.value("document.querySelectorAll('main > :not(.front)').forEach((each) => each.remove())")
            printed = page.do("Page.printToPDF", preferCSSPageSize=True, printBackground=True)["data"]
            assert len(re.findall(rb"/Type\s*/Page\b", base64.b64decode(printed))) == 1, name

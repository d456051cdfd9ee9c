"""A report as a document: number, date and operator of the measurement, hashes, signatures."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from calib import DataError, read_dataset
from service.cli import main
from service.report.certificate import hash_of, number_of, paper_of
from tests.service.campaigns import write_data

MEASURED = '\n[measured]\nbegan = "2026-03-02 09:15 UTC"\nended = "2026-03-02 11:40 UTC"\noperators = ["anna", "<b>"]\n'
DEVICE = '\n[[device]]\nrole = "robot"\nmodel = "IRB"\nserial = "120-5"\nfirmware = "6.08"\nseries = "main"\n'


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return write_data(tmp_path, effects=(), n=60)


def say_when(data: Path, text: str) -> None:
    header = data.with_suffix(".toml")
    header.write_text(header.read_text("utf-8") + text, "utf-8")


def test_a_report_can_be_filed_and_signed(data: Path, tmp_path: Path) -> None:
    say_when(data, MEASURED + "campaigns = 3\n" + DEVICE)
    report, model = tmp_path / "r.html", tmp_path / "m.json"
    assert main(["identify", str(data), "--report", str(report), "--model", str(model)]) == 0
    page = report.read_text("utf-8")
    assert "2026-03-02 09:15 UTC to 2026-03-02 11:40 UTC, 3 campaigns merged" in page
    assert "anna, &lt;b&gt;" in page
    assert page.count("serial number 120-5, software 6.08") == 1
    assert f"<code>{json.loads(model.read_text('utf-8'))['content_sha256']}</code>" in page
    assert f"<code>{read_dataset(data).sha256}</code>" in page
    assert all(f"<dt>{what}</dt>" in page for what in ("Name", "Date", "Signature"))
    (number,) = set(re.findall(r"TP-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}", page))
    assert main(["identify", str(data), "--report", str(report)]) == 0
    assert number in report.read_text("utf-8")
    assert len(page) < 3_000_000


def test_another_result_or_program_has_another_number() -> None:
    number = number_of({"a": 1, "seconds": 2.0}, "f00")
    assert number == number_of({"seconds": 3.0, "a": 1}, "f00")
    assert number != number_of({"a": 2}, "f00")
    assert number != number_of({"a": 1}, "f01")


def test_the_hash_of_a_program_is_that_of_its_sources(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("x = 1\n", "utf-8")
    first = hash_of([tmp_path])
    (tmp_path / "a.pyc").write_bytes(b"compiled")
    assert hash_of([tmp_path]) == first
    (tmp_path / "a.py").write_text("x = 2\n", "utf-8")
    second = hash_of([tmp_path])
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert len({first, second, hash_of([tmp_path])}) == 3


def test_what_a_data_set_does_not_say_is_said_to_be_missing(data: Path) -> None:
    lines = {what: value for what, value, _ in paper_of(read_dataset(data), {}, None)["lines"]}
    assert (
        lines["Measured"] == lines["Operators"] == lines["Serial numbers"] == "not recorded in the data set"
    )
    assert "none: the fit did not converge" in lines.values()


@pytest.mark.parametrize(
    ("measured", "key"),
    [
        ('began = "a"\nended = "b"\noperators = "anna"', "operators"),
        ('began = "a"\nended = "b"\ncampaigns = 0', "campaigns"),
        ('ended = "b"', "began"),
        ('began = 3\nended = "b"', "began"),
        ('began = "a"\nended = "b"\noperator = "anna"', "operator"),
    ],
)
def test_an_occasion_that_is_no_occasion_is_refused(measured: str, key: str, data: Path) -> None:
    say_when(data, f"\n[measured]\n{measured}\n")
    with pytest.raises(DataError) as refused:
        read_dataset(data)
    assert key in str(refused.value.key)

"""The digital calibration certificate: its content, and its elements in the schema's order.

These would catch: a value that differs from the report's, a certificate without a date or with an invented one, and
markup created from a name. They would also catch a simulated campaign that passes for a real one.
Independent readers read it in `tests/counterparts/test_dcc.py`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
from fastapi.testclient import TestClient

from calib.units import FACTORS
from service.cli import main
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.report.certificate import UNITS, CertificateParties
from tests.service.campaigns import write_data
from tests.service.certificates import ABOUT, out_of_order, write_measured
from tests.service.test_http_support import problem

DCC, SI = "{https://ptb.de/dcc}", "{https://ptb.de/si}"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Diagnose at the command line, and return the folder of the outputs.

    They are out.xml, out.json, out.html and out.model.json.
    """
    folder = tmp_path_factory.mktemp("certificate")
    (folder / "about.toml").write_text(ABOUT, "utf-8")
    data = write_measured(folder)
    names = {"--dcc": "out.xml", "--json": "out.json", "--report": "out.html", "--model": "out.model.json"}
    options = [part for option, name in names.items() for part in (option, str(folder / name))]
    about = ["--dcc-about", str(folder / "about.toml"), "--accept-rms", "0.5", "--accept-max", "0.0001"]
    assert main(["diagnose", str(data), *options, *about]) == 3  # the largest is not accepted
    return folder


def texts(root: ElementTree.Element, path: str) -> list[str]:
    return [each.text or "" for each in root.iterfind(path, {"dcc": DCC[1:-1], "si": SI[1:-1]})]


def test_its_elements_are_those_of_the_schema_in_their_order(made: Path) -> None:
    root = ElementTree.parse(made / "out.xml").getroot()
    assert root.get("schemaVersion") == "3.3.0"
    assert list(out_of_order(root)) == []
    results = root.find(f".//{DCC}results")
    assert results is not None
    results[:] = results[::-1]
    core = root.find(f".//{DCC}coreData")
    assert core is not None
    core[:] = core[::-1]
    assert list(out_of_order(root))  # the check can fail


def test_it_says_what_the_report_says(made: Path) -> None:
    root = ElementTree.parse(made / "out.xml").getroot()
    result = json.loads((made / "out.json").read_text("utf-8"))
    html = (made / "out.html").read_text("utf-8")
    (number,) = texts(root, ".//dcc:uniqueIdentifier")
    assert number in html
    assert texts(root, ".//dcc:beginPerformanceDate") == ["2026-03-02"]
    assert texts(root, ".//dcc:endPerformanceDate") == ["2026-03-03"]
    assert texts(root, ".//dcc:conformity") == ["fail"]
    values = {float(text) for text in texts(root, ".//si:value")}
    for key in ("error_nominal_mm", "error_before_mm", "error_after_mm"):
        assert float(f"{result[key]['rms']:.12g}") in values
    model = json.loads((made / "out.model.json").read_text("utf-8"))
    dropped = {each["name"] for each in result["dropped"]}
    kept = [each for each in model["parameters"] if each["name"] not in dropped]
    assert {float(f"{each['value']:.12g}") for each in kept} <= values
    hashes = texts(root, ".//dcc:coreData/dcc:identifications/dcc:identification/dcc:value")
    assert hashes == [result["data"]["sha256"], model["content_sha256"]]
    u = texts(root, ".//si:valueExpandedMU")
    assert len(u) == len(kept) + 2
    assert float(f"{result['acceptance']['criteria'][0]['expanded_uncertainty_mm']:.9g}") == float(u[0])
    assert any(effect["meaning"] in texts(root, ".//dcc:text/dcc:content") for effect in result["effects"])


def test_whose_it_is_and_that_it_is_simulated(made: Path) -> None:
    root = ElementTree.parse(made / "out.xml").getroot()
    assert texts(root, ".//dcc:calibrationLaboratory//dcc:content") == ["Cell 7 <A&B>"]
    assert texts(root, ".//dcc:customer/dcc:name/dcc:content") == ["=ACME"]
    assert set(texts(root, ".//dcc:countryCode")) == {"DE"}
    assert "SIMULATED" in texts(root, ".//dcc:statement/dcc:name/dcc:content")
    for place in (".//dcc:item/dcc:name/dcc:content", ".//dcc:measurementResult/dcc:name/dcc:content"):
        assert all(text.startswith("SIMULATED: ") for text in texts(root, place))


def test_every_unit_of_a_parameter_can_be_said_or_is_text() -> None:
    assert set(FACTORS) - set(UNITS) == {"ppm", "1e-6/K", "1e-6 rad/(N.m)", "1e-15 rad/(N.mm)^3"}
    assert all(re.fullmatch(r"(\\[a-z]+(\\tothe\{-1\})?)+", unit) for unit in UNITS.values())


@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_without_a_date_there_is_no_certificate_and_no_work_in_vain(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    data, result = write_data(tmp_path, n=50), tmp_path / "out.json"
    assert main([command, str(data), "--dcc", str(tmp_path / "out.xml"), "--json", str(result)]) == 2
    assert "does not state when it was measured" in capsys.readouterr().err
    assert not (tmp_path / "out.xml").exists()
    assert not result.exists()  # refused before the fit: nothing has been found that could be written


def test_whose_it_is_without_a_certificate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "about.toml").write_text(ABOUT, "utf-8")
    assert main(["identify", "data.csv", "--dcc-about", str(tmp_path / "about.toml")]) == 2
    assert "'--dcc-parties': is used only in a certificate" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("key", "value"), [("country", "Germany"), ("country", "de"), ("city", " "), ("town", "Ulm")]
)
def test_whose_it_cannot_be_is_refused(tmp_path: Path, key: str, value: str) -> None:
    data = write_measured(tmp_path, n=50)
    (tmp_path / "about.toml").write_text(f'{key} = "{value}"\n', "utf-8")
    order = [
        "identify",
        str(data),
        "--dcc",
        str(tmp_path / "o.xml"),
        "--dcc-about",
        str(tmp_path / "about.toml"),
    ]
    assert main(order) == 2
    assert not (tmp_path / "o.xml").exists()


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    app = create_app(ServiceSettings(record=tmp_path / "record", tokens=Tokens("an-operator", "a-viewer")))
    with TestClient(app, base_url="http://127.0.0.1/api/v1") as client:
        client.headers |= {"Authorization": "Bearer an-operator"}
        yield client


def test_it_is_given_by_http(client: TestClient, tmp_path: Path) -> None:
    def identified(data: Path) -> str:
        files = {"csv": data.read_bytes(), "toml": data.with_suffix(".toml").read_bytes()}
        dataset = client.post("/datasets", files=files).json()["id"]
        job = client.post("/identifications", json={"dataset_id": dataset}).json()["id"]
        while client.get(f"/identifications/{job}", params={"wait": 30, "after": 2}).json()["version"] < 3:
            pass
        return job

    (tmp_path / "with").mkdir()
    job = identified(write_measured(tmp_path / "with", n=50))
    answer = client.get(f"/results/{job}/certificate.xml", params={"laboratory": "A & <B>", "country": "DE"})
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/xml"
    root = ElementTree.fromstring(answer.content)
    assert list(out_of_order(root)) == []
    assert texts(root, ".//dcc:calibrationLaboratory//dcc:content") == ["A & <B>"]
    (number,) = texts(root, ".//dcc:uniqueIdentifier")
    assert number in client.get(f"/reports/{job}").text
    assert (
        "country"
        in problem(client.get(f"/results/{job}/certificate.xml", params={"country": "X"}), 422)["key"]
    )
    (tmp_path / "without").mkdir()
    undated = identified(write_data(tmp_path / "without", n=50))
    told = problem(client.get(f"/results/{undated}/certificate.xml"), 422)
    assert told["key"] == "measured"
    problem(client.get("/results/x/certificate.xml"), 404)


def test_nothing_is_invented() -> None:
    assert set(vars(CertificateParties()).values()) == {"not stated", "ZZ"}

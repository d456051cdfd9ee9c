"""A certificate read by the PTB's own dccXMLJSONConv and dsiUnits, which nobody here wrote.

They read it whole, know its leaves as those of the schema 3.3.0 and its units as those of D-SI. They do not hold it
against the schema as a validator would: the schema is in no package. `tests/service/certificates.py` has its
orders, by hand.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from service.cli import main
from service.report.certificate import UNITS
from tests.counterparts.environments import DCC
from tests.drivers.waiting import PATIENCE_S
from tests.service.certificates import write_measured

ENUMERATED = {"dcc:issuer", "dcc:performanceLocation", "dcc:type"}
"""Leaves that are enumerations of their own in the schema, with no type that a table could name."""


@DCC.needed()
def test_another_program_reads_the_certificate(tmp_path: Path) -> None:
    data = write_measured(tmp_path)
    file = tmp_path / "out.xml"
    assert main(["identify", str(data), "--dcc", str(file)]) == 0
    told = read(file)
    assert set(told["unknown_leaves"]) == ENUMERATED
    assert told["known"] > 15
    assert all(told["units"].values())
    assert set(told["units"]) <= set(UNITS.values())
    certificate = told["read"]["dcc:digitalCalibrationCertificate"]
    assert certificate["@schemaVersion"] == "3.3.0"
    core = certificate["dcc:administrativeData"]["dcc:coreData"]
    assert core["dcc:uniqueIdentifier"]["#text"].startswith("TP-")
    assert core["dcc:beginPerformanceDate"]["#text"] == "2026-03-02"
    results = certificate["dcc:measurementResults"]["dcc:measurementResult"]["dcc:results"]["dcc:result"]
    first = results[0]["dcc:data"]["dcc:list"]["dcc:quantity"][0]
    wanted = ElementTree.parse(file).findtext(".//{*}result//{*}value")
    assert first["si:real"]["si:value"]["#text"] == wanted


@DCC.needed()
def test_every_unit_is_one_of_the_si(tmp_path: Path) -> None:
    file = tmp_path / "units.xml"
    leaves = "".join(
        f"<si:real><si:unit>{unit}</si:unit></si:real>" for unit in (*UNITS.values(), r"\nonsense")
    )
    file.write_text(f'<a xmlns:si="https://ptb.de/si">{leaves}</a>', "utf-8")
    units = read(file)["units"]
    assert units.pop(r"\nonsense") is False
    assert units == dict.fromkeys(UNITS.values(), True)


def read(file: Path) -> dict[str, Any]:
    peer = [str(DCC.python), str(Path(__file__).parent / "dcc_peer.py"), str(file)]
    done = subprocess.run(peer, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    if done.returncode:
        pytest.fail(done.stderr)
    return json.loads(done.stdout)

"""A data set that says when it was measured, and the order of elements in a certificate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree

from tests.service.campaigns import write_data

MEASURED = (
    '\n[measured]\nbegan = "2026-03-02 09:15 UTC"\nended = "2026-03-03 01:40 UTC"\noperators = ["anna"]\n'
)
ABOUT = 'laboratory = "Cell 7 <A&B>"\ncity = "Ulm"\ncountry = "DE"\ncustomer = "=ACME"\nresponsible = "Anna Ruf"\n'
ORDER: Mapping[str, str] = {
    "digitalCalibrationCertificate": "administrativeData! measurementResults!",
    "administrativeData": "dccSoftware! coreData! items! calibrationLaboratory! respPersons! customer! statements",
    "software": "name! release! type description",
    "coreData": "countryCodeISO3166_1! usedLangCodeISO639_1! mandatoryLangCodeISO639_1! uniqueIdentifier! "
    "identifications receiptDate beginPerformanceDate! endPerformanceDate! performanceLocation! issueDate",
    "item": "name! equipmentClass description owner installedSoftwares manufacturer model identifications!",
    "identification": "issuer! value! name",
    "calibrationLaboratory": "calibrationLaboratoryCode contact!",
    "contact": "name! eMail phone fax link location!",
    "customer": "name! eMail phone fax link location!",
    "respPerson": "person! description role mainSigner",
    "statement": "name description countryCodeISO3166_1 convention traceable norm reference link declaration valid "
    "date period respAuthority conformity data",
    "measurementResult": "name! description usedMethods usedSoftware measuringEquipments influenceConditions results!",
    "usedMethod": "name! description norm reference link",
    "measuringEquipment": "name! equipmentClass description certificate manufacturer model identifications",
    "influenceCondition": "name! description status certificate data!",
    "result": "name! description data!",
    "quantity": "name description noQuantity real",
    "real": "label quantityType value! unit! significantDigit dateTime measurementUncertaintyUnivariate",
    "expandedMU": "valueExpandedMU! coverageFactor! coverageProbability! distribution",
}
"""Of the schema 3.3.0 (dcc.xsd, and D-SI for `real`), copied by hand: what may stand in an element, in this order; `!`:
it must. Elements that are not here hold text, or any number of what their name says."""


def out_of_order(root: ElementTree.Element) -> Iterator[str]:
    """Yield children that the schema refuses, or refuses in this order, for elements of `ORDER`."""
    for element in root.iter():
        name = element.tag.rpartition("}")[2]
        if name in ORDER:
            allowed = [each.rstrip("!") for each in ORDER[name].split()]
            found = [child.tag.rpartition("}")[2] for child in element]
            if [each for each in found if each not in allowed]:
                yield f"{name}: {found}"
            elif found != sorted(found, key=allowed.index):
                yield f"{name}: order {found}"
            yield from (
                f"{name}: no {each.rstrip('!')}"
                for each in ORDER[name].split()
                if each.endswith("!") and each.rstrip("!") not in found
            )


def write_measured(folder: Path, *, n: int = 50) -> Path:
    """A simulated data set with its occasion."""
    data = write_data(folder, n=n)
    header = data.with_suffix(".toml")
    header.write_text(header.read_text("utf-8") + MEASURED, "utf-8")
    return data

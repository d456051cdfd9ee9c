"""Digital calibration certificate (DCC): the values of a report as XML for programs.

Written according to the schema of the PTB, version 3.3.0, with quantities in D-SI 2.2. `CertificateParties`
states what a data set does not know: laboratory, customer and the responsible person. It is not a certificate
of an accredited laboratory unless one issues it. Sources are PTB, dcc.xsd v3.3.0 (structure, order,
enumerations), and D-SI 2.2 (quantities, units).

This module also makes the marks of a report that can be filed and signed: its number, who measured and when,
program and hashes.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import UTC, date, datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from acquisition.record import individual_of
from calib.data import Dataset
from calib.errors import DataError
from service import wording
from service.report.scope import devices_of
from service.results.judgement.acceptance import RULE

SCHEMA, SI = "https://ptb.de/dcc", "https://ptb.de/si"
VERSION = "3.3.0"
_INSTANCE = "http://www.w3.org/2001/XMLSchema-instance"

UNITS: Mapping[str, str] = {
    "": r"\one",
    "mm": r"\milli\metre",
    "deg": r"\degree",
    "mrad": r"\milli\radian",
    "kg": r"\kilogram",
    "degC": r"\degreecelsius",
    "1e-6 rad/(N.mm)": r"\micro\radian\newton\tothe{-1}\milli\metre\tothe{-1}",
    "deg/K": r"\degree\kelvin\tothe{-1}",
    "um/N": r"\micro\metre\newton\tothe{-1}",
    "mm/h": r"\milli\metre\hour\tothe{-1}",
    "deg/h": r"\degree\hour\tothe{-1}",
}
"""Units of files and screens in the notation of D-SI; a quantity in another unit is written as text."""

CONFORMITY = {"accepted": "pass", "rejected": "fail", "not_decided": "noPass"}
COVERAGE, PROBABILITY = 2.0, 0.95
_NOT_TEXT = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_ROOMS = ("service", "acquisition", "drivers", "calib")
_DIGITS = 12
_NOT_STATED = "not stated"
_MISSING = "not recorded in the data set"
_OF_THE_RUN = ("seconds",)  # keys of a result that differ each time it is worked out


@dataclass(frozen=True)
class CertificateParties:
    """The entries of a certificate that no data set knows.

    `country` has two letters (ISO 3166-1); it is `ZZ` if it is not stated.
    """

    laboratory: str = _NOT_STATED
    city: str = _NOT_STATED
    country: str = "ZZ"
    customer: str = _NOT_STATED
    responsible: str = _NOT_STATED

    def stated(self, name: str) -> str:
        """Return an entry; empty if it is not stated."""
        value = getattr(self, name)
        return "" if value == _NOT_STATED else value

    def refuse_unusable(self) -> CertificateParties:
        """Return the same entries, after a check that they fit a certificate.

        Raises
        ------
        DataError
            An entry does not fit; the message names it.
        """
        for each in fields(self):
            if not getattr(self, each.name).strip():
                raise DataError("is empty.", do="Give it, or leave it out.", key=each.name)
        if not re.fullmatch("[A-Z]{2}", self.country):
            raise DataError(f"is {self.country!r}.", do="Give two capital letters, DE.", key="country")
        return self


@dataclass(frozen=True)
class CertificateContent:
    """The content of a certificate.

    `document` is the result (`identify --json` or `diagnose --json`). `parameters` are those of its model with
    value, std and unit. `model_sha256` is the hash of that model; it is None if the fit did not converge.
    """

    dataset: Dataset
    document: Mapping[str, Any]
    parameters: Sequence[Mapping[str, Any]]
    model_sha256: str | None


def certificate_xml(certified: CertificateContent, about: CertificateParties) -> str:
    """Write the XML of a certificate, with the number of the report, issued today (UTC).

    Raises
    ------
    DataError
        The data set does not state when it was measured, or `about` cannot be used.
    """
    about.refuse_unusable()
    ElementTree.register_namespace("dcc", SCHEMA)
    ElementTree.register_namespace("si", SI)
    ElementTree.register_namespace("xsi", _INSTANCE)
    root = ElementTree.Element(f"{{{SCHEMA}}}digitalCalibrationCertificate", schemaVersion=VERSION)
    root.set(f"{{{_INSTANCE}}}schemaLocation", f"{SCHEMA} {SCHEMA}/v{VERSION}/dcc.xsd")
    _administrative(_add(root, "administrativeData"), certified, about, datetime.now(UTC).date())
    _results(_add(root, "measurementResults"), certified)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _administrative(
    parent: ElementTree.Element, certified: CertificateContent, about: CertificateParties, issued: date
) -> None:
    dataset = certified.dataset
    began, ended = measured_on(dataset)
    software = _add(_add(parent, "dccSoftware"), "software")
    _text(software, "name", "TruePose")
    _add(software, "release", metadata.version("truepose"))
    _add(software, "type", "application")
    _text(software, "description", f"SHA-256 of the program: {program_hash()}")
    core = _add(parent, "coreData")
    _add(core, "countryCodeISO3166_1", about.country)
    _add(core, "usedLangCodeISO639_1", "en")
    _add(core, "mandatoryLangCodeISO639_1", "en")
    _add(core, "uniqueIdentifier", number_of(certified.document, program_hash()))
    hashes = _add(core, "identifications")
    _identification(hashes, "other", dataset.sha256, "SHA-256 of the data set with its header")
    if certified.model_sha256 is not None:
        _identification(hashes, "other", certified.model_sha256, "SHA-256 of the model")
    _add(core, "beginPerformanceDate", began)
    _add(core, "endPerformanceDate", ended)
    _add(core, "performanceLocation", "other")
    _add(core, "issueDate", issued.isoformat())
    item = _add(_add(parent, "items"), "item")
    robot = _device(dataset, "robot")
    _text(item, "name", f"{_simulated(dataset)}Industrial robot {dataset.header.robot.name}")
    _text(_add(item, "manufacturer"), "name", dataset.header.robot.maker or "not stated")
    _add(item, "model", robot.get("model") or dataset.header.robot.name)
    serial = robot.get("serial") or "not recorded in the data set"
    _identification(_add(item, "identifications"), "manufacturer", serial, "Serial number")
    laboratory = _add(_add(parent, "calibrationLaboratory"), "contact")
    _contact(laboratory, about.laboratory, about)
    responsible = _add(_add(parent, "respPersons"), "respPerson")
    _text(_add(responsible, "person"), "name", about.responsible)
    _add(responsible, "mainSigner", "true")
    _contact(_add(parent, "customer"), about.customer, about)
    _statements(parent, certified)


def _statements(parent: ElementTree.Element, certified: CertificateContent) -> None:
    statements = _add(parent, "statements")
    if certified.dataset.header.simulated:
        told = _add(statements, "statement")
        _text(told, "name", "SIMULATED")
        _text(told, "declaration", "Simulators were measured. This says nothing about any real robot.")
    told = _add(statements, "statement")
    _text(told, "name", "Kind of document")
    _text(
        told,
        "declaration",
        "Written by the program that made the report of the same number. It is not signed, and a certificate of an "
        "accredited laboratory only where one issues it as such.",
    )
    acceptance = certified.document.get("acceptance")
    if acceptance is not None:
        verdict = _add(statements, "statement")
        _text(verdict, "name", "Acceptance")
        _add(verdict, "convention", "guard bands as in ISO 14253-1")
        _text(verdict, "declaration", RULE, *map(_judged, acceptance["criteria"]))
        _add(verdict, "conformity", CONFORMITY[acceptance["verdict"]])


def _judged(criterion: Mapping[str, Any]) -> str:
    """Return one figure with its limit and verdict, as text."""
    zone = criterion.get("zone")  # results of older versions do not say
    where = "" if zone is None else f" in zone {zone}"
    figure, u = (
        "none" if criterion[key] is None else f"{criterion[key]:.4g} mm"
        for key in ("figure_mm", "expanded_uncertainty_mm")
    )
    verdict = criterion["verdict"].replace("_", " ")
    return f"{_FIGURES[criterion['quantity']]}{where}: {figure}, U {u}, limit {criterion['limit_mm']:g} mm: {verdict}."


def _results(parent: ElementTree.Element, certified: CertificateContent) -> None:
    document, dataset = certified.document, certified.dataset
    result = _add(parent, "measurementResult")
    _text(result, "name", f"{_simulated(dataset)}Position error and parameters of the robot")
    method = _add(_add(result, "usedMethods"), "usedMethod")
    _text(method, "name", "Identification of the robot's kinematics from measured positions or distances")
    held_out = f"{dataset.header.holdout}; they took no part in any fit"
    _text(
        method,
        "description",
        f"Readings held out: {held_out if dataset.validation_rows.any() else 'none of the data set'}.",
    )
    instrument = _device(dataset, "instrument")
    equipment = _add(_add(result, "measuringEquipments"), "measuringEquipment")
    _text(equipment, "name", dataset.header.instrument)
    if instrument.get("model"):
        _add(equipment, "model", instrument["model"])
    serial = instrument.get("serial") or "not recorded in the data set"
    _identification(_add(equipment, "identifications"), "manufacturer", serial, "Serial number")
    _temperature(result, dataset)
    results = _add(result, "results")
    for key, name in _ERRORS.items():
        if document.get(key) is not None:
            what = f"{name}: error on {wording.counted(document[key]['n'], 'reading')} held out"
            _errors(results, what, document[key], _uncertainty(document, key))
    for key, name in _VERIFIED.items():
        verified = (document.get("verification") or {}).get(key)
        if verified is not None:
            of = " of lengths along the ballbar" if document["verification"].get("of_lengths") else ""
            what = f"Robot at new poses, {name}: error{of} on {wording.counted(verified['n'], 'reading')}"
            _errors(results, what, verified, {})
    if "verdict" in document:
        found = _add(results, "result")
        _text(found, "name", "Diagnosis")
        words = [f"Verdict: {document['verdict']}.", *(effect["meaning"] for effect in document["effects"])]
        _text(_add(found, "data"), "text", *words)
    dropped = {each["name"] for each in document["dropped"]}  # a model file holds them as zeros
    known = [
        each for each in certified.parameters if each.get("value") is not None and each["name"] not in dropped
    ]
    if known:
        parameters = _add(results, "result")
        _text(parameters, "name", "Parameters of the model, as changes from the nominal robot")
        listed = _add(_add(parameters, "data"), "list")
        for each in known:
            std = each.get("std")
            expanded = None if std is None or not math.isfinite(std) else COVERAGE * std
            _quantity(listed, each["name"], each["value"], each["unit"], expanded)


_ERRORS = {
    "error_nominal_mm": "Nominal robot, placed",
    "error_before_mm": "Base model",
    "error_identified_mm": "Identified model",
    "error_after_mm": "Model with the effects found",
}

_VERIFIED = {
    "error_uncorrected_mm": "driven uncorrected",
    "error_verified_mm": "driven with corrected targets",
}

_FIGURES = {
    "rms": "RMS error",
    "mean": "Mean error",
    "p95": "95 % of errors are less",
    "max": "Largest error",
}


def _uncertainty(document: Mapping[str, Any], key: str) -> Mapping[str, float]:
    """Return the expanded uncertainties, mm, of the values that were compared with limits.

    These are the values of the last model.
    """
    last = "error_after_mm" if "error_after_mm" in document else "error_identified_mm"
    acceptance = document.get("acceptance")
    if key != last or acceptance is None:
        return {}
    found = {
        each["quantity"]: each["expanded_uncertainty_mm"]
        for each in acceptance["criteria"]
        if each.get("zone") is None
    }
    return {name: u for name, u in found.items() if u is not None}


def _errors(
    results: ElementTree.Element, name: str, errors: Mapping[str, Any], u: Mapping[str, float]
) -> None:
    result = _add(results, "result")
    _text(result, "name", name)
    listed = _add(_add(result, "data"), "list")
    for figure, words in _FIGURES.items():
        if errors.get(figure) is not None:
            _quantity(listed, words, errors[figure], "mm", u.get(figure))


def _quantity(
    parent: ElementTree.Element, name: str, value: float, unit: str, expanded: float | None
) -> None:
    quantity = _add(parent, "quantity")
    _text(quantity, "name", name)
    if unit not in UNITS:
        spread = "" if expanded is None else f", expanded uncertainty (k = {COVERAGE:g}) {expanded:.9g}"
        _text(quantity, "noQuantity", f"{value:.12g} {unit}{spread}")
        return
    real = _si(quantity, "real")
    _si(real, "value", f"{value:.12g}")
    _si(real, "unit", UNITS[unit])
    if expanded is not None:
        u = _si(_si(real, "measurementUncertaintyUnivariate"), "expandedMU")
        _si(u, "valueExpandedMU", f"{expanded:.9g}")
        _si(u, "coverageFactor", f"{COVERAGE:g}")
        _si(u, "coverageProbability", f"{PROBABILITY:g}")


def _temperature(result: ElementTree.Element, dataset: Dataset) -> None:
    air = dataset.conditions.temperature[dataset.usable]
    air = air[np.isfinite(air)]
    if not len(air):
        return
    condition = _add(_add(result, "influenceConditions"), "influenceCondition")
    _text(condition, "name", "Temperature of the air")
    data = _add(condition, "data")
    for name, value in (("Lowest", air.min()), ("Highest", air.max())):
        _quantity(data, name, float(value), "degC", None)


def measured_on(dataset: Dataset) -> tuple[str, str]:
    """Return the days of the first and the last reading, as XML dates.

    Raises
    ------
    DataError
        The data set does not state them.
    """
    occasion = dataset.header.occasion
    days = [] if occasion is None else [occasion.began[:10], occasion.ended[:10]]
    try:
        began, ended = (date.fromisoformat(day).isoformat() for day in days)
    except ValueError as error:
        raise DataError(
            "does not state when it was measured, which a certificate needs.",
            do='Add [measured] with began = "2026-03-02 09:15 UTC" and ended; an export of a record has them.',
            file=dataset.path.with_suffix(".toml"),
            key="measured",
        ) from error
    return began, ended


def _device(dataset: Dataset, role: str) -> dict[str, str]:
    """Return model and serial number of the first device with this role, if stated."""
    devices = [individual_of(table) for table in dataset.header.devices]
    for each in devices:
        if each.role == role:
            return {"model": each.model, "serial": each.serial}
    return {}


def _simulated(dataset: Dataset) -> str:
    return "SIMULATED: " if dataset.header.simulated else ""


def _contact(parent: ElementTree.Element, name: str, about: CertificateParties) -> None:
    _text(parent, "name", name)
    location = _add(parent, "location")
    _add(location, "city", about.city)
    _add(location, "countryCode", about.country)


def _identification(parent: ElementTree.Element, issuer: str, value: str, name: str) -> None:
    each = _add(parent, "identification")
    _add(each, "issuer", issuer)
    _add(each, "value", value)
    _text(each, "name", name)


def _text(parent: ElementTree.Element, name: str, *texts: str) -> ElementTree.Element:
    """Text in English, a paragraph each."""
    element = _add(parent, name)
    for text in _kept(texts):
        _add(element, "content", text).set("lang", "en")
    return element


def _kept(texts: Iterable[str]) -> list[str]:
    return [text for text in texts if text.strip()]


def _add(parent: ElementTree.Element, name: str, text: str | None = None) -> ElementTree.Element:
    return _child(parent, SCHEMA, name, text)


def _si(parent: ElementTree.Element, name: str, text: str | None = None) -> ElementTree.Element:
    return _child(parent, SI, name, text)


def _child(parent: ElementTree.Element, space: str, name: str, text: str | None) -> ElementTree.Element:
    element = ElementTree.SubElement(parent, f"{{{space}}}{name}")
    if text is not None:
        element.text = " ".join(_NOT_TEXT.sub("?", text).split())  # the schema allows no outer blanks
    return element


def number_of(document: Mapping[str, Any], program: str) -> str:
    """Return the number of a report, "TP-1a2b-3c4d-5e6f".

    It depends only on the result and the hash of the program, so that the same readings and the same program give
    the same number.
    """
    rest = {key: value for key, value in document.items() if key not in _OF_THE_RUN}
    text = json.dumps([program, rest], sort_keys=True, separators=(",", ":"), allow_nan=False)
    digits = hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]
    return "-".join(("TP", *(digits[i : i + 4] for i in range(0, _DIGITS, 4))))


def hash_of(folders: Iterable[Path]) -> str:
    """Return the SHA-256 of the sources in folders.

    It covers the names and bytes of their Python files, templates and TOML files, in order.
    """
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted(p for p in folder.rglob("*") if p.suffix in (".py", ".j2", ".toml")):
            digest.update(f"{folder.name}/{path.relative_to(folder).as_posix()}\0".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


@cache
def program_hash() -> str:
    """SHA-256 of the program that runs."""
    return hash_of(Path(__file__).parents[2] / room for room in _ROOMS)


def paper_of(dataset: Dataset, document: Mapping[str, Any], model_sha256: str | None) -> dict[str, Any]:
    """Return the number of the report and its lines (text, value, whether the value is a hash).

    `model_sha256` is the hash of the saved model, or None.
    """
    program = program_hash()
    return {
        "number": number_of(document, program),
        "lines": [
            *((what, how, False) for what, how in (*_measured(dataset), *_devices(dataset))),
            ("Program", f"TruePose {metadata.version('truepose')}", False),
            ("SHA-256 of the program", program, True),
            ("SHA-256 of the data set with its header", dataset.sha256, True),
            (
                "SHA-256 of the model (content_sha256 of its file)",
                model_sha256 or "none: the fit did not converge",
                model_sha256 is not None,
            ),
        ],
    }


def _devices(dataset: Dataset) -> list[tuple[str, str]]:
    return devices_of(dataset) or [("Serial numbers", _MISSING)]


def _merged(campaigns: int) -> str:
    return f", {campaigns} campaigns merged" if campaigns > 1 else ""


def _measured(dataset: Dataset) -> list[tuple[str, str]]:
    occasion = dataset.header.occasion
    if occasion is None:
        return [("Measured", _MISSING), ("Operators", _MISSING)]
    return [
        ("Measured", f"{occasion.began} to {occasion.ended}{_merged(occasion.campaigns)}"),
        ("Operators", ", ".join(occasion.operators) or _MISSING),
    ]

"""Options `--dcc` and `--dcc-parties` of identify and diagnose.

They add a digital calibration certificate to the report. The parties are also on the first page of the report.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from calib.data import Dataset
from calib.errors import DataError
from calib.text import TomlTable, read_toml, replace_file

if TYPE_CHECKING:
    from service.report.certificate import CertificateParties

Dcc = Annotated[
    Path | None,
    typer.Option("--dcc", metavar="FILE.xml", help="File for a digital calibration certificate (DCC 3.3.0)."),
]
DccAbout = Annotated[
    Path | None,
    typer.Option(
        "--dcc-parties",
        "--dcc-about",
        metavar="ABOUT.toml",
        help="File with the parties named in certificate and report: laboratory, city, country (two "
        "letters), customer, responsible.",
    ),
]


@dataclass(frozen=True)
class CertificateRequest:
    """The file of --dcc, and what --dcc-parties states of it."""

    file: Path
    about: CertificateParties

    @staticmethod
    def of(dcc: Path | None, parties: CertificateParties | None) -> CertificateRequest | None:
        """Return the certificate that the options request; None without --dcc."""
        if dcc is None:
            return None
        from service.report.certificate import CertificateParties  # long to import, as below

        return CertificateRequest(dcc, parties or CertificateParties())

    def refuse_undated(self, dataset: Dataset) -> None:
        """Refuse a data set that cannot have a certificate, before a long fit and not after it.

        Raises
        ------
        DataError
            The data set does not state when it was measured.
        """
        from service.report.certificate import measured_on

        measured_on(dataset)

    def write(
        self,
        dataset: Dataset,
        document: Mapping[str, Any],
        parameters: Sequence[Mapping[str, Any]],
        model_sha256: str | None,
    ) -> None:
        """Write the certificate of a result.

        Raises
        ------
        DataError
            The data set or an entry cannot be used in a certificate.
        """
        from service.report.certificate import CertificateContent, certificate_xml

        certified = CertificateContent(dataset, document, parameters, model_sha256)
        replace_file(self.file, certificate_xml(certified, self.about))


def read_parties(path: Path | None, dcc: Path | None, report: Path | None) -> CertificateParties | None:
    """Read the file of --dcc-parties; None without one.

    Raises
    ------
    DataError
        Neither a certificate nor a report states them, or the file is wrong; the message names file and key.
    """
    if path is None:
        return None
    from service.report.certificate import CertificateParties

    if dcc is None and report is None:
        raise DataError(
            "is used only in a certificate or a report.",
            do="Give --dcc or --report as well.",
            key="--dcc-parties",
        )
    _, values = read_toml(path)
    table = TomlTable(values, path)
    names = [each.name for each in fields(CertificateParties)]
    table.only(names)
    return CertificateParties(
        **{name: table.text(name) for name in names if name in values}
    ).refuse_unusable()

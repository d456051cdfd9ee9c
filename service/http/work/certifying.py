"""The certificate of a job's result, for a request; called in a worker process.

The service that asks for it does without the libraries of the report, which take long to import.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calib.data import read_dataset
from calib.errors import DataError
from calib.text import read_json
from service.job_folder import JOB, MODEL, RESULT


def certificate_of(folder: Path, about: dict[str, str]) -> str:
    """Return the XML of the certificate of the job in a folder.

    `about` has the known fields of `CertificateParties`.

    Raises
    ------
    DataError
        The readings were deleted, or no certificate can be about them.
    """
    from service.report.certificate import CertificateContent, CertificateParties, certificate_xml

    job: dict[str, Any] = read_json(folder / JOB)
    data = Path(job["data"])
    if not data.is_file():
        raise DataError(
            "is not there any more.", do="Its readings were deleted; start the job again.", key="data"
        )
    model: dict[str, Any] = read_json(folder / MODEL) if (folder / MODEL).is_file() else {"parameters": []}
    certified = CertificateContent(
        read_dataset(data), read_json(folder / RESULT), model["parameters"], model.get("content_sha256")
    )
    return certificate_xml(certified, CertificateParties(**about))

"""Exports of a model for other programs, each with its contents and its predicted error."""

from service.exports.formats import FORMATS, ExportRequest
from service.exports.written import refuse_unknown, written

__all__ = ["FORMATS", "ExportRequest", "refuse_unknown", "written"]

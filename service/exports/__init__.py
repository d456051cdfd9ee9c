"""Exports of a model for other programs, each with its contents and its predicted error."""

from service.exports.formats import FORMATS, ExportRequest
from service.exports.written import listed, refuse_unknown, written

__all__ = ["FORMATS", "ExportRequest", "listed", "refuse_unknown", "written"]

"""Exports of a model for other programs: each says what it carries and what its own predicted error is."""

from service.exports.formats import FORMATS, ExportRequest
from service.exports.written import refuse_unknown, written

__all__ = ["FORMATS", "ExportRequest", "refuse_unknown", "written"]

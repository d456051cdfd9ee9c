"""Exports of a model for other programs: each says what it carries and what its own predicted error is."""

from service.exports.formats import FORMATS, Export, Format
from service.exports.written import Written, refuse_unknown, written

__all__ = ["FORMATS", "Export", "Format", "Written", "refuse_unknown", "written"]

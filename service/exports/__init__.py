"""Exports of a model for other programs: each says what it carries and what its own predicted error is."""

from service.exports.formats import FORMATS, Export
from service.exports.written import refuse_unknown, written

__all__ = ["FORMATS", "Export", "refuse_unknown", "written"]

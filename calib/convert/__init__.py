"""Importers of foreign data, and of legs as poses, for `truepose convert --from`."""

from calib.convert import hexapod_legs, ipa_ur10
from calib.convert.table import ConvertedTable, Holdout

IMPORTERS = {"hexapod-legs": hexapod_legs.read, "ipa-ur10": ipa_ur10.read}

__all__ = ["IMPORTERS", "ConvertedTable", "Holdout"]

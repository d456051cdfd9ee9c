"""Importers of foreign data, by the name that `truepose convert --from` takes."""

from calib.convert import ipa_ur10
from calib.convert.table import Holdout, Table

IMPORTERS = {"ipa-ur10": ipa_ur10.read}

__all__ = ["IMPORTERS", "Holdout", "Table"]

"""When the readings of a data set were taken, and by whom."""

from __future__ import annotations

from dataclasses import dataclass

from calib.text.toml_table import TomlTable

KEYS = {"began", "ended", "operators", "campaigns"}


@dataclass(frozen=True)
class Occasion:
    """began, ended: of the first and the last reading, as text, "2026-03-02 09:15 UTC"; operators: who gave the
    commands and answered the prompts, in the order in which they came; campaigns: of how many records these readings
    are."""

    began: str
    ended: str
    operators: tuple[str, ...]
    campaigns: int = 1


def occasion_of(table: TomlTable) -> Occasion | None:
    """The table `[measured]` of a header, None where there is none. Raises DataError naming the key."""
    if "measured" not in table.values:
        return None
    measured = table.table("measured")
    operators = measured.values.get("operators", [])
    if not isinstance(operators, list) or not all(isinstance(name, str) for name in operators):
        raise measured.refuse("operators", f"is {operators!r}.", 'Give a list of names, ["anna", "bert"].')
    campaigns = measured.whole("campaigns", 1, low=1)
    return Occasion(measured.text("began"), measured.text("ended"), tuple(operators), campaigns)

"""Small data sets, each different by a remark, and unusable files.

A diagnosis takes a third of a second for a data set, and no time for an unusable file.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from mocks.campaign import make_campaign, write_campaign


@cache
def _texts() -> tuple[str, str]:
    with TemporaryDirectory() as folder:
        campaign = make_campaign(seed=4, n=40, n_validation=20, effects=["backlash:j4"], size=6.0)
        data = Path(write_campaign(campaign, Path(folder))["csv"])
        return data.read_text("utf-8"), data.with_suffix(".toml").read_text("utf-8")


def good(folder: Path, name: str) -> Path:
    """A data set that can be diagnosed, its header another for every name; returns its CSV."""
    table, header = _texts()
    data = folder / f"{name}.csv"
    data.write_text(table, "utf-8")
    data.with_suffix(".toml").write_text(f"# {name}\n{header}", "utf-8")
    return data


def bad(folder: Path, name: str) -> Path:
    """A data set without a reading; returns its CSV."""
    data = good(folder, name)
    data.write_text(f"reading_id\n# {name}\n", "utf-8")
    return data

"""The environments of the counterparts: what is pinned, and what happens where one cannot be installed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.counterparts import environments
from tests.counterparts.environments import ENVIRONMENTS, Absent, Environment

PINNED = re.compile(r"[A-Za-z0-9-]+==[0-9.]+")


@pytest.mark.parametrize("environment", ENVIRONMENTS, ids=lambda each: each.name)
def test_names_and_versions_only(environment: Environment) -> None:
    text = (environments.HERE / f"{environment.name}.txt").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    assert lines
    assert all(PINNED.fullmatch(line) for line in lines)


def test_what_cannot_be_installed_is_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environments, "HERE", tmp_path)
    monkeypatch.setattr(environments, "ROOT", tmp_path)
    (tmp_path / "nothing.txt").write_text("nothing ==\n", encoding="utf-8")
    missing = Environment("nothing", "nobody")
    with pytest.raises(Absent, match="nothing"):
        missing.build()
    assert not missing.built
    assert missing.versions == []
    mark = missing.needed().mark
    assert mark.args == (True,)
    assert mark.kwargs["reason"].endswith("make counterparts")

"""Test the public interfaces of calib: every promised name exists and hides no subpackage."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest

import calib

ROOMS = sorted(path.parent.name for path in Path(calib.__file__).parent.glob("*/__init__.py"))


@pytest.mark.parametrize("room", ROOMS)
def test_a_face_shows_what_it_promises(room: str) -> None:
    face = import_module(f"calib.{room}")
    assert [name for name in face.__all__ if not hasattr(face, name)] == []


def test_no_name_of_the_whole_hides_a_room() -> None:
    assert all(hasattr(calib, name) for name in calib.__all__)
    assert set(calib.__all__).isdisjoint(ROOMS)

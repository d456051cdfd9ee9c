"""The packages of the program, found although others have their names (decision 154).

Their names are plain (`calib`, `service`), and a process has one package of a name. Where a package of the user has
it, ours is imported as `truepose.NAME`: the import statements of our modules lead there, those of the user to theirs.
"""

from __future__ import annotations

import builtins
import os
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

ROOMS = ("acquisition", "calib", "drivers", "fleet", "mocks", "service")
HOME = Path(__file__).resolve().parents[1]
_moved: set[str] = set()  # rooms that are imported as `truepose.NAME`


def make_way() -> None:
    """Move every package whose name is that of another one, imported or found by Python."""
    taken = {room for room in ROOMS if not _is_ours(room)} - _moved
    if taken:
        _moved.update(taken)
        _install()


def take() -> None:
    """Use all names for our packages: this process and its children run no code of the user."""
    if _moved:
        _moved.clear()
        path = os.environ.get("PYTHONPATH")
        os.environ["PYTHONPATH"] = os.pathsep.join([str(HOME), *([path] if path else [])])


def _is_ours(room: str) -> bool:
    loaded = sys.modules.get(room)
    spec = find_spec(room) if loaded is None else loaded.__spec__
    return spec is not None and spec.origin is not None and Path(spec.origin).resolve().parent == HOME / room


def _install() -> None:
    if not any(isinstance(each, _Rooms) for each in sys.meta_path):
        sys.meta_path.insert(0, _Rooms())


class _Rooms:
    """Finds our modules at home, and gives those with import statements our `__import__`."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        first, _, below = name.partition(".")
        if (first == "truepose" and below in _moved) or (name in ROOMS and name not in _moved):
            path = [str(HOME)]
        elif first != "truepose" and (first not in ROOMS or first in _moved):
            return None
        spec = PathFinder.find_spec(name, path)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(name, spec.loader.path)
        return spec


class _Loader(SourceFileLoader):
    def exec_module(self, module: ModuleType) -> None:
        module.__dict__["__builtins__"] = {**vars(builtins), "__import__": _import}
        super().exec_module(module)


def _import(
    name: str,
    globals: Mapping[str, Any] | None = None,
    locals: Mapping[str, Any] | None = None,
    fromlist: Sequence[str] | None = (),
    level: int = 0,
) -> Any:
    first = name.partition(".")[0]
    if level or first not in _moved:
        return builtins.__import__(name, globals, locals, fromlist or (), level)
    found = import_module(f"truepose.{name}")
    if not fromlist:
        return sys.modules[f"truepose.{first}"]
    return builtins.__import__(found.__name__, globals, locals, fromlist, 0)

"""TruePose from Python: read, identify, diagnose, validate, sweeps, select, compensate, simulate.

    import truepose

    data = truepose.read("irb120.csv")  # and irb120.toml beside it
    found = truepose.diagnose(data, progress=print)
    print(found.sentence)
    found.effects  # a pandas DataFrame
    found.model.save("irb120.json")

Arguments and columns have their units in their names: mm, deg, s. Invalid input raises `DataError`, which names
the place and the remedy. The names in `__all__` are stable. A name that has to be removed gives a warning for a
year before.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from truepose import rooms

if TYPE_CHECKING:
    from calib.errors import DataError
    from truepose.correction import Corrected, compensate
    from truepose.data import Data, read
    from truepose.diagnosis import Diagnosis, diagnose
    from truepose.model import Model, identify, load
    from truepose.selection import Selection, select
    from truepose.simulation import simulate
    from truepose.sweep_analysis import Sweeps, sweeps
    from truepose.validation import Validation, validate

    __version__: str

__all__ = [
    "Corrected",
    "Data",
    "DataError",
    "Diagnosis",
    "Model",
    "Selection",
    "Sweeps",
    "Validation",
    "compensate",
    "diagnose",
    "identify",
    "load",
    "read",
    "select",
    "simulate",
    "sweeps",
    "validate",
]

# Place of each name: imported on first use, which keeps `import truepose` short
_HOMES = {
    "Corrected": "correction",
    "Data": "data",
    "DataError": "data",
    "Diagnosis": "diagnosis",
    "Model": "model",
    "Selection": "selection",
    "Sweeps": "sweep_analysis",
    "Validation": "validation",
    "compensate": "correction",
    "diagnose": "diagnosis",
    "identify": "model",
    "load": "model",
    "read": "data",
    "select": "selection",
    "simulate": "simulation",
    "sweeps": "sweep_analysis",
    "validate": "validation",
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib import metadata

        return metadata.version("truepose")
    if name in _HOMES:
        rooms.make_way()
        return getattr(import_module(f"truepose.{_HOMES[name]}"), name)
    raise AttributeError(f"truepose has no {name!r}; there are {', '.join(__all__)}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


rooms.make_way()

"""Tables as pandas has them. Pandas is an extra, `truepose[pandas]`: everything else works without it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

from service.extras import named

if TYPE_CHECKING:
    import pandas


def pandas_module() -> ModuleType:
    """Return the module pandas.

    Raises
    ------
    ImportError
        It is not installed; the message states the command for it.
    """
    with named():
        import pandas
    return pandas


def frame(columns: Mapping[str, Any], index: Sequence[Any] | None = None, name: str = "") -> pandas.DataFrame:
    """Create a table from columns of equal length.

    `index` has one label per row, under `name`.
    """
    pd = pandas_module()
    labels = None if index is None else pd.Index(list(index), name=name or None)
    return pd.DataFrame(dict(columns), index=labels)


def frame_of_rows(rows: Sequence[Mapping[str, Any]], columns: Sequence[str], index: str) -> pandas.DataFrame:
    """Create a table from rows, one mapping each, in the order of `columns`.

    `index` names the column of labels.
    """
    own = {column: [row.get(column) for row in rows] for column in columns}
    return frame(own, [row[index] for row in rows], index)

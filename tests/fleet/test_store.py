"""A store on SQLite and on PostgreSQL: what is put in is there, once."""

from __future__ import annotations

from fleet.store import Store
from tests.fleet.documents import BEGAN, ROBOT, model


def test_what_is_put_in_comes_out_byte_for_byte(store: Store) -> None:
    given = model({"d1": 1.5})
    assert store.add(given).state == "new"
    assert store.content(given.hash) == given.content
    (entry,) = store.documents()
    assert (entry.hash, entry.robot, entry.measured_at, entry.size) == (
        given.hash,
        ROBOT,
        BEGAN,
        len(given.content),
    )
    assert entry.program == "truepose 0.1.0"
    assert not entry.conflict

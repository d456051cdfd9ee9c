"""Changes to the store of many robots."""

from __future__ import annotations

from tests.sabotage.change import Change

_STORE = ("tests/fleet/test_store.py",)
_SCHEMA = ("tests/fleet/test_schema.py",)
_GONE = ("tests/fleet/test_gone.py",)
_HISTORY = ("tests/service/test_history.py",)

CHANGES = (
    Change(
        "fleet/store/adding.py",
        "            if taken[each.hash] != (each.kind, robots[each.robot]):",
        "            if False:",
        "a document of one robot is known as that of another",
        _STORE,
    ),
    Change(
        "fleet/store/adding.py",
        '"conflict" if others else "new"',
        '"new"',
        "two contents of one thing are not told",
        _STORE,
    ),
    Change(
        "fleet/store/adding.py",
        "        versions[each.identity].append(each.hash)\n",
        "",
        "two contents of one thing in one batch are not told",
        _STORE,
    ),
    Change(
        "fleet/store/adding.py",
        "    except exc.IntegrityError as error:\n        raise ConcurrentInsert from error\n",
        "",
        "two programs that add the same at once end with an error",
        _STORE,
    ),
    Change(
        "fleet/store/engine.py",
        '"BEGIN IMMEDIATE" if writes else "BEGIN"',
        '"BEGIN"',
        "two that write an SQLite file at once end with an error",
        _STORE,
    ),
    Change(
        "fleet/store/engine.py",
        '    event.listen(engine, "begin", _begin_sqlite)',
        "    pass",
        "what an SQLite file was given is kept by half",
        (*_STORE, *_GONE, *_SCHEMA),
    ),
    Change(
        "fleet/store/postgres.py",
        "        pool_pre_ping=True,",
        "        pool_pre_ping=False,",
        "a server that was away stays away",
        _GONE,
    ),
    Change(
        "fleet/store/engine.py",
        "    if any(mark in words for mark in _FULL):",
        "    if False:",
        "a full disk is called a server that does not answer",
        _GONE,
    ),
    Change(
        "fleet/store/engine.py",
        "hide_password=True",
        "hide_password=False",
        "a refusal tells the password",
        (*_SCHEMA, *_HISTORY),
    ),
    Change(
        "fleet/store/rows.py",
        "        u = None if std is None else K * std\n    return",
        "        u = std\n    return",
        "U of a parameter is its standard error",
        _STORE,
    ),
    Change(
        "fleet/store/rows.py",
        'if judged is None or table.get("updates"):',
        "if judged is None:",
        "an updated model states the error of its calibration again",
        _STORE,
    ),
    Change(
        "fleet/store/engine.py",
        "    if found and found not in known:",
        "    if False:",
        "a store of a newer program is opened",
        _SCHEMA,
    ),
    Change(
        "fleet/store/engine.py",
        "        if names:\n",
        "        if False:\n",
        "tables are made beside those of something else",
        _SCHEMA,
    ),
    Change(
        "fleet/store/engine.py",
        'f"GRANT INSERT ON {names} TO {WRITER}"',
        'f"GRANT INSERT, DELETE ON {names} TO {WRITER}"',
        "a writer may delete documents",
        _SCHEMA,
    ),
    Change(
        "fleet/store/work.py",
        "sa.or_(c.until <= now, c.owner == owner)",
        "sa.or_(c.until > now, c.owner == owner)",
        "a job is taken from whoever works on it",
        _STORE,
    ),
    Change(
        "fleet/store/work.py",
        "sorted(set(jobs) - self._done(connection, jobs), key",
        "sorted(set(jobs), key",
        "what has a result is done again",
        _STORE,
    ),
    Change(
        "fleet/store/tables.py",
        "        return moment.replace(tzinfo=None) if",
        "        return value.replace(tzinfo=None) if",
        "an SQLite file keeps local times",
        _STORE,
    ),
    Change(
        "fleet/store/robot_state.py",
        ".order_by(p.robot, p.name, p.measured_at, p.document)",
        ".order_by(p.robot, p.name, p.document)",
        "a trend is in the order in which documents came",
        _STORE,
    ),
    Change(
        "fleet/store/robot_state.py",
        "(d.measured_at > d.added_at, d.added_at)",
        "(d.measured_at > d.added_at, d.measured_at)",
        "a cell whose clock is ahead has the last word for years",
        _STORE,
    ),
    Change(
        "service/results/history.py",
        "due.date <= now",
        "due.date > now",
        "what is overdue is not",
        _HISTORY,
    ),
    Change(
        "service/refusals.py",
        "    if isinstance(refusal, StoreGone):\n        return exit_codes.NOT_AVAILABLE\n",
        "",
        "a store that is away is called a wrong command line",
        (*_HISTORY, *_GONE),
    ),
    Change(
        "calib/watch/whitened_readings.py",
        "variance += float(turn @",
        "variance += 0.0 * float(turn @",
        "U of the error at check poses forgets the frame",
        ("tests/calib/test_missed.py",),
    ),
)

"""Changes to the diagnosis of many robots, and to the collection of their documents."""

from __future__ import annotations

from tests.sabotage.change import Change

_BATCH = ("tests/fleet/diagnose/test_batch.py",)
_STATEMENT = ("tests/fleet/diagnose/test_statement.py",)
_CHANGES = ("tests/fleet/diagnose/test_changes.py",)
_SOURCE = ("tests/fleet/diagnose/test_source.py",)
_TALLY = ("tests/fleet/diagnose/test_tally.py",)
_PLANT = ("tests/fleet/test_plant.py",)
_CROWD = ("tests/fleet/test_plant_crowd.py",)
_TOKENS = ("tests/fleet/test_own_tokens.py",)
_LINK = ("tests/fleet/test_link.py",)
_FOLDER = ("tests/fleet/test_folder.py",)

CHANGES = (
    Change(
        "fleet/diagnose/batch.py",
        "    except StoreError:  # says nothing about the data\n        raise\n",
        "",
        "fleet diagnose: a store that is away makes data refused for ever",
        _BATCH,
    ),
    Change(
        "fleet/diagnose/batch.py",
        "if job in others - found)",
        "if job in others)",
        "fleet diagnose: what has a result is waited for without end",
        _BATCH,
    ),
    Change(
        "fleet/diagnose/statement.py",
        "float(value) if math.isfinite(value) else None",
        "float(value)",
        "fleet diagnose: a size that is no number stops the call",
        _STATEMENT,
    ),
    Change(
        "fleet/diagnose/changes.py",
        "for result in before}",
        "for result in reversed(list(before))}",
        "fleet diagnose: the oldest result of a data set is what it was before",
        _CHANGES,
    ),
    Change(
        "fleet/diagnose/changes.py",
        "max(was[1], now[1])",
        "was[1] + now[1]",
        "fleet diagnose: a size that has moved by its standard error is not told",
        _CHANGES,
    ),
    Change(
        "fleet/diagnose/batch.py",
        " + _own_robot(header, path.parent)",
        "",
        "fleet diagnose: another robot file of one's own gives the old result",
        _SOURCE,
    ),
    Change(
        "fleet/diagnose/batch.py",
        "    _refuse_own_robot(header)\n",
        "",
        "fleet diagnose: a header that was sent opens a file of this computer",
        _SOURCE,
    ),
    Change(
        "fleet/diagnose/run.py",
        "    return max(1, min(share, round(BATCH_S",
        "    return max(1, max(share, round(BATCH_S",
        "fleet diagnose: batches grow beyond what a worker may lose",
        _TALLY,
    ),
    Change(
        "fleet/diagnose/progress.py",
        " - self.twice - len(self.failed)",
        " - len(self.failed)",
        "fleet diagnose: what two have computed is still to come at the end",
        _TALLY,
    ),
    Change(
        "service/plant/routes.py",
        "                async with asyncio.timeout(PIECE_S):",
        "                async with asyncio.timeout(None):",
        "fleet server: a cell that falls silent in an upload holds its place for ever",
        _CROWD,
    ),
    Change(
        "service/plant/routes.py",
        "    if uploads.total() >= UPLOADS or ",
        "    if ",
        "fleet server: as many uploads wait as come",
        _CROWD,
    ),
    Change(
        "service/plant/routes.py",
        " or uploads[sender] >= SHARE:",
        ":",
        "fleet server: slow uploads of one cell take the places of all",
        _CROWD,
    ),
    Change(
        "service/plant/routes.py",
        "        async with asyncio.timeout(UPLOAD_S):",
        "        async with asyncio.timeout(None):",
        "fleet server: an upload that trickles holds its place for ever",
        _CROWD,
    ),
    Change(
        "service/plant/routes.py",
        "        if own.robots and robot not in own.robots:",
        "        if own.robots and robot.serial not in {each.serial for each in own.robots}:",
        "fleet server: a token writes about a robot of another type with the same serial number",
        _TOKENS,
    ),
    Change(
        "service/plant/routes.py",
        "measured_at - now > AHEAD:",
        "abs(measured_at - now) > AHEAD:",
        "fleet server: what an outbox has kept for weeks is refused",
        _PLANT,
    ),
    Change(
        "service/plant/app.py",
        'if role is Role.VIEWER and method not in ("GET", "HEAD"):',
        "if role is Role.VIEWER and not method:",
        "fleet server: the token of a viewer puts documents in",
        _PLANT,
    ),
    Change(
        "fleet/outbox/link.py",
        "        if answer.length and len(data) < LONGEST_ANSWER:",
        "        if not answer:",
        "outbox: an answer that was cut off is one",
        _LINK,
    ),
    Change(
        "fleet/outbox/folder.py",
        "    if len(found) > 1:",
        "    if len(found) > 9:",
        "outbox: what was merged of two robots is sent as one's",
        _FOLDER,
    ),
)

"""Changes to the outbox of a cell and to the server of a fleet."""

from __future__ import annotations

from tests.sabotage.change import Change

_QUEUE = ("tests/fleet/test_outbox.py",)
_SENDER = ("tests/fleet/test_sender.py",)
_LINK = ("tests/fleet/test_link.py",)
_PLANT = ("tests/fleet/test_plant.py",)
_FOLDER = ("tests/fleet/test_folder.py",)

CHANGES = (
    Change(
        "fleet/outbox/queue.py",
        "PRAGMA synchronous = EXTRA",
        "PRAGMA synchronous = NORMAL",
        "outbox: an entry is not on the disk when it is taken in",
        _QUEUE,
    ),
    Change(
        "fleet/outbox/queue.py",
        "\"WHERE hash = ? AND state = 'waiting'\"",
        '"WHERE hash = ?"',
        "outbox: what the server has is set aside by a late refusal",
        _QUEUE,
    ),
    Change(
        "fleet/outbox/sender.py",
        "key=self._failures)",
        "key=lambda hash_: 0)",
        "outbox: documents that never arrive starve the others",
        _SENDER,
    ),
    Change(
        "fleet/outbox/sender.py",
        "min(FIRST_S * 2.0 ** min(patience.failures - 1, 30), LONGEST_S)",
        "FIRST_S * 2.0 ** min(patience.failures - 1, 30)",
        "outbox: after weeks without a server it is asked once in a month",
        _SENDER,
    ),
    Change(
        "fleet/outbox/sender.py",
        "if hashlib.sha256(document.content).hexdigest() != hash_:",
        "if not document.content:",
        "outbox: a content that its disk has spoiled is sent",
        _SENDER,
    ),
    Change(
        "fleet/outbox/link.py",
        'if document.get("hash") == hash_:',
        "if status:",
        "outbox: the page of a portal is an acknowledgement",
        _LINK,
    ),
    Change(
        "fleet/outbox/link.py",
        "_AWAY = (429, 503, 507)",
        "_AWAY = (429, 503)",
        "outbox: a full server is a fault of the document",
        _LINK,
    ),
    Change(
        "service/plant/routes.py",
        "    if document.hash != hash:",
        "    if not hash:",
        "fleet server: a damaged content is kept",
        _PLANT,
    ),
    Change(
        "service/plant/routes.py",
        "    if added.other_hashes:",
        '    if added.state == "conflict":',
        "fleet server: a contradiction is told only once",
        _PLANT,
    ),
    Change(
        "service/plant/app.py",
        'if role is Role.OPERATOR and not (method == "PUT" and _PUT.fullmatch(path)):',
        'if role is Role.OPERATOR and not (method in ("GET", "PUT")):',
        "fleet server: the token of a cell reads the whole plant",
        _PLANT,
    ),
    Change(
        "fleet/outbox/folder.py",
        "    if simulated and not cell.simulated:",
        "    if not cell:",
        "outbox: simulated robots go into the store of the real ones",
        _FOLDER,
    ),
    Change(
        "service/results/robots.py",
        "        if status.state != State.SUCCEEDED.value:",
        "        if not status:",
        "outbox: a record is sent before its end",
        _FOLDER,
    ),
)

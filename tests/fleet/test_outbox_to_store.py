"""From the outbox of a cell into the store, through a lossy proxy, with restarts.

The proxy loses and doubles three requests in ten, while server and sender are started again. These would catch: a
document that is lost, one that is kept twice, and a second answer that is taken for a contradiction.
`python -m tests.benchmarks outbox` does it with 10,000 and kill -9.
"""

from __future__ import annotations

import random
import socket
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
import uvicorn

from fleet.outbox import FILE, Outbox, Sender, ServerLink
from fleet.store import FleetStore
from service.http.access.roles import Tokens
from service.plant import FleetServerSettings, Senders, create_plant
from tests.fleet import documents
from tests.fleet.lossy import FATES, Lossy, lossy
from tests.fleet.test_outbox import NOW

TOKENS = Tokens("only-for-the-cells-of-the-tests", "only-for-the-viewers-of-the-tests")
COUNT = 300


@contextmanager
def server_of(url: str) -> Iterator[int]:
    """Run the server of a store in a thread, on a separate port."""
    with FleetStore.open(url) as store, socket.create_server(("127.0.0.1", 0)) as listener:
        config = uvicorn.Config(
            create_plant(store, FleetServerSettings(Senders(TOKENS))), log_level="warning", access_log=False
        )
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            yield listener.getsockname()[1]
        finally:
            server.should_exit = True
            thread.join()


class Clock:
    """Clock that stands still until a thread waits."""

    time_s = 0.0

    def __call__(self) -> float:
        return self.time_s


def send(outbox: Outbox, proxy: Lossy, clock: Clock, *, at_most: int) -> None:
    """Send with a separate sender until nothing waits or `at_most` requests have come."""
    begun = proxy.requests
    with closing(ServerLink(f"http://127.0.0.1:{proxy.port}", TOKENS.operator, timeout_s=60.0)) as link:
        sender = Sender(outbox, link, clock, chance=random.Random(1))
        while True:
            done = sender.round(lambda: proxy.requests - begun >= at_most)
            if done.wait_s is None or proxy.requests - begun >= at_most:
                return
            clock.time_s += done.wait_s


def test_all_there_once_through_a_network_that_loses_and_doubles(tmp_path: Path) -> None:
    made = [documents.model({"d1": 0.001 * day}, day=day / 10) for day in range(COUNT)]
    url = f"sqlite:///{tmp_path}/plant.sqlite3"
    clock = Clock()
    with lossy(None) as proxy:
        with Outbox(tmp_path / FILE) as outbox:
            for each in made:
                outbox.put(each, NOW)
            send(outbox, proxy, clock, at_most=5)  # nobody is there yet
        for number in range(3):  # the server and the sender end in the middle of it, and begin again
            with server_of(url) as proxy.server, Outbox(tmp_path / FILE) as outbox:
                send(outbox, proxy, clock, at_most=110 if number < 2 else 10**9)
        assert all(proxy.fates[fate] > 15 for fate in FATES)
    with Outbox(tmp_path / FILE) as outbox, FleetStore.open(url) as store:
        assert (outbox.entries("waiting", "aside"), len(outbox.entries("sent"))) == ([], COUNT)
        listed = store.documents(limit=2 * COUNT)
        assert sorted(entry.hash for entry in listed) == sorted(each.hash for each in made)
        assert not any(entry.conflict for entry in listed)
        assert all(store.content(each.hash) == each.content for each in made[::10])


def test_an_outbox_waits_while_the_database_is_gone_and_its_own_bad_document_stays(tmp_path: Path) -> None:
    """A good document arrives after an hour without a database; a contradiction is reported."""
    from fleet.errors import StoreGone

    url = f"sqlite:///{tmp_path}/plant.sqlite3"
    first = documents.model({"d1": 1.0}, identity="record 7")
    other = documents.model({"d1": 2.0}, identity="record 7")
    good = documents.model({"d1": 3.0}, day=1)
    clock = Clock()
    with FleetStore.open(url) as store, pytest.MonkeyPatch.context() as patch:
        store.add(first)
        add = FleetStore.add

        def while_away(self: FleetStore, document: object) -> object:
            if clock() < 3600.0:
                raise StoreGone("does not answer.", do="Look at the database.", file="db")
            return add(self, document)  # type: ignore[arg-type]

        patch.setattr(FleetStore, "add", while_away)
        with (
            server_of(url) as port,
            Outbox(tmp_path / FILE) as outbox,
            closing(ServerLink(f"http://127.0.0.1:{port}", TOKENS.operator, timeout_s=60.0)) as link,
        ):
            for each in (other, good):
                outbox.put(each, NOW)
            sender = Sender(outbox, link, clock, chance=random.Random(1))
            rounds = 0
            while (done := sender.round()).wait_s is not None:
                rounds += 1
                assert clock() < 3600.0
                assert len(outbox.entries("waiting")) == 2
                clock.time_s += done.wait_s
            assert 5 < rounds < 40
            (aside,) = outbox.entries("aside")
            assert aside.hash == other.hash
            assert first.hash in aside.said
            assert [entry.hash for entry in outbox.entries("sent")] == [good.hash]
        assert {entry.hash for entry in store.documents()} == {first.hash, other.hash, good.hash}


def test_a_model_with_carried_terms_waits_aside_for_a_server_that_knows_them(tmp_path: Path) -> None:
    """An old server knows one format of models.

    The outbox keeps the document, and sends it to a newer server.
    """
    carrying = documents.of("model", {"format": "truepose-model/2", "parameters": [], "effects": []})
    url = f"sqlite:///{tmp_path}/plant.sqlite3"

    def sent_by(outbox: Outbox) -> None:
        with server_of(url) as port, closing(ServerLink(f"http://127.0.0.1:{port}", TOKENS.operator)) as link:
            Sender(outbox, link, Clock(), chance=random.Random(1)).round()

    with Outbox(tmp_path / FILE) as outbox:
        outbox.put(carrying, NOW)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("fleet.store.rows._ALSO", ())
            sent_by(outbox)
        (aside,) = outbox.entries("aside")
        assert aside.hash == carrying.hash
        assert "truepose-model/2" in aside.said
        assert outbox.retry(carrying.hash, NOW)
        sent_by(outbox)
        assert [entry.hash for entry in outbox.entries("sent")] == [carrying.hash]

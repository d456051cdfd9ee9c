"""The sender of an outbox, on a clock and a link of the tests.

These would catch: a document that is abandoned, one that holds up the others, a server that is queried without end, and
a content that leaves the outbox unacknowledged.
"""

from __future__ import annotations

import random
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import pytest

from fleet.outbox import FILE, Outbox, Sender, UploadAnswer
from fleet.outbox.sender import DAMAGED, FIRST_S, LONGEST_S, PATIENCE_S
from fleet.store import Document
from tests.fleet import documents
from tests.fleet.test_outbox import NOW

AWAY, FAILED = UploadAnswer("away", "nobody answers"), UploadAnswer("failed", "cut off")


@dataclass
class World:
    """A server as `answer` says, and a clock that the test moves."""

    outbox: Outbox
    answer: Callable[[Document], UploadAnswer] = lambda document: UploadAnswer("kept")
    time_s: float = 0.0
    sent: list[tuple[float, str]] = field(default_factory=list)

    def put(self, document: Document) -> UploadAnswer:
        self.sent.append((self.time_s, document.hash))
        return self.answer(document)

    def sender(self, say: Callable[[str], None] = lambda text: None) -> Sender:
        return Sender(self.outbox, self, lambda: self.time_s, lambda: NOW, random.Random(1), say)

    def run(self, sender: Sender, seconds: float) -> None:
        """Send rounds until nothing waits or the time is over.

        The clock jumps to the sender's next round.
        """
        end = self.time_s + seconds
        while self.time_s < end:
            done = sender.round()
            if done.wait_s is None:
                return
            self.time_s += max(done.wait_s, 1e-3)


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    with Outbox(tmp_path / FILE) as outbox:
        yield World(outbox)


def fill(outbox: Outbox, count: int) -> list[Document]:
    made = [documents.model({"d1": 0.01 * day}, day=day) for day in range(count)]
    for each in made:
        outbox.put(each, NOW)
    return made


def states(outbox: Outbox) -> tuple[int, int, int]:
    return (len(outbox.entries("waiting")), len(outbox.entries("aside")), len(outbox.entries("sent")))


def test_everything_is_sent_oldest_first_and_once(world: World) -> None:
    made = fill(world.outbox, 5)
    sender = world.sender()
    done = sender.round()
    assert (done.kept, done.waiting, done.trouble, done.wait_s) == (5, 0, "", None)
    assert [hash_ for _, hash_ in world.sent] == [each.hash for each in made]
    assert sender.round().kept == 0
    assert len(world.sent) == 5


def test_three_weeks_without_a_network(world: World) -> None:
    fill(world.outbox, 8)
    week = 7 * 86400.0
    world.answer = lambda document: AWAY
    sender = world.sender()
    world.run(sender, 3 * week)
    times = [time for time, _ in world.sent]
    gaps = [later - before for before, later in pairwise(times)]
    assert FIRST_S / 2 <= gaps[0] <= FIRST_S
    assert max(gaps) <= LONGEST_S
    assert min(gaps[12:]) >= LONGEST_S / 2  # asked at most twice in ten minutes, whatever waits
    assert states(world.outbox) == (8, 0, 0)
    world.answer = lambda document: UploadAnswer("kept")
    begun = world.time_s
    world.run(sender, week)
    assert states(world.outbox) == (0, 0, 8)
    assert world.time_s - begun <= LONGEST_S


def test_a_refused_document_is_set_aside_with_its_reason_and_the_rest_go_on(world: World) -> None:
    made = fill(world.outbox, 4)
    bad = made[1].hash
    world.answer = lambda document: (
        UploadAnswer("refused", "is of a newer version") if document.hash == bad else UploadAnswer("kept")
    )
    said: list[str] = []
    done = world.sender(said.append).round()
    assert (done.kept, done.refused, done.waiting) == (3, 1, 0)
    assert "is of a newer version" in said[0]
    (entry,) = world.outbox.entries("aside")
    assert (entry.hash, entry.said) == (bad, "is of a newer version")
    assert world.outbox.document(bad) == made[1]
    assert world.sender().round().kept == 0  # not sent again by itself
    world.answer = lambda document: UploadAnswer("kept")
    world.outbox.retry(bad, NOW)
    assert world.sender().round().kept == 1


@pytest.mark.parametrize("poisoned", [1, 3, 6])
def test_documents_that_never_arrive_hold_up_nobody(world: World, poisoned: int) -> None:
    """The server answers each upload of the oldest documents with an internal error."""
    made = fill(world.outbox, 20)
    bad = {each.hash for each in made[:poisoned]}
    world.answer = lambda document: FAILED if document.hash in bad else UploadAnswer("kept")
    sender = world.sender()
    world.run(sender, 600.0)
    assert states(world.outbox) == (poisoned, 0, 20 - poisoned)
    tries = [hash_ for _, hash_ in world.sent if hash_ in bad]
    assert len(tries) < 40 * poisoned  # and they are not asked without end
    world.answer = lambda document: UploadAnswer("kept")
    world.run(sender, 2 * LONGEST_S)
    assert states(world.outbox) == (0, 0, 20)


def test_the_server_says_when_to_come_back(world: World) -> None:
    fill(world.outbox, 3)
    for asked, least, most in (
        (120.0, 120.0, 120.0),
        (1e7, PATIENCE_S, PATIENCE_S),
        (0.0, FIRST_S, 4 * FIRST_S),
    ):
        world.answer = lambda document, asked=asked: UploadAnswer("away", "full", asked)
        done = world.sender().round()
        assert done.waiting == 3
        assert done.wait_s is not None
        assert min(least, FIRST_S / 2) <= done.wait_s <= most
        assert asked < 1.0 or done.wait_s >= least
    assert len(world.sent) == 3  # one a round: the others would fare no better


def test_a_wrong_token_sets_nothing_aside(world: World) -> None:
    fill(world.outbox, 3)
    world.answer = lambda document: UploadAnswer("barred", "The token is missing or wrong.")
    done = world.sender().round()
    assert done.barred
    assert done.trouble == "The token is missing or wrong."
    assert states(world.outbox) == (3, 0, 0)
    assert len(world.sent) == 1


def test_what_arrives_damaged_every_time_is_set_aside_in_the_end(world: World) -> None:
    made = fill(world.outbox, 2)
    bad = made[0].hash
    world.answer = lambda document: (
        UploadAnswer("damaged", "has the hash 1.") if document.hash == bad else UploadAnswer("kept")
    )
    world.run(world.sender(), 86400.0)
    (entry,) = world.outbox.entries("aside")
    assert (entry.hash, entry.tries) == (bad, DAMAGED)
    assert f"damaged {DAMAGED} times" in entry.said


def test_a_content_that_changed_in_the_file_is_not_sent(world: World, tmp_path: Path) -> None:
    made = fill(world.outbox, 2)
    with closing(sqlite3.connect(tmp_path / FILE)) as disk, disk:
        disk.execute("UPDATE entry SET content = ? WHERE hash = ?", (b"something else", made[0].hash))
    done = world.sender().round()
    assert (done.kept, done.refused) == (1, 1)
    assert [hash_ for _, hash_ in world.sent] == [made[1].hash]
    assert "disk is failing" in world.outbox.entries("aside")[0].said


def test_it_leaves_off_when_it_is_asked_to(world: World) -> None:
    fill(world.outbox, 5)
    done = world.sender().round(ended=lambda: len(world.sent) >= 2)
    assert (done.kept, done.waiting) == (2, 3)

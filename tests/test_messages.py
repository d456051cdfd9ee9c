"""The list of messages that `python -m tests.messages` prints: it is whole, and no message ends in mid-sentence."""

from __future__ import annotations

from tests.messages import Message, messages


def test_the_list_holds_messages_of_every_kind() -> None:
    found = messages()
    assert len(found) > 800
    texts = {each.text for each in found}
    assert "not connected" in texts  # where it is raised
    assert "Read the message, put the device in order and confirm to go on." in texts  # the advice of a class
    assert "has the shape {angles.shape}." in texts  # with what is filled in
    assert "Give (n, {robot.joints}) angles." in texts  # what to do


def test_what_is_wrong_and_what_to_do_are_whole_sentences() -> None:
    """A DataError is put together of both, with a blank between."""

    def torn(each: Message) -> bool:
        return each.text != each.text.strip() or "  " in each.text or ".." in each.text.replace("...", "")

    assert not [each for each in messages() if each.error == "DataError" and torn(each)]

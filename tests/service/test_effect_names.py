"""Names of effects for readers, and names of a class of effects by all its members.

These would catch: an effect of the library with a name for experts only, and one rival of several in a headline as if
it were certain. They would also catch a name that loses its joint or its order.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from calib.effects import entries, words_of
from service.effect_names import listed, members_of, name_of


def found(own: str, **candidates: float) -> Any:
    weights = {label.replace("__", ":"): w for label, w in candidates.items()}
    evidence = SimpleNamespace(candidates=weights, certain=max(weights.values()) >= 0.95)
    return SimpleNamespace(effect=SimpleNamespace(label=own), evidence=evidence)


def test_every_kind_of_the_library_has_words() -> None:
    kinds = [kind for entry in entries() for kind in entry.KINDS]
    assert len(kinds) > 25
    for kind in kinds:
        label = f"{kind.name}:j3:n17"
        words = kind.words_of(label)
        assert words not in ("", label)
        assert not set(words) & set("{}:_")


@pytest.mark.parametrize(
    ("label", "words"),
    [
        ("periodic:j3:n1", "gear of joint 3, once a turn"),
        ("periodic:j3:n2", "gear of joint 3, twice a turn"),
        ("periodic:j1:n100.25", "gear of joint 1, 100.25 times a turn"),
        ("coupling:j4-j5", "coupling of joints 4 and 5"),
        ("base_target_shift:{B}<1>", "seat of base target {B}<1>"),
        ("tool_shift", "tool moved on the flange"),
    ],
)
def test_words_name_joint_order_and_target(label: str, words: str) -> None:
    assert words_of(label) == words


def test_a_certain_effect_is_called_by_its_own_name() -> None:
    sure = found("backlash:j4", backlash__j4=0.97, settling__j4=0.03)
    assert members_of(sure) == [("play of joint 4", "backlash:j4", 0.97)]
    assert name_of(sure) == "play of joint 4"


def test_a_class_is_called_by_its_members_heaviest_first() -> None:
    two = found("backlash:j4", settling__j4=0.6, backlash__j4=0.4, pedestal=0.001)
    assert name_of(two) == "either slow settling of joint 4 or play of joint 4"
    many = found("periodic:j1:n2", **{f"periodic__j1__n{n}": 0.2 for n in (2, 3, 4, 5, 6)})
    assert name_of(many).startswith("one of 5: gear of joint 1, twice a turn")
    assert name_of(many).endswith("or 2 more")
    spread = found("periodic:j1:n2", **{f"periodic__j1__n{n}": 0.005 for n in range(2, 202)})
    assert len(members_of(spread)) == 2  # a class never shrinks to one name
    assert listed([two] * 5).endswith("; and 2 more")

"""The picture of an arm that `truepose robot check` draws.

These would catch: words that overlap, a length that is not in the robot file, and a line that does not end at the
flange. They would also catch the length of a slide written as if it were the arm's.
"""

from __future__ import annotations

import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from calib.arm import Robot, built_in_robots, forward, load_robot
from service.report.figures.arm_picture import arm_svg, skeleton_of
from tests.calib.machines import MACHINES, machine

_TEXT = re.compile(
    r'<text x="([\d.-]+)" y="([\d.-]+)" text-anchor="middle" font-size="([\d.]+)"[^>]*>([^<]+)</text>'
)


def arms(folder: Path) -> list[Robot]:
    return [load_robot(name) for name in built_in_robots()] + [machine(name, folder) for name in MACHINES]


def views(robot: Robot, joints: np.ndarray) -> list[list[tuple[float, float, float, str]]]:
    """Return the words of each of the four views: x of the middle, y, size, text."""
    drawn = arm_svg(robot, joints, robot.name).split("<g transform")[1:]
    return [[(float(x), float(y), float(s), t) for x, y, s, t in _TEXT.findall(view)] for view in drawn]


def test_no_word_stands_on_another(tmp_path: Path) -> None:
    for robot in arms(tmp_path):
        for joints in (np.zeros(robot.joints), (np.array(robot.lower) + np.array(robot.upper)) / 2.0):
            for words in views(robot, joints):
                assert sum(text.isdigit() and size == 12.0 for *_, size, text in words) == robot.joints
                for (x, y, size, text), (u, v, other, beside) in combinations(words, 2):
                    apart = 0.28 * (
                        size * len(text) + other * len(beside)
                    )  # half of 0.56 of their sizes a letter
                    assert abs(x - u) >= apart or abs(y - v) >= 11.0, (robot.name, text, beside)


def test_the_lengths_are_those_of_the_file_and_lead_to_the_flange(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for robot in arms(tmp_path):
        low, high = np.array(robot.lower), np.array(robot.upper)
        joints = rng.uniform(low, high)
        corners, _ = skeleton_of(robot, joints)
        assert corners[-1] == pytest.approx(forward(robot, joints[None])[0, :3, 3], abs=1e-9)
        of_file = {f"{abs(x):.5g}" for x in (*robot.a, *robot.d)}
        bold = {text for words in views(robot, joints) for *_, size, text in words if size == 11.0} - set(
            "xyz"
        )
        assert bold <= of_file, (robot.name, bold - of_file)


def test_every_length_of_an_arm_in_the_box_is_written_once() -> None:
    robot = load_robot("abb-irb120")
    joints = np.zeros(6)
    bold = sorted(t for words in views(robot, joints) for *_, s, t in words if s == 11.0 and t not in "xyz")
    assert bold == sorted(["290", "270", "70", "302", "72"])


def test_a_slide_has_no_length(tmp_path: Path) -> None:
    track = machine("track", tmp_path)
    joints = np.zeros(track.joints)
    joints[0] = 1234.0
    assert not any(text == "1234" for words in views(track, joints) for *_, text in words)

"""Every hidden effect: absent at zero, as large as asked, named, and like its law."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mocks.world import (
    DEPARTURES,
    LAWS,
    OUTSIDE,
    ROBOTS,
    ArmState,
    Effect,
    World,
    demo_labels,
    displacement,
    group_of,
    noise_rms,
    random_label,
    rms_per_axis,
    robot_named,
    scaled,
    stream,
)
from mocks.world.scaling import rehearsal

LABELS = [
    "periodic:j2:n3",
    "periodic:j5:n100.25",
    "encoder_scale:j6",
    "joint_offset:j3",
    "joint_step:j3",
    "joint_compliance:j3",
    "backlash:j4",
    "backlash_load:j4",
    "lost_motion:j4",
    "dead_zone:j4",
    "cubic_stiffness:j2",
    "settling:j5",
    "thermal_joint:j1",
    "thermal_growth",
    "warm_up",
    "coupling:j4-j5",
    "parallel_twist:j3",
    "link_torsion:j3",
    "bearing_tilt:j1",
    "pedestal",
    "payload_mass",
    "payload_cog",
    "tool_offset",
    "tool_tilt",
    "target_offset:T2",
    "tool_shift",
    "base_shift",
    "drift_translation",
    "drift_rotation",
    "tracker_scale",
    "outside:joint_field",
    "outside:workspace_field",
    "outside:time_wander",
]
STATE = ArmState((10.0, 50.0, -20.0, 30.0, 40.0, 50.0), (5.0, 45.0, -15.0, 25.0, 35.0, 55.0), (1,) * 6)


def replaced_labels() -> list[tuple[str, str]]:
    """Every departure with a label of each name that it replaces."""
    by_name = {label.split(":")[0]: label for label in LABELS}
    return [(name, by_name[label]) for name, (labels, _) in DEPARTURES.items() for label in labels]


def test_every_law_is_in_the_list() -> None:
    of_slides = {name for name in LAWS if name.startswith("slide_")}  # in test_robot_files.py
    assert {label.split(":")[0] for label in LABELS} == (set(LAWS) - of_slides) | {"outside"}
    assert {label.split(":")[1] for label in LABELS if label.startswith("outside")} == set(OUTSIDE)


# Every label on one robot, its neighbours on the other one; the rest by `make long`
ON_BOTH = [
    pytest.param(robot, label, marks=() if (place + turn) % 2 == 0 else pytest.mark.whole)
    for place, label in enumerate(LABELS)
    for turn, robot in enumerate(("abb-irb120", "ur5"))
]


@pytest.mark.parametrize(("robot", "label"), ON_BOTH)
def test_effect(robot: str, label: str) -> None:
    world = World(robot, seed=7)
    readings = rehearsal(world)
    effect = world.draw_effect(label)
    assert effect.shape == (label.split(":")[1] if label.startswith("outside") else "textbook")
    assert not displacement(world, effect.times(0.0), readings).any()
    assert not any(scaled(world, effect, readings, 0.0).amplitudes.values())

    noise = noise_rms(world, readings)
    for size in (1.0, 4.0):
        large = scaled(world, effect, readings, size)
        assert rms_per_axis(displacement(world, large, readings)) == pytest.approx(size * noise, rel=1e-4)
        assert {k: math.copysign(1.0, v) for k, v in large.amplitudes.items()} == {
            k: math.copysign(1.0, v) for k, v in effect.amplitudes.items()
        }
        assert large.constants == effect.constants

    truth = World(robot, seed=7, effects=[effect]).truth
    assert [t["label"] for t in truth] == [label]
    assert set(truth[0]["parameters"]) == set(effect.values)
    assert all(set(p) == {"value", "unit"} for p in truth[0]["parameters"].values())
    assert truth[0]["group"] == group_of(label)


@pytest.mark.parametrize(("departure", "label"), replaced_labels())
def test_departure_resembles_its_textbook_law(departure: str, label: str) -> None:
    likeness = []
    for seed in range(4):
        # two worlds of one seed draw the same signs and shapes
        textbook = World(seed=seed).draw_effect(label)
        world = World(seed=seed)
        departed = world.draw_effect(label, departure)
        assert departed.shape == departure
        readings = rehearsal(world)
        if departure == "lagged_growth":  # the random lag is drawn before the amplitude's sign
            textbook = textbook.with_values(alpha=departed.amplitudes["alpha"])
        a = displacement(world, textbook, readings).ravel()
        b = displacement(world, departed, readings).ravel()
        likeness.append(float(a @ b / math.sqrt((a @ a) * (b @ b))))
    assert 0.4 < np.mean(likeness) < 0.999


@pytest.mark.parametrize("departure", sorted(DEPARTURES))
def test_a_label_is_drawn_for_every_departure(departure: str) -> None:
    label = random_label(robot_named("abb-irb120"), stream(3, 0), departure)
    world = World(seed=3, effects=[label], departure=departure)
    assert world.truth[0]["shape"] == departure


def test_non_integer_gear_says_so_in_its_label() -> None:
    effect = World().draw_effect("periodic:j2:n100", "non_integer_gear")
    assert effect.label == "periodic:j2:n100.25"
    assert effect.constants["order"] == 100.25


def test_signs_are_random() -> None:
    signs = {World(seed=s).draw_effect("encoder_scale:j4").amplitudes["k"] > 0.0 for s in range(12)}
    assert signs == {True, False}


@pytest.mark.parametrize(
    "label", ["backlash:j4", "backlash_load:j4", "lost_motion:j4", "dead_zone:j4", "settling:j4", "link_torsion:j4",
              "bearing_tilt:j4", "joint_compliance:j4", "pedestal", "thermal_growth"]
)  # fmt: skip
def test_what_physics_forbids_is_not_drawn(label: str) -> None:
    drawn = [World(seed=s).draw_effect(label).amplitudes for s in range(6)]
    assert all(value > 0.0 for amplitudes in drawn for value in amplitudes.values())


@pytest.mark.parametrize("robot", sorted(ROBOTS))
def test_demo_labels_can_all_be_built(robot: str) -> None:
    world = World(robot)
    for labels in demo_labels(world.robot).values():
        for label in labels:
            assert world.draw_effect(label).label == label
    assert {label.split(":")[1] for label in demo_labels(world.robot)["backlash"]} == {
        f"j{k}" for k in range(2, 7)
    }


@pytest.mark.parametrize(
    ("label", "departure", "word"),
    [
        ("rust:j2", None, "rust"),
        ("periodic:j2", None, "needs 2"),
        ("periodic:j2:3", None, "order"),
        ("backlash:j7", None, "j7"),
        ("coupling:j4", None, "not a joint"),
        ("target_offset:T9", None, "T9"),
        ("outside:ghost", None, "ghost"),
        ("pedestal:j1", None, "needs 0"),
        ("backlash:j2", "melting", "melting"),
        ("backlash:j2", "sqrt_drift", "replaces"),
    ],
)
def test_bad_labels_are_refused(label: str, departure: str | None, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        World().draw_effect(label, departure)


def test_an_effect_that_moves_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="moves nothing"):
        World(effects=["joint_compliance:j1"])


def with_effect(label: str, **values: float) -> World:
    """A world with one effect whose values are set by hand."""
    world = World(seed=2)
    world.effects = [world.draw_effect(label).with_values(**values)]
    return world


def joint_turn(world: World, state: ArmState, joint: int) -> float:
    """Angle in deg by which the world's effects turn `joint` (read from the arm's working copy)."""
    return math.degrees(world._arm(state, world.effects).extra_angle[joint - 1])


@pytest.mark.parametrize(
    ("label", "values", "joint", "expected_deg"),
    [
        ("periodic:j2:n3", {"A": 0.02, "B": 0.01}, 2, 0.02 * math.cos(2.6179938780) + 0.01 * 0.5),
        ("encoder_scale:j4", {"k": 1e-3}, 4, 0.03),
        ("joint_offset:j3", {"offset": 0.05}, 3, 0.05),
        ("backlash:j4", {"gap": 0.04}, 4, 0.02),
        ("settling:j3", {"k": 1e-3}, 3, 0.005),
        ("settling:j4", {"k": 1e-3}, 4, -0.005),
        ("coupling:j4-j5", {"k": 1e-3}, 5, 0.03),
    ],
)
def test_law_of_a_joint_angle(label: str, values: dict[str, float], joint: int, expected_deg: float) -> None:
    assert joint_turn(with_effect(label, **values), STATE, joint) == pytest.approx(expected_deg, abs=1e-9)


def test_backlash_changes_sign_with_the_side() -> None:
    world = with_effect("backlash:j4", gap=0.04)
    other = replace(STATE, sides=(1, 1, 1, -1, 1, 1))
    assert joint_turn(world, other, 4) == pytest.approx(-joint_turn(world, STATE, 4))


def test_laws_of_the_instrument() -> None:
    plain = World(seed=2)
    later = replace(STATE, t_s=1800.0)
    true = np.array(plain.true_point(later, "T1"))

    world = with_effect("drift_translation", vx=0.2, vy=0.0, vz=-0.1)
    assert world.true_point(later, "T1") == plain.true_point(later, "T1")
    np.testing.assert_allclose(world.indicated_point(later, "T1") - true, [0.1, 0.0, -0.05], atol=1e-12)

    world = with_effect("tracker_scale", s=10.0)
    np.testing.assert_allclose(
        world.indicated_point(later, "T1") - true, 1e-5 * (true - world.station), atol=1e-12
    )

    world = with_effect("drift_rotation", wx=0.0, wy=0.0, wz=0.002)
    turned = np.cross([0.0, 0.0, math.radians(0.001)], true - world.station)
    np.testing.assert_allclose(world.indicated_point(later, "T1") - true, turned, atol=1e-5)


def test_tool_and_base_move_as_their_laws_say() -> None:
    plain = World(seed=2)
    rotation = plain.flange(STATE)[:3, :3]
    before = np.array(plain.true_point(STATE, "T2"))

    world = with_effect("tool_offset", dx=0.3, dy=-0.2)
    np.testing.assert_allclose(world.true_point(STATE, "T2") - before, rotation @ [0.3, -0.2, 0.0], atol=1e-9)

    world = with_effect("target_offset:T2", dx=0.1, dy=0.2, dz=0.3)
    np.testing.assert_allclose(world.true_point(STATE, "T2") - before, rotation @ [0.1, 0.2, 0.3], atol=1e-9)
    assert world.true_point(STATE, "T1") == plain.true_point(STATE, "T1")

    world = with_effect("base_shift", dx=0.1, dy=0.2, dz=0.3, at_reading=0)
    np.testing.assert_allclose(world.true_point(STATE, "T2") - before, [0.1, 0.2, 0.3], atol=1e-9)


def test_soft_parts_give_way_under_gravity() -> None:
    """A bearing of joint 1 and a pedestal that lean with the moment let the stretched arm sink."""
    stretched = replace(STATE, joints_deg=(0.0, 90.0, -60.0, 0.0, 0.0, 0.0))
    high = World(seed=2).true_point(stretched, "T1")[2]
    for label in ("pedestal", "bearing_tilt:j1", "joint_compliance:j2"):
        low = with_effect(label, c=1e-8).true_point(stretched, "T1")[2]
        assert low < high - 0.05


def test_growth_is_proportional_to_all_lengths() -> None:
    warm = replace(STATE, t_air_c=32.0)
    world = with_effect("thermal_growth", alpha=1e-4)
    arm = world._arm(warm, world.effects)
    np.testing.assert_allclose(arm.geometry.a, 1.001 * np.array(world.geometry.a))
    np.testing.assert_allclose(arm.geometry.d, 1.001 * np.array(world.geometry.d))


def test_effect_refuses_unknown_values() -> None:
    effect: Effect = World().draw_effect("backlash:j2")
    with pytest.raises(ValueError, match="play"):
        effect.with_values(play=1.0)

"""Every label, its group and its law; every departure and the labels it replaces.

| departure | replaces | what differs from the textbook law |
|---|---|---|
| smoothed_dead_zone | dead_zone | edges smoothed over 25 % of the torque's range instead of 5 % |
| gravity_closed_backlash | backlash | the gravity load closes the gap |
| lagged_growth | thermal_growth | the arm follows the air with a first-order lag |
| non_integer_gear | periodic | the order lies a quarter off an integer |
| relaxing_step | tool_shift, base_shift | the step fades exponentially |
| turning_step | tool_shift, base_shift | the step turns as well as shifts |
| sqrt_drift | drift_translation, drift_rotation | like sqrt(t) instead of t |

`outside:joint_field`, `outside:workspace_field` and `outside:time_wander` are no law at all.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mocks.world import frames_and_tool, instrument, outside, slide, structure, thermal, transmission
from mocks.world.draw import Material
from mocks.world.effect import Effect
from mocks.world.robots import Robot

Law = Callable[[Material], Effect]

LAWS: dict[str, tuple[str, Law]] = {
    "periodic": ("transmission", transmission.periodic),
    "encoder_scale": ("transmission", transmission.encoder_scale),
    "joint_offset": ("transmission", transmission.joint_offset),
    "joint_step": ("transmission", transmission.joint_step),
    "joint_compliance": ("transmission", transmission.joint_compliance),
    "backlash": ("transmission", transmission.backlash),
    "backlash_load": ("transmission", transmission.backlash_load),
    "lost_motion": ("transmission", transmission.lost_motion),
    "dead_zone": ("transmission", transmission.dead_zone),
    "cubic_stiffness": ("transmission", transmission.cubic_stiffness),
    "coupling": ("transmission", transmission.coupling),
    "settling": ("procedure", transmission.settling),
    "slide_backlash": ("transmission", slide.slide_backlash),
    "slide_scale": ("transmission", slide.slide_scale),
    "thermal_joint": ("thermal", thermal.thermal_joint),
    "thermal_growth": ("thermal", thermal.thermal_growth),
    "warm_up": ("thermal", thermal.warm_up),
    "parallel_twist": ("structure", structure.parallel_twist),
    "link_torsion": ("structure", structure.link_torsion),
    "bearing_tilt": ("structure", structure.bearing_tilt),
    "pedestal": ("structure", structure.pedestal),
    "payload_mass": ("frames_and_tool", frames_and_tool.payload_mass),
    "payload_cog": ("frames_and_tool", frames_and_tool.payload_cog),
    "tool_offset": ("frames_and_tool", frames_and_tool.tool_offset),
    "tool_tilt": ("frames_and_tool", frames_and_tool.tool_tilt),
    "target_offset": ("frames_and_tool", frames_and_tool.target_offset),
    "tool_shift": ("procedure", frames_and_tool.textbook_step),
    "base_shift": ("procedure", frames_and_tool.textbook_step),
    "drift_translation": ("instrument", instrument.drift_translation),
    "drift_rotation": ("instrument", instrument.drift_rotation),
    "tracker_scale": ("instrument", instrument.tracker_scale),
}
"""Name of the label (what stands before its first colon) -> group, law."""

OUTSIDE: dict[str, Law] = {
    "joint_field": outside.joint_field,
    "workspace_field": outside.workspace_field,
    "time_wander": outside.time_wander,
}
"""Structure outside the library, label outside:NAME, group "outside"."""

DEPARTURES: dict[str, tuple[tuple[str, ...], Law]] = {
    "smoothed_dead_zone": (("dead_zone",), transmission.smoothed_dead_zone),
    "gravity_closed_backlash": (("backlash",), transmission.gravity_closed_backlash),
    "lagged_growth": (("thermal_growth",), thermal.lagged_growth),
    "non_integer_gear": (("periodic",), transmission.non_integer_gear),
    "relaxing_step": (("tool_shift", "base_shift"), frames_and_tool.relaxing_step),
    "turning_step": (("tool_shift", "base_shift"), frames_and_tool.turning_step),
    "sqrt_drift": (("drift_translation", "drift_rotation"), instrument.sqrt_drift),
}
"""Name of the departure -> names of the labels whose textbook law it replaces, law."""

ARGUMENTS = {"periodic": 2, "coupling": 1, "target_offset": 1, "outside": 1} | dict.fromkeys(
    (
        "encoder_scale",
        "joint_offset",
        "joint_step",
        "joint_compliance",
        "backlash",
        "backlash_load",
        "lost_motion",
        "dead_zone",
        "cubic_stiffness",
        "settling",
        "slide_backlash",
        "slide_scale",
        "thermal_joint",
        "parallel_twist",
        "link_torsion",
        "bearing_tilt",
    ),
    1,
)
"""How many parts follow the name in a label; none where not listed."""

STRAIN_WAVE_RATIOS = (50, 51, 80, 81, 100, 101, 120, 121)


def group_of(label: str) -> str:
    """transmission, structure, frames_and_tool, instrument, thermal, procedure or outside."""
    name = label.split(":", maxsplit=1)[0]
    return "outside" if name == "outside" else LAWS[name][0]


def build(material: Material, departure: str | None = None) -> Effect:
    """Build the effect of unit size for a label, or its `departure` from the textbook.

    Raises
    ------
    ValueError
        The label is unknown or incomplete, or the departure does not replace it.
    """
    name = material.label.split(":", maxsplit=1)[0]
    if name != "outside" and name not in LAWS:
        raise ValueError(f"effect {material.label!r}: {name!r} is not one of {sorted([*LAWS, 'outside'])}")
    if len(material.arguments) != ARGUMENTS.get(name, 0):
        raise ValueError(f"effect {material.label!r} needs {ARGUMENTS.get(name, 0)} part(s) after {name!r}")
    if departure is not None:
        if departure not in DEPARTURES:
            raise ValueError(f"departure {departure!r} is not one of {sorted(DEPARTURES)}")
        replaced, law = DEPARTURES[departure]
        if name not in replaced:
            raise ValueError(f"departure {departure!r} replaces {replaced}, not {name!r}")
        return law(material)
    if name == "outside":
        if material.arguments[0] not in OUTSIDE:
            raise ValueError(f"effect {material.label!r}: outside the library are only {sorted(OUTSIDE)}")
        return OUTSIDE[material.arguments[0]](material)
    return LAWS[name][1](material)


def demo_labels(robot: Robot) -> dict[str, list[str]]:
    """Return the effects from which a campaign without instructions draws one, by name.

    They are those that a campaign of random poses shows well. Encoder scale is listed only for joints that turn by
    300 deg or more, backlash for joints 2..6, and gear orders for 1..5 and near the ratios of strain-wave gears.
    """
    turning = [name for name, slides in zip(robot.names, robot.sliding, strict=True) if not slides]
    sliding = [name for name, slides in zip(robot.names, robot.sliding, strict=True) if slides]
    width = {name: high - low for name, (low, high) in zip(robot.names, robot.range_deg, strict=True)}
    orders = (*range(1, 6), *STRAIN_WAVE_RATIOS)
    return {
        "periodic": [f"periodic:{name}:n{h}" for name in turning for h in orders],
        "backlash": [f"backlash:{name}" for name in turning if name != "j1"],
        "encoder_scale": [f"encoder_scale:{name}" for name in turning if width[name] >= 300.0],
        "drift_translation": ["drift_translation"],
        "drift_rotation": ["drift_rotation"],
        "base_shift": ["base_shift"],
        "tool_shift": ["tool_shift"],
        "thermal_growth": ["thermal_growth"],
        **{
            law: [f"{law}:{name}" for name in sliding] for law in ("slide_backlash", "slide_scale") if sliding
        },
    }


def random_label(robot: Robot, rng: np.random.Generator, departure: str | None = None) -> str:
    """Draw one label for the demo: first the name, then the joint, each with equal chance.

    With a `departure`, one of the labels that it replaces.
    """
    choices = demo_labels(robot)
    if departure is not None:
        if departure not in DEPARTURES:
            raise ValueError(f"departure {departure!r} is not one of {sorted(DEPARTURES)}")
        choices |= {"dead_zone": [f"dead_zone:j{k}" for k in (3, 4, 5, 6)]}
        choices = {name: choices[name] for name in DEPARTURES[departure][0]}
    name = list(choices)[int(rng.integers(len(choices)))]
    return choices[name][int(rng.integers(len(choices[name])))]

"""The simulated physical truth: robots, hidden effects, a laser tracker. It imports nothing of TruePose.

`World(robot, seed, effects)` is one real arm under one real tracker; `ArmState` is what is known of one
reading. Effects are named by the labels of the data contract. Their groups (catalogue.LAWS):

transmission      periodic, encoder_scale, joint_offset, joint_step, joint_compliance, backlash, backlash_load,
                  lost_motion, dead_zone, cubic_stiffness, coupling, slide_backlash,
                  slide_scale
structure         parallel_twist, link_torsion, bearing_tilt, pedestal
frames_and_tool   payload_mass, payload_cog, tool_offset, tool_tilt, target_offset
instrument        drift_translation, drift_rotation, tracker_scale
thermal           thermal_joint, thermal_growth, warm_up
procedure         settling, tool_shift, base_shift
outside           outside:joint_field, outside:workspace_field, outside:time_wander (no law of the library)

Departures from the textbook law (catalogue.DEPARTURES): smoothed_dead_zone, gravity_closed_backlash,
lagged_growth, non_integer_gear, relaxing_step, turning_step, sqrt_drift.
"""

from mocks.world.arm import ArmState
from mocks.world.catalogue import DEPARTURES, LAWS, OUTSIDE, demo_labels, group_of, random_label
from mocks.world.draw import Session
from mocks.world.effect import Effect
from mocks.world.noise import TrackerNoise
from mocks.world.robots import ROBOTS, Load, Robot, robot_named
from mocks.world.scaling import displacement, noise_rms, rms_per_axis, scaled
from mocks.world.world import World, stream

__all__ = [
    "DEPARTURES",
    "LAWS",
    "OUTSIDE",
    "ROBOTS",
    "ArmState",
    "Effect",
    "Load",
    "Robot",
    "Session",
    "TrackerNoise",
    "World",
    "demo_labels",
    "displacement",
    "group_of",
    "noise_rms",
    "random_label",
    "rms_per_axis",
    "robot_named",
    "scaled",
    "stream",
]

"""Robot files, kinematics, gravity torques and enclosing capsules of an arm."""

from calib.arm.capsules import Capsule
from calib.arm.hexapod import LEGS, Stances, stances, stances_among
from calib.arm.inverse_kinematics import (
    BRANCHES,
    BranchResult,
    inverse_kinematics,
    nearest_branch,
    nearest_turns,
    within_limits,
)
from calib.arm.kinematics import (
    BasePoses,
    Chain,
    Frames,
    forward,
    gravity_at_flange,
    gravity_torques,
    nominal_values,
    propagate,
)
from calib.arm.robot import (
    FARTHEST_MM,
    HEAVIEST_KG,
    MOST_TURN,
    Load,
    Robot,
    built_in_robots,
    load_robot,
    own_robot_table,
    refuse_slides,
    robot_from,
)
from calib.arm.world_frame import WorldFrame, by_three_two_one, frame_of, of_base_points, with_sides

__all__ = [
    "BRANCHES",
    "FARTHEST_MM",
    "HEAVIEST_KG",
    "LEGS",
    "MOST_TURN",
    "BasePoses",
    "BranchResult",
    "Capsule",
    "Chain",
    "Frames",
    "Load",
    "Robot",
    "Stances",
    "WorldFrame",
    "built_in_robots",
    "by_three_two_one",
    "forward",
    "frame_of",
    "gravity_at_flange",
    "gravity_torques",
    "inverse_kinematics",
    "load_robot",
    "nearest_branch",
    "nearest_turns",
    "nominal_values",
    "of_base_points",
    "own_robot_table",
    "propagate",
    "refuse_slides",
    "robot_from",
    "stances",
    "stances_among",
    "with_sides",
    "within_limits",
]

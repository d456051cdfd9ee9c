"""What a technician should check for each effect: one sentence a kind, with the joint or target it names.

The sentence says where to look first, and how to tell whether the finding is real. It is no work order: what must be
done to a gear or a bearing is in the robot's own manual.
"""

from __future__ import annotations

from calib.diagnose.diagnosis import Found

CHECKS = {
    "periodic": (
        "Look at the gear of joint {of}: eccentric wheel or bearing at a low order, worn teeth or "
        "wave generator at the order of its ratio; a growing amplitude is wear."
    ),
    "gear_curve": (
        "Turn joint {of} slowly over its range without load and listen and feel for a rough place; "
        "look for a cable that pulls at one end of the range."
    ),
    "encoder_scale": (
        "Compare the gear ratio of joint {of} in the controller with the one on its type plate, and "
        "look for a belt of the wrong pitch."
    ),
    "joint_offset": (
        "Bring joint {of} to its calibration mark and read the counter; master the axis anew if it is off."
    ),
    "joint_step": (
        "Bring joint {of} to its calibration mark and read the counter; look for a belt that jumped, a "
        "clamp that slipped, a collision between the two readings."
    ),
    "joint_compliance": (
        "Check the payload that the controller was told and, on joint {of}, the bolts of gear and "
        "motor; hang a known mass on the flange and watch a dial gauge."
    ),
    "backlash": (
        "Check the preload of the gear of joint {of}: with the brakes on, push the arm by hand both "
        "ways and read a dial gauge; compare with the limit in the maker's manual."
    ),
    "lost_motion": (
        "Check the drive of joint {of} for friction and for play between motor and gear (belt, coupling, "
        "key): move it to and fro by a tenth of a degree and watch when a dial gauge follows."
    ),
    "dead_zone": (
        "Check gear and brake of joint {of} for play with the load first on one side of the joint, "
        "then on the other; look at the counterbalance if it has one."
    ),
    "cubic_stiffness": (
        "Check the gear of joint {of} for worn teeth, and that the load is within what it is rated for."
    ),
    "coupling": (
        "Compare the coupling ratio of joints {of} in the controller with the robot's data sheet, and"
        " look for a cable or hose that drags from one joint to the other."
    ),
    "settling": (
        "Let the arm stand longer before each reading and measure a few poses again; if that helps, "
        "look for friction and at the servo settings of joint {of}."
    ),
    "thermal_joint": (
        "Look for what warms the housing of joint {of} (motor, brake, sun), and measure again at a "
        "steady temperature."
    ),
    "thermal_growth": (
        "Steady the air of the cell, or record its temperature and correct for it; keep sun and hot "
        "parts away from the arm."
    ),
    "warm_up": "Let the robot run its warm-up cycle for an hour before it is measured or works.",
    "parallel_twist": (
        "Nothing to repair: the axes at link {of} were machined so; look for a past collision if the "
        "value has changed since the last calibration."
    ),
    "link_torsion": "Check the bolts at both ends of link {of}, and the link for a crack if the value has grown.",
    "bearing_tilt": (
        "Check the main bearing of joint {of} for play across its axis with a dial gauge and a lever,"
        " and its bolts."
    ),
    "pedestal": (
        "Check the anchor bolts and the grout of the pedestal; put a dial gauge beside the foot and "
        "reach out the arm to each side."
    ),
    "payload_mass": (
        "Weigh the tool with everything that hangs on it, and correct the load data in the controller."
    ),
    "payload_cog": (
        "Work out the centre of mass of tool, hoses and cables anew, and correct the load data in the"
        " controller."
    ),
    "tool_offset": "Check how the tool is centred on the flange: pin, collar, burrs; measure its targets anew.",
    "tool_tilt": (
        "Clean the face between flange and tool, tighten its bolts evenly, and measure its targets anew."
    ),
    "target_offset": (
        "Check the seat of target {of} for dirt and looseness, and measure its place on the tool anew."
    ),
    "tool_shift": (
        "Look for what struck or loosened the tool: clamp, bolts, marks on the targets; the readings "
        "before and after belong to two tools."
    ),
    "base_shift": (
        "Look for what moved the robot's foot or the instrument's stand: anchor bolts, tripod feet, "
        "traffic; measure the nests again."
    ),
    "drift_translation": (
        "Check the stand of the instrument: feet, clamp, floor; let it warm up for two hours and "
        "measure the nests between the poses."
    ),
    "drift_rotation": (
        "Check that the instrument's stand does not creep or turn, keep the sun off it, and measure "
        "the nests between the poses."
    ),
    "tracker_scale": (
        "Check the weather station of the instrument (air temperature, pressure) and the date of its "
        "certificate; measure a reference length."
    ),
}
"""By the name of the label, what stands before its colon."""

_UNKNOWN = "Look at what drives this effect in the picture, and measure it again on another day."


def check_of(found: Found) -> str:
    """What a technician should check, as a sentence or two."""
    name, _, rest = found.effect.label.partition(":")
    of = rest.split(":")[0]
    if name == "coupling":
        of = of.replace("j", "").replace("-", " and ")
    elif name != "target_offset":
        of = of.removeprefix("j")
    return CHECKS.get(name, _UNKNOWN).format(of=of)

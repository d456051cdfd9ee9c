"""Effects of the transmission of a turning joint.

Gears, backlash, friction, the encoder, and drives that run through other joints.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace
from functools import partial

import numpy as np

from calib.array import Array
from calib.effects.kind import OTHER_SIDE, EffectKind, EffectModule, Row
from calib.effects.survey import Survey
from calib.model.effect import Effect, Written, effect
from calib.model.regressors import (
    ApproachSide,
    Cosine,
    GearCurve,
    JointAngle,
    LastMove,
    LoadedSide,
    Sine,
    TorqueSign,
)
from calib.scan.families import Candidate, Harmonics
from calib.units import DEG, to_display


def _from_both_sides(survey: Survey) -> list[int]:
    return [k for k in survey.moving if survey.varies(survey.conditions.side[:, k - 1])]


# Source: Nubiola 2.4.1 and 2.5.
backlash = Row(
    EffectKind(
        "backlash",
        words="play of joint {joint}",
        check=(
            "Check the preload of the gear of joint {joint}: with the brakes on, push the arm by hand both "
            "ways and read a dial gauge; compare with the limit in the maker's manual."
        ),
        apart=(OTHER_SIDE,),
        changed="Joint {joint} has another play than at the calibration: {size}.",
        remedy="Have the gear of joint {joint} checked; until then correct targets with the updated model.",
    ),
    law="Backlash: the joint stops half a gap short on the side from which it came, gap/2 x side of approach.",
    means="Joint {joint} has play: it stops short on the side from which it arrives.",
    parameter="gap",
    unit="deg",
    size=0.1,
    slot="theta",
    regressor=ApproachSide,
    where=_from_both_sides,
    weight=0.5,
    bounds=(0.0, 1.0),
)

# The motor's side counts, friction winds up the drive, and what is left of the path to the gap's other flank is never
# made: the opposite of `backlash`. Source: ISO 230-2 (reversal value).
lost_motion = Row(
    EffectKind(
        "lost_motion",
        words="lost motion of joint {joint}",
        check=(
            "Check the drive of joint {joint} for friction and for play between motor and gear (belt, "
            "coupling, key): move it to and fro by a tenth of a degree and watch when a dial gauge follows."
        ),
        apart=(OTHER_SIDE,),
    ),
    law="Lost motion: the joint stops short of its target from either side, -width/2 x side of approach.",
    means="Joint {joint} stops short of where it is sent, from either side.",
    parameter="width",
    unit="deg",
    size=0.1,
    slot="theta",
    regressor=ApproachSide,
    where=_from_both_sides,
    weight=-0.5,
    bounds=(0.0, 1.0),
)

# Where every last move is of one length the column is that of `lost_motion`. The usual size is what four time constants
# leave, exp(-4): Nubiola waits 4 s before every reading (thesis 2.2).
settling = Row(
    EffectKind(
        "settling",
        words="slow settling of joint {joint}",
        check=(
            "Let the arm stand longer before each reading and measure a few poses again; if that helps, "
            "look for friction and at the servo settings of joint {joint}."
        ),
        apart=(OTHER_SIDE,),
    ),
    law="Settling: the reading was taken before the joint had arrived, -k (theta - previous theta).",
    means="Joint {joint} still lags behind its last move when it is measured.",
    parameter="k",
    unit="ppm",
    size=2e4,
    slot="theta",
    regressor=LastMove,
    where=lambda survey: [
        k
        for k in survey.moving
        if survey.varies((survey.conditions.joints - survey.conditions.previous)[:, k - 1])
    ],
    weight=-1.0,
    bounds=(0.0, 2e5),
    group="procedure",
)

# Gear ratios are whole numbers and encoders have whole counts: what
# is left is a belt's pitch, per mille at most. A curve over the angle has the scale already. Source: level-1 models,
# Nubiola ch. 1.
encoder_scale = Row(
    EffectKind(
        "encoder_scale",
        words="gear ratio of joint {joint}",
        check=(
            "Compare the gear ratio of joint {joint} in the controller with the one on its type plate, and "
            "look for a belt of the wrong pitch."
        ),
        apart=(),
    ),
    law="Encoder scale: the joint turns by (1 + k) times the counted angle, k theta.",
    means="Joint {joint} turns by more or less than it counts, in proportion to its angle.",
    parameter="scale",
    unit="ppm",
    size=1000.0,
    slot="theta",
    regressor=JointAngle,
    where=lambda survey: [k for k in survey.moving if k not in survey.curves],
    bounds=(-1500.0, 1500.0),
)


_USUAL_PLAY = 0.1 * DEG  # rad, under the largest torque
_PER_TORQUE = "1e-6 rad/(N.mm)"


# In addition to `backlash`, never negative; torques reach `largest` N.mm. Source: Slamani, Nubiola and Bonev 2012
# (backlash of an IRB 1600 that changes with the load).
backlash_load = Row(
    EffectKind(
        "backlash_load",
        words="play of joint {joint} that grows with its load",
        check=(
            "Load the arm at joint {joint} with a known mass, push it by hand both ways with the brakes on and read a "
            "dial gauge: where the play grows with the mass, look at the gear's housing, its bolts and its bearings."
        ),
        apart=(OTHER_SIDE,),
    ),
    law="Backlash that grows with the load: the housing yields and the teeth part, c/2 x |torque| x side of approach.",
    means="The play of joint {joint} grows with its load: it stops short on the side from which it arrives.",
    parameter="c",
    unit=_PER_TORQUE,
    size=lambda largest: to_display(_USUAL_PLAY / largest, _PER_TORQUE),
    slot="theta",
    regressor=LoadedSide,
    where=lambda survey: [
        k for k in _from_both_sides(survey) if survey.strains(abs(survey.conditions.torque[:, k - 1]))
    ],
    weight=0.5,
    bounds=(0.0, None),
    measure=lambda survey, joint: survey.largest(survey.conditions.torque[:, joint - 1]),
)


_SMOOTHED = 0.05  # share of the largest torque
_LEAST_CHANGE = 0.2  # of the 2 that a full change of side makes


def _smoothed_over(survey: Survey, joint: int) -> float:
    return _SMOOTHED * survey.largest(survey.conditions.torque[:, joint - 1])


def _changes_flank(survey: Survey) -> list[int]:
    """Return the joints whose load comes near zero or changes sides.

    Far from zero the gap is a constant offset.
    """
    loads = {k: survey.conditions.torque[:, k - 1] for k in survey.moving if survey.loaded(k)}
    return [k for k in loads if np.ptp(np.tanh(loads[k] / _smoothed_over(survey, k))) > _LEAST_CHANGE]


# The sign is smoothed, tanh(torque / width), since gears have some drag; width, N.mm, is a constant of the effect, so
# that it predicts the same at other torques.
dead_zone = Row(
    EffectKind(
        "dead_zone",
        words="play of joint {joint} that gravity closes",
        check=(
            "Check gear and brake of joint {joint} for play with the load first on one side of the joint, "
            "then on the other; look at the counterbalance if it has one."
        ),
        apart=(OTHER_SIDE,),
    ),
    law=(
        "Dead zone: the load rests on one flank of the teeth or the other, gap/2 x sign(tau), wherever the joint "
        "came from."
    ),
    means="Joint {joint} has play that gravity closes to the side to which it pulls.",
    parameter="gap",
    unit="deg",
    size=0.1,
    slot="theta",
    regressor=TorqueSign,
    where=_changes_flank,
    weight=0.5,
    bounds=(0.0, 1.0),
    measure=_smoothed_over,
    shape="width_nmm",
)


def coupling(first: int, second: int) -> Effect:
    """Build a turn of joint `second` with joint `first`; parameter k, ppm.

    The drive of the second joint, or its cables, run through the first.
    """
    return effect(
        f"coupling:j{first}-j{second}",
        "transmission",
        "robot",
        f"Joint {second} turns a little when joint {first} does: its drive runs through it.",
        {"k": ("ppm", 1000.0, [(f"theta{second}", JointAngle(first))], (-2e4, 2e4))},
    )


def pairs(joints: int) -> list[tuple[int, int]]:
    """Return the couplings that a robot with `joints` joints may have.

    A joint winds up a drive that it carries for another joint. These are neighbours, if a cable or a belt crosses from
    one link to the next, and joints 4 and 6, since hollow wrists drive joint 6 by a shaft through joints 4 and 5.
    Controllers compensate the ratio of a hollow wrist; only its error remains.
    """
    neighbours = [(k, k + 1) for k in range(1, joints)]
    return [*neighbours, (4, 6)] if joints == 6 else neighbours


def _offer_coupling(survey: Survey) -> list[Candidate]:
    slides = survey.robot.slides
    return [
        Candidate(coupling(a, b))
        for a, b in pairs(survey.robot.joints)
        if a in survey.moving and b not in slides
    ]


_LOWEST, _HIGHEST = (
    0.5,
    330.0,
)  # eccentric wheels, and strain-wave reducers: 50 to 320 cycles per turn, or twice that
# The spacing divides 1, so that every whole order is on the grid; a quarter of what one full turn resolves
_SPACING = 0.25
_USUAL_WAVE_DEG = 0.02  # size of unclaimed waves; a wave that is searched for may have any size


def periodic(joint: int, order: float) -> Effect:
    """Build a periodic error of a joint, A cos(order theta) + B sin(order theta).

    The parameters are cos and sin, deg. The order is in cycles per turn. Each wheel repeats its error once per turn of
    that wheel.
    """
    slot = f"theta{joint}"
    name = f"n{round(order)}" if abs(order - round(order)) < 1e-9 else f"n{order:.2f}"
    return effect(
        f"periodic:j{joint}:{name}",
        "transmission",
        "robot",
        f"The gear of joint {joint} runs ahead and behind {order:g} times a turn.",
        {
            "cos": ("deg", 0.1, [(slot, Cosine(joint, order))], (-1.0, 1.0)),
            "sin": ("deg", 0.1, [(slot, Sine(joint, order))], (-1.0, 1.0)),
        },
        {"order": order},
    )


def long_waves(survey: Survey) -> list[Effect]:
    """Return the waves with one or two cycles per turn for the joints that turned.

    They have usual sizes. Their causes are wheels or encoders out of centre.
    """
    joints = [joint for joint in survey.moving if joint not in survey.curves]
    waves = [periodic(joint, order) for joint in joints for order in (1.0, 2.0)]
    return [
        replace(wave, parameters=tuple(replace(p, size=_USUAL_WAVE_DEG) for p in wave.parameters))
        for wave in waves
    ]


def _offer_periodic(survey: Survey) -> list[Harmonics]:
    """Offer a scan over all orders for each joint that moved.

    Orders that a narrow range confuses share a class. If a curve in the model has the lower whole orders already, the
    orders above them are offered. The orders between them are offered only if the joint turned more than once, since
    its error repeats after a turn.
    """
    everywhere = np.arange(_LOWEST, _HIGHEST + _SPACING / 2, _SPACING)
    beyond = np.arange(HIGHEST + 1.0, _HIGHEST + 0.5)
    scans = []
    for joint in survey.joint_numbers:
        if survey.turns(joint) > 0.0 and joint not in survey.robot.slides:
            slots = ((f"theta{joint}", 1.0),)
            orders = beyond if joint in survey.curves and survey.turns(joint) <= 1.0 else everywhere
            at = partial(periodic, joint)
            scans.append(Harmonics(f"periodic:j{joint}", joint, slots, orders, at, _LOWEST))
    return scans


# --- the error of a gear over a whole turn: a Fourier series of whole orders ---

# Cycles per turn: up to the reducer's ratio, beyond which the waves are few and `periodic` names them
HIGHEST = 100
_MOST = 0.9  # of a curve's mean square


def half_octave(order: float) -> int:
    """Return the half octave of an order: 0 from 1, 1 from 1.41, 2 from 2, and so on."""
    return int(2.0 * math.log2(order) + 1e-9)


BANDS = half_octave(HIGHEST) + 1


def mostly(sizes: Array) -> tuple[int, int]:
    """Return the first and last order that contain most of the curve's square.

    The `sizes` (BANDS,) are those of its half octaves.
    """
    share = np.cumsum([float(sizes[half_octave(n)]) ** 2 for n in range(1, HIGHEST + 1)])
    low, high = np.searchsorted(share / share[-1], ((1.0 - _MOST) / 2.0, (1.0 + _MOST) / 2.0))
    return int(low) + 1, int(high) + 1


def gear_orders(joint: int, sizes: Array, without: Collection[int] = ()) -> Effect:
    """Build the curve of a joint over a turn.

    It is the sum of cosN cos(n theta) + sinN sin(n theta), n from 1 to 100. The orders in `without` are left out.
    Wheels that run eccentrically, teeth, bearings and the motor each add a few orders. Without information from the
    readings the curve stays near zero. Source: MacKay 1992 (sizes by evidence).

    Parameters
    ----------
    sizes : array of shape (BANDS,)
        Usual size of the amplitudes of every half octave, deg. The readings determine it (`calib.diagnose.curves`).
    """
    orders = [n for n in range(1, HIGHEST + 1) if n not in without]
    slot, acts = f"theta{joint}", dict[str, Written]()
    low, high = mostly(sizes)
    for n in orders:
        size = float(sizes[half_octave(n)])
        acts[f"cos{n}"] = ("deg", size, [(slot, Cosine(joint, float(n)))])
        acts[f"sin{n}"] = ("deg", size, [(slot, Sine(joint, float(n)))])
    return effect(
        f"gear_orders:j{joint}",
        "transmission",
        "robot",
        f"Joint {joint}: gear error over a turn, RMS, mostly orders {low} to {high}.",
        acts,
        {"mostly_from": float(low), "mostly_to": float(high)},
    )


def curve_of(joint: int, effect: Effect, values: Array) -> GearCurve:
    """Build the curve of a joint from its gear orders and their values (p,), internal units."""
    amplitudes = np.zeros(HIGHEST + 1, dtype=complex)
    for parameter, value in zip(effect.parameters, values, strict=True):
        kind, order = parameter.short[:3], int(parameter.short[3:])
        amplitudes[order] += value if kind == "cos" else -1j * value
    return GearCurve(joint, tuple(amplitudes.tolist()))


PERIODIC = EffectModule(
    "Periodic error of a joint: A cos(H theta) + B sin(H theta), H cycles a turn.",
    (
        EffectKind(
            "periodic",
            words="gear of joint {joint}, {times} a turn",
            check=(
                "Look at the drive of joint {joint}: in a gear, an eccentric wheel or bearing at a low order, worn "
                "teeth or wave generator at the order of its ratio; without a gear, an encoder out of centre. A "
                "growing amplitude is wear."
            ),
            apart=(),
        ),
    ),
    _offer_periodic,
)
COUPLING = EffectModule(
    "Coupling: joint B turns by k theta_A, because B's drive or its cables run through joint A.",
    (
        EffectKind(
            "coupling",
            words="coupling of joints {joint}",
            check=(
                "Compare the coupling ratio of joints {joint} in the controller with the robot's data sheet, "
                "and look for a cable or hose that drags from one joint to the other."
            ),
            apart=(),
        ),
    ),
    _offer_coupling,
)
GEAR_ORDERS = EffectModule(
    "Gear orders: the error of a joint repeats every turn, so it is a Fourier series of whole orders.",
    (
        EffectKind(
            "gear_orders",
            words="gear of joint {joint}, over a turn",
            check=(
                "Look where the curve of joint {joint} is steep, and measure it again after a year: "
                "a curve that grows is wear, one that has kept can be corrected for."
            ),
            apart=(),
        ),
    ),
    lambda survey: [],
)
"""Found by `calib.diagnose.curves`, not by a scan."""

"""Changes to the mathematics of a moving robot."""

from __future__ import annotations

from tests.sabotage.change import Change

_MOTION = ("tests/calib/test_motion.py",)

CHANGES = (
    Change(
        "calib/motion/solve.py",
        "for parts in (blocks(len(weight)), moves(samples.velocity)):",
        "for parts in (blocks(len(weight)),):",
        "what moves differ by is not in the uncertainty of the clocks",
        _MOTION,
    ),
    Change(
        "calib/motion/streams.py",
        "    return (at >= time[0]) & (at <= time[-1]) & near",
        "    return (at >= time[0]) & (at <= time[-1])",
        "joints are interpolated across a gap",
        _MOTION,
    ),
    Change(
        "calib/motion/solve.py",
        "        moving = np.array([float(np.sum(samples.velocity[part] ** 2)) for part in parts])",
        "        believed = weights(samples.error)[:, None] * samples.velocity**2\n"
        "        moving = np.array([float(np.sum(believed[part])) for part in parts])",
        "a clock that jumps early looks like gross errors",
        _MOTION,
    ),
    Change(
        "calib/motion/solve.py",
        "self._time - clocks.middle, self._time >= clocks",
        "0.0 * self._time, self._time >= clocks",
        "the rate of the clocks stays where the speeds had it",
        _MOTION,
    ),
    Change(
        "calib/motion/solve.py",
        "            changes.append(solved(normal - own, score)[-CLOCKS:])",
        "            changes.append(solved(normal - own, 0.1 * score)[-CLOCKS:])",
        "the clocks are said to be ten times as sure as they are",
        _MOTION,
    ),
    Change(
        "calib/motion/alignment.py",
        "    _refuse_foreign(miss, tracked, moved)\n",
        "",
        "streams of two motions with one rhythm are aligned",
        _MOTION,
    ),
    Change(
        "calib/motion/poses.py",
        "    effective = np.maximum(samples * (1.0 - alike) / (1.0 + alike), 1.0)",
        "    effective = np.ones(len(samples))",
        "the mean of a standstill is as uncertain as one sample",
        _MOTION,
    ),
    Change(
        "calib/motion/alignment.py",
        "lag_ms=-1e3 *",
        "lag_ms=1e3 *",
        "points that come late are said to come early",
        _MOTION,
    ),
    Change(
        "calib/motion/arm.py",
        """        *(ArmTerm(f"theta{k}", _PLAY, f"side{k}") for k in joints),\n""",
        "",
        "play of the gears is taken for an offset of the clocks",
        _MOTION,
    ),
    Change(
        "calib/motion/arm.py",
        """        *(ArmTerm(f"theta{k}", _COMPLIANCE, f"torque{k}") for k in joints[1:]),
        *(ArmTerm(f"theta{k}", _TOOL_BENDS, f"load{k}") for k in joints[1:]),
""",
        "",
        "an arm that bends shifts the clocks",
        _MOTION,
    ),
    Change(
        "calib/motion/solve.py",
        " + np.sum(np.square(held), axis=1)",
        "",
        "what a recording does not show of the arm is not in the clocks' uncertainty",
        _MOTION,
    ),
    Change(
        "calib/motion/clocks.py",
        "        if LEAST_STEP_S < sign * step < gap_s + 2.0 * LEAST_STEP_S:",
        "        if False:",
        "a clock that was set forward is taken for lost samples",
        _MOTION,
    ),
    Change(
        "calib/motion/clocks.py",
        "    if abs(rate) > _FASTEST:",
        "    if False:",
        "windows of a short recording give the clocks any rate",
        _MOTION,
    ),
    Change(
        "calib/motion/alignment.py",
        "        moving=moving.error[known],",
        "        moving=samples.error[known],",
        "a lag that grows with speed is taken for play and hidden",
        _MOTION,
    ),
)

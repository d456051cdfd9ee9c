"""Changes to the watch."""

from __future__ import annotations

from tests.sabotage.change import Change

_WATCH = ("tests/calib/test_watch.py",)
_PLANS = ("tests/calib/test_watch_plans.py",)
_WARMTH = ("tests/calib/test_watch_warmth.py",)
_UPKEEP = ("tests/calib/test_upkeep.py",)

CHANGES = (
    Change(
        "calib/watch/whitened_readings.py",
        "of_parameters @ root_of(covariance), of_frame",
        "0.0 * of_parameters, of_frame",
        "a watch forgets what the calibration left uncertain",
        _WATCH,
    ),
    Change(
        "calib/watch/cause_evidence.py",
        " | self._twins(int(b), residual[mine])",
        "",
        "of two causes that no reading tells apart the simpler is a name",
        _WATCH,
    ),
    Change(
        "calib/watch/cause_evidence.py",
        "        return float(np.exp(low))",
        "        return rate",
        "every question of an alarm has the whole rate of false alarms",
        _WATCH,
    ),
    Change(
        "calib/watch/thermal.py",
        "    estimate[place] += cause.values",
        "    estimate[place] = cause.values",
        "a second change of a joint replaces the first",
        _WATCH,
    ),
    Change(
        "calib/watch/judge.py",
        "float(np.sum(weights**2)) / total**2",
        "float(np.sum(weights**2)) / total",
        "the mean over watches keeps too much noise",
        _WATCH,
    ),
    Change(
        "calib/watch/cause.py",
        "share = float(expit(shifted.evidence - whole.evidence))",
        "share = 0.0",
        "a base that only shifted is turned by noise",
        _WATCH,
    ),
    Change(
        "calib/watch/thermal.py",
        "dtype=np.float64), cause.covariance)",
        "dtype=np.float64), 0.01 * cause.covariance)",
        "an updated model is surer than the readings of the watch",
        _WATCH,
    ),
    Change(
        "calib/watch/planning/choose.py",
        "best if short[best] < (1.0 - _RIDGE) * short[gone] else gone",
        "gone",
        "check poses are not exchanged for the cause that is seen worst",
        _PLANS,
    ),
    Change(
        "calib/watch/planning/rounds.py",
        "            high, best = middle, found",
        "            high = middle",
        "a plan reads as often as it may, not as often as is enough",
        _PLANS,
    ),
    Change(
        "calib/upkeep/chart.py",
        "variance + of_centre, among))",
        "variance, among))",
        "the limits of a chart forget that its centre is uncertain",
        _UPKEEP,
    ),
    Change(
        "calib/upkeep/chart.py",
        "weights**2 @ variance +",
        "np.abs(weights) @ variance +",
        "the mean of a chart keeps all the scatter of its values",
        _UPKEEP,
    ),
    Change(
        "calib/upkeep/due.py",
        "min(interval, step.x - before.x)",
        "interval",
        "checks that come early lengthen the interval",
        _UPKEEP,
    ),
    Change(
        "calib/upkeep/due.py",
        " - 2.0 * float(u)",
        "",
        "the next check is due when the line alone reaches what is permitted",
        _UPKEEP,
    ),
    Change(
        "calib/watch/baseline.py",
        "noise.of_each_joint(model.robot.kinds) ** 2",
        "noise.repeatability**2 * np.ones(len(joints))",
        "the declared scatter of slides is taken for what the model lacks",
        _PLANS,
    ),
    Change(
        "calib/watch/whitened_readings.py",
        "dataset = dataset if frame_known else placed(dataset, model, estimate)",
        "pass",
        "a frame that lies far away is judged by its derivative alone",
        _PLANS,
    ),
    Change(
        "calib/watch/planning/planned.py",
        "self.sides * (-1.0) ** k",
        "self.sides * 1.0",
        "every round of a watch comes from the same sides",
        _PLANS,
    ),
    Change(
        "calib/watch/nests.py",
        "np.sqrt(2.0 * np",
        "np.sqrt(1.0 * np",
        "the limit of the nests forgets that both readings are noisy",
        _PLANS,
    ),
    Change(
        "calib/watch/thermal.py",
        "judge(_beside(seen, columns * prior), rate=rate)",
        "judge(seen, rate=rate)",
        "warmth counts as something else that has changed",
        _WARMTH,
    ),
    Change(
        "calib/watch/thermal.py",
        "        estimate[place] += values",
        "        estimate[place] = values",
        "upkeep replaces what the model knew of its warmth",
        _WARMTH,
    ),
    Change(
        "calib/effects/instrument.py",
        "start_s = float(np.min(survey.conditions.time))",
        "start_s = 0.0",
        "an instrument is taken to drift since the robot was cold",
        _WARMTH,
    ),
    Change(
        "calib/watch/cause_evidence.py",
        "        found = 0.5 * (along**2) @ self.shrink - 0.5 * np.sum(np.log1p(self.strengths**2))",
        "        found = 0.5 * (along**2) @ self.shrink",
        "without the term of Occam a cause with more parameters always wins",
        _WATCH,
    ),
)

"""Changes to the watch between calibrations, and to the next due date."""

from __future__ import annotations

from tests.sabotage.change import Change

_WATCH = ("tests/calib/test_watch.py",)
_UPKEEP = ("tests/calib/test_upkeep.py",)
_MISSED = ("tests/calib/test_missed.py",)

CHANGES = (
    Change(
        "calib/watch/history.py",
        '            if line["data_sha256"] == dataset.sha256:\n                break',
        '            if line["data_sha256"] == dataset.sha256:\n                continue',
        "a watch that is judged again takes the later ones into its mean",
        _WATCH,
    ),
    Change(
        "calib/watch/history.py",
        '    text += "\\n" if text and not text.endswith("\\n") else ""',
        '    text += ""',
        "a line of a history that was cut off spoils the next one",
        _WATCH,
    ),
    Change(
        "calib/watch/whitened_readings.py",
        "np.concatenate([frame.to_world(about) - about, turn])",
        "np.concatenate([frame.to_world(about) - about, 0.5 * turn])",
        "the frame on the nests is as uncertain as another one",
        _WATCH,
    ),
    Change(
        "calib/watch/cause.py",
        "return Size(size, 2.0 * float(np.sqrt(along",
        "return Size(size, 1.0 * float(np.sqrt(along",
        "U of a bumped tool is its standard error",
        _WATCH,
    ),
    Change(
        "calib/watch/whitened_readings.py",
        "(n * rms))[~pointed] ** 2",
        "(n * rms))[pointed] ** 2",
        "U of the error at check poses forgets the noise of a ballbar",
        _MISSED,
    ),
    Change(
        "calib/upkeep/due.py",
        "at @ covariance @ at + between)",
        "at @ covariance @ at)",
        "what values scatter about their line is no reason to check earlier",
        _UPKEEP,
    ),
    Change(
        "calib/upkeep/due.py",
        "    if last > now:",
        "    if not last:",
        "a check of tomorrow is believed",
        _UPKEEP,
    ),
    Change(
        "calib/upkeep/due.py",
        "            if days >= 1.0:",
        "            if days > 0.0:",
        "two readings of the counter in one hour tell the use of a day",
        _UPKEEP,
    ),
    Change(
        "calib/upkeep/due.py",
        "        if days >= self.longest_days:",
        "        if days >= 1e9:",
        "a robot that stands is checked in ten years",
        _UPKEEP,
    ),
)

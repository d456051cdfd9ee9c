"""Benchmark of identification by every package: time ratios, and error at fresh poses.

All packages use the same readings. Base, links and one target off axis 6 are unknown; the truth has DH errors only
("dh"), or axes 2 and 3 are 0.13 deg from parallel as well ("beta"). Ours includes all it does for any data set: a
start, redundancy, robust weights, outliers, covariance. Several campaigns show whether the error is the one that
noise allows.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from calib.fit.identify import identify
from tests.benchmarks.clock import line
from tests.benchmarks.peers import by_hand
from tests.benchmarks.peers.arm import LOWER, UPPER, Arm, Array, Readings, measure, true_arm
from tests.benchmarks.peers.environment import PEERS, Absent, Peer
from tests.benchmarks.peers.ours import GROUPS, dataset_of
from tests.benchmarks.peers.runners.case import Case, timed

TRUTHS, COUNTS = ("dh", "beta"), (50, 1000)
BY_HAND, ACCURACY = 2.0, 1.05
CAMPAIGNS = 40


def case_of(name: str, readings: Readings) -> Case:
    """The case as the other packages take it: the nominal theta belongs to the angle."""
    nominal = Arm()
    return Case(
        name=name,
        joints=readings.joints + nominal.theta,
        measured=readings.measured,
        fresh_joints=readings.fresh_joints + nominal.theta,
        alpha=nominal.alpha,
        a=nominal.a,
        d=nominal.d,
        target=nominal.target_mm,
        lower=LOWER + nominal.theta,
        upper=UPPER + nominal.theta,
    )


def ours(readings: Readings) -> tuple[float, Array]:
    """Seconds of our identification, and its points (500, 3) at the fresh poses."""
    dataset = dataset_of(readings.joints, readings.measured)
    fresh = dataset_of(readings.fresh_joints, readings.fresh_points)
    seconds, found = timed(lambda: lambda: identify(dataset, groups=GROUPS))
    return seconds, found.predict(fresh.conditions)


def at_the_bound(count: int) -> bool:
    """Compare our RMS error at fresh poses with the bound of estimates without bias.

    The RMS is taken over campaigns.
    """
    squares, bounds = [], []
    for seed in range(1, CAMPAIGNS + 1):
        arm = true_arm(seed, twisted=True)
        readings = measure(arm, count, 1000 + seed)
        found = identify(dataset_of(readings.joints, readings.measured), groups=GROUPS)
        fresh = dataset_of(readings.fresh_joints, readings.fresh_points)
        squares.append(readings.rms(found.predict(fresh.conditions)) ** 2)
        bounds.append(by_hand.bound(arm, readings) ** 2)
    rms, floor = np.sqrt(np.mean(squares)), np.sqrt(np.mean(bounds))
    return printed(
        f"error of {CAMPAIGNS} campaigns of {count}: {rms:.4f} mm, bound {floor:.4f} mm",
        f"{rms / floor:.3f} x",
        f"<= {ACCURACY:g}",
        rms <= ACCURACY * floor,
    )


def printed(name: str, value: str, wanted: str, reached: bool) -> bool:
    """Print one row of the table; return whether its limit is met."""
    line(name, value, wanted, reached)
    return reached


def run() -> bool:
    """Print a row for every package, case and solver."""
    reached = True
    campaigns: dict[str, Readings] = {}
    for truth in TRUTHS:
        arm = true_arm(1, twisted=truth == "beta")
        campaigns |= {f"{truth}-{count}": measure(arm, count, 7) for count in COUNTS}
    own: dict[str, float] = {}
    for name, readings in campaigns.items():
        own[name], points = ours(readings)
        seconds, values = timed(lambda: lambda: by_hand.identify(readings))  # noqa: B023
        plain = readings.rms(by_hand.predict(values, readings.fresh_joints))
        error, ratio = readings.rms(points), own[name] / seconds
        reached &= printed(
            f"{name}: {1e3 * own[name]:.1f} ms, by hand {1e3 * seconds:.1f} ms",
            f"{ratio:.2f} x",
            f"<= {BY_HAND:g}",
            ratio <= BY_HAND,
        )
        reached &= printed(
            f"{name}: error {error:.4f} mm, by hand {plain:.4f} mm",
            f"{error / plain:.3f} x",
            f"<= {ACCURACY:g}",
            error <= ACCURACY * plain,
        )
    for count in COUNTS:
        reached &= at_the_bound(count)
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{name}.npz" for name in campaigns]
        for path, (name, readings) in zip(paths, campaigns.items(), strict=True):
            case_of(name, readings).write(path)
        for peer in PEERS:
            reached &= against(peer, paths, campaigns, own)
    return reached


def against(peer: Peer, paths: list[Path], campaigns: dict[str, Readings], own: dict[str, float]) -> bool:
    """A row for every case and solver of one package."""
    try:
        document = peer.answer(f"run_{peer.name}.py", paths, paths[0].with_name(f"{peer.name}.json"))
    except Absent as error:
        return printed(f"{peer.name}: {error}", "absent", f">= {peer.wanted:g}", False)
    print(", ".join(f"{name} {version}" for name, version in document["versions"].items()))
    reached = True
    for answer in document["answers"]:
        name, seconds = answer["case"], answer["seconds"]
        error, ratio = campaigns[name].rms(np.array(answer["points"])), seconds / own[name]
        reached &= printed(
            f"{name}: {peer.name}, {answer['solver']} {seconds:.3f} s, {error:.4f} mm",
            f"{ratio:.0f} x",
            f">= {peer.wanted:g}",
            ratio >= peer.wanted,
        )
    return reached

"""Certified problems: the robot, its measurements, and the parameters to identify."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

IRB_LIMITS = ((-90, 90), (0, 100), (-80, 60), (-150, 150), (-90, 90), (-180, 180))
LR_LIMITS = ((-90, 90), (0, 100), (-110, 60), (-150, 150), (-90, 90), (-180, 180))
UR_LIMITS = ((-180, 180), (-150, -30), (-140, 140), (-180, 180), (-180, 180), (-180, 180))
TRIANGLE = {"T1": (0.0, 0.0, 125.0), "T2": (75.0, 93.675, 215.0), "T3": (150.0, 0.0, 125.0)}
BASES = {
    "B1": (700.0, -600.0, -150.0),
    "B2": (800.0, 550.0, -100.0),
    "B3": (-400.0, 50.0, 900.0),
    "B4": (150.0, -250.0, -350.0),
}
TRACKER = {
    "kind": "tracker",
    "station_mm": [2400.0, -900.0, 350.0],
    "range_mm": 0.01,
    "range_ppm": 2.0,
    "transverse_mm": 0.01,
    "transverse_ppm": 6.0,
    "repeatability_deg": 0.0008,
}


@dataclass(frozen=True)
class Plan:
    """Recipe of one problem.

    `series` maps a name to the measured quantities and the number of readings. `own` is the content of
    [series.NAME] of the header. `by_row` maps a measured quantity to its columns of uncertainty, with the range of
    each draw.
    """

    title: str
    robot: str
    limits: Sequence[tuple[int, int]]
    fit: Sequence[str]
    hold: Sequence[str]
    noise: Mapping[str, Any]
    series: Mapping[str, tuple[str, int]]
    seed: int
    noisy: bool = True
    coupling: str = "none"
    targets: Mapping[str, tuple[float, float, float]] = field(default_factory=lambda: TRIANGLE)
    bases: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    bases_u_mm: float = 0.0
    loads: Sequence[Mapping[str, Any]] = ()
    own: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    by_row: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)

    @property
    def header(self) -> dict[str, Any]:
        """The header of the data set."""
        out: dict[str, Any] = {
            "format": "truepose-dataset/1",
            "robot": self.robot,
            "instrument": "certified problem",
            "world": "nominal",
            "joint_coupling": self.coupling,
            "model": {"fit": list(self.fit), "hold": list(self.hold)},
            "noise": dict(self.noise),
            "tool_targets": {name: list(place) for name, place in self.targets.items()},
        }
        if self.coupling != "none":
            out["beyond_limits"] = True  # the ranges are those of the model's angles
        if self.bases:
            out["base_targets"] = {name: list(place) for name, place in self.bases.items()}
        if self.bases_u_mm:
            out["base_targets_u_mm"] = self.bases_u_mm
        if self.loads:
            out["loads"] = [dict(load) for load in self.loads]
        if self.own:
            out["series"] = {name: dict(values) for name, values in self.own.items()}
        return out


IRB = {"robot": "abb-irb120", "limits": IRB_LIMITS}
THESIS = ("base", "geometry", "compliance")
WITH_BETA = ("base", "geometry", "parallel_twist", "compliance")

PLANS = {
    "irb120_exact": Plan(
        **IRB,
        title="The thesis's 31 parameters less d3 (redundant with d2), points without noise",
        fit=THESIS,
        hold=("d3",),
        noise={"kind": "isotropic", "sigma_mm": 0.05},
        series={"main": ("point", 50)},
        seed=1,
        noisy=False,
    ),
    "irb120_tracker": Plan(
        **IRB,
        title="The same parameters, tracker noise along and across the beam, repeatability of the joints",
        fit=THESIS,
        hold=("d3",),
        noise=TRACKER,
        series={"main": ("point", 50)},
        seed=2,
    ),
    "irb120_twist": Plan(
        **IRB,
        title="Hayati's beta of link 3, uncertainties by row",
        fit=WITH_BETA,
        hold=("d3",),
        noise={"kind": "per-row"},
        series={"main": ("point", 50)},
        seed=3,
        by_row={"point": {f"u_{axis}_mm": (0.01, 0.06) for axis in "xyz"}},
    ),
    "ur10_standard": Plan(
        title="Standard DH: beta of links 2 and 3, alpha and a of link 1; d2 and d3 redundant with d4",
        robot="ur10",
        limits=UR_LIMITS,
        fit=WITH_BETA,
        hold=("d2", "d3"),
        noise={"kind": "isotropic", "sigma_mm": 0.03, "repeatability_deg": 0.001},
        series={"main": ("point", 60)},
        seed=4,
        loads=(
            {"link": 2, "mass_kg": 12.93, "cog_mm": [380.0, 0.0, 158.0]},
            {"link": 3, "mass_kg": 3.87, "cog_mm": [240.0, 0.0, 68.0]},
            {"link": 5, "mass_kg": 3.92, "cog_mm": [0.0, 7.0, 18.0]},
            {"link": 6, "mass_kg": 4.0, "cog_mm": [60.0, -40.0, 90.0]},
        ),
    ),
    "irb120_ballbar": Plan(
        **IRB,
        title="Lengths alone, to four base targets whose places are known",
        fit=THESIS,
        hold=("d3",),
        noise={"kind": "isotropic", "sigma_mm": 0.05, "length_mm": 0.002, "repeatability_deg": 0.0008},
        series={"main": ("length", 60)},
        seed=5,
        bases=BASES,
    ),
    "irb120_free_bases": Plan(
        **IRB,
        title="Lengths alone, to four base targets whose places are free: they say where the robot stands",
        fit=("geometry", "compliance"),
        hold=("d3",),
        noise={"kind": "isotropic", "sigma_mm": 0.05, "length_mm": 0.002},
        series={"main": ("length", 60)},
        seed=6,
        bases=BASES,
        bases_u_mm=5.0,
    ),
    "irb120_poses": Plan(
        **IRB,
        title="Full poses of one target whose frame is free; d6 and theta6 are redundant with it",
        fit=(*WITH_BETA, "tool"),
        hold=("d3", "d6", "theta6"),
        noise={"kind": "isotropic", "sigma_mm": 0.05, "rotation_mrad": 0.2, "repeatability_deg": 0.003},
        series={"main": ("pose", 40)},
        seed=7,
        targets={"T1": (60.0, 20.0, 125.0)},
    ),
    "irb120_mixed": Plan(
        **IRB,
        title="One robot, three set-ups: points by a tracker, poses by a camera, lengths by a bar",
        fit=THESIS,
        hold=("d3",),
        noise={**TRACKER, "rotation_mrad": 0.1, "length_mm": 0.004},
        series={"bar": ("length", 20), "camera": ("pose", 20), "tracker": ("point", 20)},
        seed=8,
        bases=BASES,
        own={"camera": {"tool_targets": {"T1": [0.0, 40.0, 130.0]}}},
        by_row={"length": {"u_length_mm": (0.002, 0.006)}, "pose": {"u_rot_mrad": (0.05, 0.2)}},
    ),
    "irb120_two_nights": Plan(
        **IRB,
        title="Two set-ups by a tracker, each with a base and tool targets of its own, all free",
        fit=(*THESIS, "tool"),
        hold=("d3", "d6", "theta6"),
        noise=TRACKER,
        series={"first": ("point", 30), "second": ("point", 30)},
        seed=10,
        own={"second": {"tool_targets": {"T1": [0.0, 0.0, 124.0], "T4": [-80.0, 60.0, 150.0]}}},
    ),
    "lrmate_coupled": Plan(
        title="Fanuc: joint 3 counted from the horizontal; tool targets free, with which d6 and theta6 are redundant",
        robot="fanuc-lrmate200ic",
        limits=LR_LIMITS,
        fit=(*THESIS, "tool"),
        hold=("d3", "d6", "theta6"),
        noise=TRACKER,
        series={"main": ("point", 60)},
        seed=9,
        coupling="fanuc-j23",
    ),
}

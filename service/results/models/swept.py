"""Sweeps of single joints (`truepose-sweeps/1`): error, reversal, axis and circle."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal, Self

from calib.data import LEVELS, Dataset
from calib.errors import DataError
from calib.fit import identify, silent
from calib.sweeps import AxisDifference, JointSweep, analyse
from calib.units import DEG
from service.results.common import DataShown, Warnings
from service.results.shape import ResponseBody, TableColumn, told


class CircleAxisResponse(ResponseBody):
    """The axis of a circle, compared with that of the identified arm; u is one standard deviation."""

    angle_deg: Annotated[float, told("Between the two directions, deg.", 0.002)]
    u_angle_deg: Annotated[float, told("Its uncertainty by the scatter about the circle, deg.", 0.001)]
    distance_mm: Annotated[float, told("From the centre of the circle to the identified axis, mm.", 0.03)]
    u_distance_mm: Annotated[float, told("Its uncertainty by the scatter about the circle, mm.", 0.003)]

    @classmethod
    def of(cls, axis: AxisDifference) -> Self:
        """Describe the difference of two axes."""
        return cls(
            angle_deg=axis.angle / DEG,
            u_angle_deg=axis.u_angle / DEG,
            distance_mm=axis.distance,
            u_distance_mm=axis.u_distance,
        )


class SweepResponse(ResponseBody):
    """A joint that turned alone; u is one standard deviation. Lists have one value per reading or per place."""

    joint: Annotated[int, told("Number of the joint, from 1.", 5)]
    series: Annotated[str, told("The series of the readings.", "main")]
    target: Annotated[str, told("The target that was measured.", "T1")]
    readings: Annotated[int, told("Number of readings.", 76)]
    from_deg: Annotated[float, told("The smallest commanded angle, deg.", -90.0)]
    to_deg: Annotated[float, told("The largest commanded angle, deg.", 90.0)]
    radius_mm: Annotated[float, told("Radius of the circle, mm.", 296.8)]
    error_range_deg: Annotated[
        float, told("Largest less smallest tangential error of a place, without the reversal, deg.", 0.102)
    ]
    reversal_deg: Annotated[
        float | None,
        told("Upward less downward readings, deg; null if no place was reached in both directions.", -0.03),
    ]
    u_reversal_deg: Annotated[float | None, told("Its uncertainty, deg; null if not known.", 0.0003)]
    radial_rms_mm: Annotated[
        float, told("RMS deviation along the radius of the circle, mm.", 0.005), TableColumn("radius, RMS")
    ]
    radial_largest_mm: Annotated[
        float, told("Largest deviation along the radius of the circle, mm.", 0.014), TableColumn("largest")
    ]
    axial_rms_mm: Annotated[
        float, told("RMS deviation along the axis of the circle, mm.", 0.006), TableColumn("axis, RMS")
    ]
    axial_largest_mm: Annotated[
        float, told("Largest deviation along the axis of the circle, mm.", 0.015), TableColumn("largest")
    ]
    axis: Annotated[
        CircleAxisResponse | None,
        told("Its axis compared with that of the identified arm; null if none was identified.", None),
    ]
    places_deg: Annotated[list[float], told("Commanded angle of each place, deg, ascending.", [-90.0, -85.0])]
    error_deg: Annotated[
        list[float], told("Tangential error of each place without the reversal, deg.", [0.01, 0.02])
    ]
    angle_deg: Annotated[list[float], told("Commanded angle of each reading, deg.", [-90.0, -85.0])]
    tangential_deg: Annotated[list[float], told("Tangential error of each reading, deg.", [0.01, 0.02])]
    radial_mm: Annotated[
        list[float], told("Deviation of each reading along the radius, mm; outwards above 0.", [0.004, 0.001])
    ]
    axial_mm: Annotated[
        list[float],
        told(
            "Deviation of each reading along the axis, mm; its sign by the right-hand rule.", [0.002, 0.001]
        ),
    ]
    upwards: Annotated[list[bool], told("Whether each reading was reached upwards.", [True, False])]

    @classmethod
    def of(cls, sweep: JointSweep) -> Self:
        """Describe a sweep."""
        return cls(
            joint=sweep.joint,
            series=sweep.series,
            target=sweep.target,
            readings=len(sweep.angle),
            from_deg=float(sweep.angle.min()) / DEG,
            to_deg=float(sweep.angle.max()) / DEG,
            radius_mm=sweep.radius,
            error_range_deg=sweep.error_range / DEG,
            reversal_deg=None if sweep.reversal is None else sweep.reversal / DEG,
            u_reversal_deg=None if sweep.u_reversal is None else sweep.u_reversal / DEG,
            radial_rms_mm=sweep.radial_rms,
            radial_largest_mm=sweep.radial_largest,
            axial_rms_mm=sweep.axial_rms,
            axial_largest_mm=sweep.axial_largest,
            axis=None if sweep.axis is None else CircleAxisResponse.of(sweep.axis),
            places_deg=(sweep.places / DEG).tolist(),
            error_deg=(sweep.error / DEG).tolist(),
            angle_deg=(sweep.angle / DEG).tolist(),
            tangential_deg=(sweep.tangential / DEG).tolist(),
            radial_mm=sweep.radial.tolist(),
            axial_mm=sweep.axial.tolist(),
            upwards=sweep.upwards.tolist(),
        )


class SweepsResult(ResponseBody):
    """The sweeps of a data set, by series, joint and target (`truepose-sweeps/1`)."""

    format: Annotated[Literal["truepose-sweeps/1"], told("The format.", "truepose-sweeps/1")]
    data: Annotated[DataShown, told("The readings.", {"readings": 300})]
    sweeps: Annotated[list[SweepResponse], told("Every sweep.", [])]
    warnings: Warnings

    @classmethod
    def of(cls, dataset: Dataset, level: int | None = None, say: Callable[[str], None] = silent) -> Self:
        """Analyse the sweeps of a data set, and compare their axes with those of the identified arm.

        Parameters
        ----------
        level : int, optional
            Level 1 to 3 of the parameters that the identification frees. Default: those that the header frees.
        say : callable, optional
            Called with the name of each step.

        Raises
        ------
        DataError
            There is no sweep.
        """
        found, remarks = analyse(dataset), list[str]()  # refused before the fit, not after it
        try:
            identified = identify(dataset, groups=None if level is None else LEVELS[level], progress=say)
        except DataError as error:
            remarks.append(f"The axes are given alone, since no arm could be identified: {error}")
        else:
            found = analyse(dataset, identified)
        return cls(
            format="truepose-sweeps/1",
            data=DataShown.of(dataset),
            sweeps=[SweepResponse.of(sweep) for sweep in found],
            warnings=remarks,
        )

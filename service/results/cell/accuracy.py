"""Accuracy of an adaptive campaign while it measures, and the outlook of a calibration."""

from __future__ import annotations

from typing import Annotated

from service.results.shape import ResponseBody, told

_RMS = "RMS error of a reading in the zone after the calibration, mm"


class AccuracyLook(ResponseBody):
    """The accuracy after some poses."""

    poses: Annotated[int, told("Number of poses measured.", 20)]
    rms_mm: Annotated[float | None, told(f"{_RMS}; null before the first estimate.", 0.044)]
    bound_mm: Annotated[float | None, told("Its upper limit with 95 % confidence, mm.", 0.049)]


class AccuracyShown(AccuracyLook):
    """The accuracy that the readings so far promise, and how the campaign goes on."""

    deciding_mm: Annotated[
        float | None,
        told(
            "Its upper limit with 95 % confidence in all looks together, mm; below the wanted one it ends.",
            0.05,
        ),
    ] = None
    wanted_mm: Annotated[float, told("The required upper limit, mm.", 0.05)]
    minutes: Annotated[float, told("Time since the beginning to which it refers, min.", 11.5)]
    floor_mm: Annotated[
        float | None, told("Noise and repeatability in one reading, which no calibration lowers, mm.", 0.038)
    ]
    verdict: Annotated[str, told("The verdict of the interim diagnosis; empty before the first.", "complete")]
    reached: Annotated[bool, told("The wanted accuracy is reached.", True)]
    ended: Annotated[
        str, told("Why no further poses follow; empty while they do.", "The accuracy is reached: ...")
    ]
    poses_left: Annotated[int | None, told("Number of poses until it is expected; null: it is not.", 5)]
    minutes_left: Annotated[float | None, told("Time until it is expected, min; null: it is not.", 1.5)]
    history: Annotated[
        list[AccuracyLook],
        told("Every estimate so far, oldest first.", [{"poses": 15, "rms_mm": 0.048, "bound_mm": 0.058}]),
    ]


class OutlookShown(ResponseBody):
    """What a calibration is expected to need and to reach if the model describes the robot."""

    wanted_mm: Annotated[float, told("The required upper limit (95 %) of the RMS error, mm.", 0.1)]
    poses: Annotated[int | None, told("Number of poses; null: it is not expected.", 15)]
    most: Annotated[int, told("Largest number of poses.", 100)]
    targets: Annotated[int, told("Number of readings in each pose.", 3)]
    warm_up_minutes: Annotated[float, told("Until a warm arm is seen to be steady, min.", 6.0)]
    measuring_minutes: Annotated[float, told("Measuring, min.", 5.0)]
    verification_minutes: Annotated[float, told("Verifying the correction, min.", 6.0)]
    minutes: Annotated[float, told("All of these, min.", 17.0)]
    limit_mm: Annotated[float, told("The limit that is expected, mm.", 0.051)]
    floor_mm: Annotated[float, told("Noise and repeatability in one reading, mm.", 0.038)]
    mountings: Annotated[
        int, told("Number of times that a person puts a ballbar between two balls; 0 without one.", 0)
    ] = 0

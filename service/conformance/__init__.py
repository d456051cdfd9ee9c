"""Conformance suite: the promises of every driver, tested on its simulator.

They are tested with and without faults on the wire. A package of drivers names its benches under the entry
point group `truepose.benches`: a module with `BENCHES`, a tuple of `RobotBench` and `InstrumentBench`.
`truepose conformance NAME` tries the driver NAME and states which promises hold.
"""

from __future__ import annotations

from service.conformance.bench import (
    InstrumentBench,
    RobotBench,
    SimulatedInstrument,
    SimulatedRobot,
    StepsClock,
)
from service.conformance.common import SLACK_S, DriverRig, RequirementFailed
from service.conformance.suite import PromiseResult, Requirement, bench_of, promises_of, tried, tried_once

__all__ = [
    "SLACK_S",
    "DriverRig",
    "InstrumentBench",
    "PromiseResult",
    "Requirement",
    "RequirementFailed",
    "RobotBench",
    "SimulatedInstrument",
    "SimulatedRobot",
    "StepsClock",
    "bench_of",
    "promises_of",
    "tried",
    "tried_once",
]

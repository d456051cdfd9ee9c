"""Bench on which the conformance suite tests the driver."""

from acme.arm import AcmeDeadlines
from acme.simulator import simulated
from service.conformance import RobotBench

# For answers that the suite drops on purpose
HASTY = AcmeDeadlines(connect_s=3.0, reply_s=0.3, margin_s=0.3)
BENCHES = (
    RobotBench(
        driver="acme",
        simulate=simulated,
        end=b"\n",
        tolerance_deg=0.002,
        patient=AcmeDeadlines(reply_s=30.0, margin_s=30.0),
        hasty=HASTY,
        longest_s=2.0,
    ),
)

"""Settings for every test: Hypothesis draws the same examples in every run and has no clock.

The machines that run these tests are shared, so a deadline would only measure the neighbours. A failing example
is printed with the line that reproduces it. The profile `fuzz` draws 100,000 new ones for each test: `make fuzz`.
"""

from __future__ import annotations

from hypothesis import HealthCheck, settings

settings.register_profile(
    "truepose",
    deadline=None,
    derandomize=True,
    database=None,
    print_blob=True,
    max_examples=50,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile(
    "fuzz",
    settings.get_profile("truepose"),
    derandomize=False,
    max_examples=100_000,
    suppress_health_check=list(HealthCheck),
)
settings.load_profile("truepose")

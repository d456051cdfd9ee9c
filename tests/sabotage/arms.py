"""Changes to the built-in arms, and to the code that distinguishes them."""

from __future__ import annotations

from tests.sabotage.change import Change

_TABLES = ("tests/calib/test_published_arms.py",)

CHANGES = (
    Change(
        "calib/arm/robots/kuka-kr6-r900.toml",
        "d_mm = 420.0",
        "d_mm = 402.0",
        "two digits in a table of an arm in the box are swapped",
        _TABLES,
    ),
    Change(
        "calib/arm/robots/yaskawa-gp7.toml",
        "alpha_deg = 180.0\na_mm = 0.0",
        "alpha_deg = 0.0\na_mm = 0.0",
        "the flange of an arm in the box looks inwards",
        _TABLES,
    ),
    Change(
        "calib/data/hypotheses.py",
        "            if other.least_mm <= miss\n",
        "",
        "another arm in the box is suspected of what the right one misses by",
        ("tests/calib/test_hypotheses.py::test_no_other_arm_is_suspected_of_what_the_right_one_misses_by",),
    ),
    Change(
        "drivers/ur/secondary.py",
        "_TWICE and software >= E_SERIES",
        "_TWICE and software >= (6,)",
        "an arm in the box of the e-Series passes for one of the CB series",
        ("tests/drivers/test_ur.py::test_the_software_tells_the_series_of_the_arm",),
    ),
)

"""A data set for a level of calibration: which parameters are freed, and which are held because no reading shows
them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from calib.data.dataset import Dataset
from calib.fit.identify import last_joint_unseen
from calib.fit.placing import base_model_of
from calib.model import base_model

PLACE = ("base",)
"""What is freed of the nominal robot in its place."""
_BESIDE = ("tool", "length_zero")  # not a matter of levels: the header frees them or not


def freeing(dataset: Dataset, groups: Sequence[str]) -> Dataset:
    """The data set with the header's groups replaced; an unknown tool or zero of lengths stays free.

    What the header holds or weighs of other groups is left out. Where all targets lie on the axis of the last joint,
    its zero is held: a reflector straight below the flange is a usual set-up, and nothing moves it then.
    """
    header = dataset.header
    groups = (*groups, *(g for g in _BESIDE if g in header.groups))
    header = replace(header, groups=groups, hold=(), priors={})
    model = base_model_of(replace(dataset, header=header))
    last = f"theta{header.robot.joints}"
    unseen = "tool" not in groups and last_joint_unseen(dataset)
    hold = (*dataset.header.hold, last) if unseen else dataset.header.hold
    kinds = base_model.kinds_of(model.effects)
    priors = {name: size for name, size in dataset.header.priors.items() if name in kinds | set(model.index)}
    held = tuple(dict.fromkeys(name for name in hold if name in model.index))
    return replace(dataset, header=replace(header, hold=held, priors=priors))

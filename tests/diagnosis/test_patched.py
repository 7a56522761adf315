"""A lookup is handed out only if it predicts held-out recordings better."""

import numpy as np
import pytest

from twin.diagnosis.answer import Patched
from twin.rigs.patch import Patch

NOTHING = np.zeros(0)


@pytest.mark.parametrize(
    ("errors", "worse"),
    [
        ({"a.csv": {"hub_angle": (2.0, 1.0), "strain_base": (1.0, 1.5)}}, False),
        ({"a.csv": {"hub_angle": (1.0, 4.0), "strain_base": (1.0, 0.5)}}, True),
        ({"a.csv": {"hub_angle": (1.0, 1.0)}}, False),
        ({"a.csv": {"hub_angle": (1.0, float("nan"))}}, True),
        ({}, False),
    ],
)
def test_a_lookup_that_makes_held_out_errors_larger_is_worse(errors, worse):
    patch = Patch("hub_torque", "hub_rate", NOTHING, NOTHING, NOTHING)
    assert Patched(patch, "N*m", errors).is_worse is worse

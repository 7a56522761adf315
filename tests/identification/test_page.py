"""The page of an identification: no figure of a single dot, parameters beside their declared values, its caveat."""

from types import SimpleNamespace

import pytest

from twin.identification import page, pictures
from twin.identification.estimates import Estimate, Identified
from twin.identification.held_out import HeldOutError
from twin.identification.text import format_estimate

LENGTH = Identified(0.421, 0.0002, "m", 0.42, 0.001)
MASS = Identified(0.155, 0.0002, "kg", 0.155, 0.001)
EVENT = SimpleNamespace(direction=1, angle=0.1, torque=0.06)


def test_a_single_break_away_is_no_figure():
    def figures(count: int):
        friction = SimpleNamespace(
            level=Estimate(0.06, 0.001), events=[EVENT] * count, errors=[0.001] * count
        )
        return page.FIGURES["break-away"](SimpleNamespace(static_friction=friction))

    assert [len(figures(count)) for count in (1, 2)] == [0, 1]


def test_parameters_are_drawn_in_declared_standard_deviations():
    assert pictures.moves({"length": LENGTH}) is None
    [points] = pictures.moves({"length": LENGTH, "tip_mass": MASS}).data
    assert points.x == pytest.approx((1.0, 0.0))
    assert points.y == ("length", "tip mass")
    assert points.error_x.array[0] == pytest.approx(1.96 * 0.2)


def test_caveat_names_what_was_not_predicted_before_what_was_not_determined():
    missed = HeldOutError("slew.csv", "hub_angle", "rad", 3e-4, 0.4, 0.38, 0.1, 0.1, None)
    near = HeldOutError("slew.csv", "strain_base", "1", 2e-6, 3e-6, 2e-6, 2e-6, 2e-6, 2e-6)
    result = SimpleNamespace(
        all_parameters={"length": LENGTH, "tip_mass": MASS},
        not_determined={"tip_mass": "..."},
        held_out=(near, missed),
    )
    assert "the hub angle of slew.csv is off by 22°, and its sensor's noise is 0.017°" in page._caveat(result)
    result.held_out = (near,)
    assert page._caveat(result) == "They do not determine tip mass."
    far = Identified(0.43, 0.0002, "m", 0.42, 0.001)
    result.all_parameters["length"] = far
    assert page._caveat(result).startswith("Length moved by more than two declared standard deviations")


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.0676576, 1.5e-5, "0.067658 (0.067628 to 0.067687)"),
        (1.2465482, 3e-6, "1.24655 (1.24654 to 1.24655)"),
        (1.2465482, 3e-8, "1.2465482 (1.24654814 to 1.24654826)"),
        (0.25, 0.01, "0.25 (0.2304 to 0.2696)"),
    ],
)
def test_intervals_have_six_digits_at_most_unless_they_are_narrower(value, error, text):
    assert format_estimate(Estimate(value, error)) == text

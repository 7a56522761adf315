"""Numbers as people write them."""

import pytest

from twin.errors import InputError
from twin.proposal.quantity import quantity


@pytest.mark.parametrize(
    ("text", "unit", "value", "uncertainty"),
    [
        ("0.4", "m", 0.4, None),
        ("0,42", "m", 0.42, None),
        ("42 cm ± 0.2 %", "m", 0.42, 0.002),
        ("42cm", "m", 0.42, None),
        ("128 g/m +- 8%", "kg/m", 0.128, 0.08),
        ("4.4e-3 ± 1.1e-3", "kg*m^2", 4.4e-3, 0.25),
        ("7.7 mN*m/A", "N*m/A", 7.7e-3, None),
        ("345 ± 2 mm", "m", 0.345, 2 / 345),
        ("0.3 m +/- 3 mm", "m", 0.3, 0.01),
        ("0.576 1/m", "1/m", 0.576, None),
        ("-2", "1", -2.0, None),
    ],
)
def test_a_quantity_may_have_unit_and_uncertainty(text, unit, value, uncertainty):
    found = quantity(text)
    assert found.to(unit) == pytest.approx(value)
    assert found.uncertainty == (uncertainty if uncertainty is None else pytest.approx(uncertainty))


@pytest.mark.parametrize("text", ["?", "about 3", "", "±3", "1 ± x"])
def test_anything_else_is_no_number(text):
    with pytest.raises(InputError, match="is no number"):
        quantity(text)


def test_a_quantity_of_another_kind_is_refused():
    with pytest.raises(InputError, match="cannot be converted"):
        quantity("3 kg").to("m")

"""Rigs that cannot be simulated, and gauges that are not on the link, are refused by name."""

import pytest

from twin.control import plants
from twin.errors import InputError
from twin.parameters import Parameter, Rig, rig_parameter
from twin.recording import GAUGES, Sensor
from twin.rigs import preset
from twin.rigs.check import check_gauges, check_parameters

RIG = preset("bossi2009")


@pytest.mark.parametrize("values", [{"bending_stiffness": 1e6}, {"linear_density": 1e-6, "length": 0.05}])
def test_a_link_too_fast_to_simulate_is_refused(values):
    with pytest.raises(InputError, match="vibrates too fast.*expected at least 1e-06 s"):
        check_parameters(RIG.replace(**values))


def test_a_stiff_short_link_is_accepted():
    check_parameters(RIG.replace(length=0.1, bending_stiffness=10.0))


def test_the_estimate_is_within_a_factor_of_ten_of_the_chain():
    model = plants.make_model(RIG.replace(bending_stiffness=100.0))
    estimate = 2.6 / (400 * (100.0 / RIG["linear_density"]) ** 0.5 / RIG["length"] ** 2)
    assert 0.1 < estimate / model.stable_step < 10


def test_a_rig_that_lacks_a_parameter_is_refused():
    with pytest.raises(InputError, match="has no bending_stiffness"):
        check_parameters(Rig("short", {"length": rig_parameter("length", 0.4, None, "weighed")}))


def test_a_gauge_beyond_the_link_is_refused():
    with pytest.raises(InputError, match="strain_mid is 0.21 m from the hub axis; expected 0 to 0.15 m"):
        check_gauges(RIG.replace(length=0.15), GAUGES)
    check_gauges(RIG, GAUGES)


def test_a_gauge_at_the_end_of_a_link_that_a_fit_has_shortened_is_read():
    model = plants.make_model(RIG)
    end = Sensor("strain_base", position=RIG["length"], half_thickness=1e-3)
    shorter = model.replace(declared=RIG.replace(length=0.999 * RIG["length"]), sensors={"strain_base": end})
    check_gauges(shorter.rig, shorter.sensors.values())
    assert abs(shorter.gauge_rows["strain_base"]).max() > 0


@pytest.mark.parametrize(
    ("name", "value"),
    [("length", 700.0), ("length", -1.0), ("damping_ratio", 3.4), ("tip_mass", float("nan"))],
)
def test_a_parameter_no_rig_can_have_is_refused_however_it_is_made(name, value):
    for make in (
        lambda: Parameter(name, value, "1"),
        lambda: rig_parameter(name, value, None, "guessed"),
        lambda: RIG.replace(**{name: value}),
    ):
        with pytest.raises(InputError, match=f"{name} is "):
            make()


def test_a_misspelt_parameter_is_named():
    with pytest.raises(InputError, match="'lenght' is not a parameter of bossi2009; did you mean 'length'"):
        RIG.replace(lenght=0.4)

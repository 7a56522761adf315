import pickle
import time
import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from paths import PUBLISHED

from twin.errors import InputError
from twin.mechanics.beam import modes
from twin.parameters import Parameter
from twin.rigs import PRESETS, bossi2009, preset
from twin.rigs.match_modes import reconcile

BOSSI = tomllib.loads((PUBLISHED / "bossi2009.toml").read_text())


def test_printed_preset_is_table_2():
    table = BOSSI["table_2"]
    assert dict(preset("bossi2009-printed")) == {
        "bending_stiffness": table["E"] * table["I"],
        "linear_density": table["rho"],
        "length": table["l"],
        "hub_inertia": table["J0"],
        "tip_mass": table["mp"],
        "tip_inertia": table["Jp"],
        "damping_ratio": table["zeta"],
        "static_friction": table["tau_s"],
        "coulomb_friction": table["tau_c"],
        "torque_limit": table["tau_max"],
    }


@pytest.mark.parametrize("name", PRESETS)
def test_every_number_has_unit_bounds_and_source(name):
    rig = preset(name)
    assert rig.name == name
    for key, parameter in rig.parameters.items():
        assert parameter.name == key
        assert parameter.unit
        assert parameter.bounds[0] <= parameter.value <= parameter.bounds[1]
        assert "Table II" in parameter.source


@pytest.mark.parametrize("name", ["hub_inertia", "tip_inertia"])
def test_solved_inertias_have_the_published_digits(name):
    assert f"{preset('bossi2009')[name]:.10e}".startswith(BOSSI["reconciled"][name].split("e")[0])
    assert preset("bossi2009")[name] == pytest.approx(float(BOSSI["reconciled"][name]), rel=4e-5)


def test_only_the_two_computed_values_move():
    printed, solved = preset("bossi2009-printed"), preset("bossi2009")
    assert {name for name in printed if printed[name] != solved[name]} == {"hub_inertia", "tip_inertia"}
    moved = bossi2009.reconciliation().moved
    assert moved == {name: (printed[name], solved[name]) for name in ("hub_inertia", "tip_inertia")}


def test_moved_values_say_what_the_table_prints():
    rig = preset("bossi2009")
    assert "solved" in rig.parameters["hub_inertia"].source
    assert "prints 0.0016" in rig.parameters["hub_inertia"].source
    assert "prints 1.73e-05" in rig.parameters["tip_inertia"].source


def test_reconciled_frequencies_are_met_to_rounding():
    hz = modes(preset("bossi2009"), 2).frequencies / (2 * np.pi)
    np.testing.assert_allclose(hz, bossi2009.FREQUENCIES_HZ, rtol=1e-10)
    assert np.all(np.abs(bossi2009.reconciliation().residual) < 1e-10)


def test_reconciling_is_quick():
    start = time.perf_counter()
    reconcile(preset("bossi2009-printed"))
    assert time.perf_counter() - start < 0.5  # 12 ms on a quiet machine


@pytest.mark.parametrize("boundary", ["free", "clamped"])
@pytest.mark.parametrize(
    "move", [("tip_mass",), ("tip_mass", "bending_stiffness"), ("tip_inertia", "tip_mass")]
)
def test_reconciling_recovers_the_truth(move, boundary):
    truth = preset("bossi2009")
    hz = modes(truth, 2, boundary).frequencies / (2 * np.pi)
    start = truth.replace(**{name: 1.3 * truth[name] for name in move})
    found = reconcile(start, hz, move, boundary)
    for name in move:
        assert found.moved[name] == (start[name], pytest.approx(truth[name], rel=1e-8))
        assert found.rig[name] == found.moved[name][1]
        assert boundary in found.rig.parameters[name].source
    np.testing.assert_allclose(found.residual, 0, atol=1e-10)


def test_frequencies_out_of_reach_leave_a_residual():
    # The payload's inertia alone cannot give both: the printed hub is twice too heavy.
    found = reconcile(preset("bossi2009-printed"), move=("tip_inertia",))
    assert np.max(np.abs(found.residual)) > 0.05
    assert "frequencies met to 0." in str(found)


def test_reconciliation_prints_what_moved():
    text = str(bossi2009.reconciliation())
    assert text.startswith("hub_inertia 0.0016 -> 0.0006997, tip_inertia 1.73e-05 -> 0.00013817; ")


def test_more_unknowns_than_frequencies_are_refused():
    with pytest.raises(ValueError, match="2 parameters to move for 1 frequencies"):
        reconcile(preset("bossi2009-printed"), (7.27,))


def test_a_value_of_zero_cannot_be_moved():
    rig = preset("bossi2009-printed").replace(tip_inertia=0.0)
    with pytest.raises(ValueError, match="tip_inertia is 0; expected a positive number"):
        reconcile(rig)


def test_unknown_preset_names_the_known_ones():
    with pytest.raises(InputError, match="expected one of: bossi2009, bossi2009-printed; did you mean"):
        preset("bosi2009")


def test_unknown_parameter_names_the_nearest():
    with pytest.raises(KeyError, match="'tip_mas' is not a parameter of bossi2009; did you mean 'tip_mass'"):
        preset("bossi2009")["tip_mas"]


def test_rigs_survive_pickling():
    rig = preset("bossi2009")
    assert pickle.loads(pickle.dumps(rig)) == rig


def test_replaced_value_keeps_unit_and_names_its_source():
    rig = preset("bossi2009").replace(source="weighed", tip_mass=0.2)
    assert rig.parameters["tip_mass"] == Parameter("tip_mass", 0.2, "kg", 0.01, (0.0, 1e3), "weighed")
    assert preset("bossi2009")["tip_mass"] == 0.155


@given(data=st.data())
def test_replaced_values_are_the_same_in_every_order(data):
    rig = preset("bossi2009")
    within = {name: st.floats(*p.bounds) for name, p in rig.parameters.items() if np.isfinite(p.bounds).all()}
    values = data.draw(st.fixed_dictionaries({}, optional=within))
    one_by_one = rig
    for name in data.draw(st.permutations(sorted(values))):
        one_by_one = one_by_one.replace(source="measured", **{name: values[name]})
    assert one_by_one == rig.replace(source="measured", **values)
    assert dict(one_by_one) == {**rig, **values}


def test_impossible_value_is_refused():
    with pytest.raises(ValueError, match="tip_mass is -1 kg; expected 0 to 1000"):
        preset("bossi2009").replace(tip_mass=-1.0)
    with pytest.raises(ValueError, match="uncertainty of tip_mass is -0.1; expected a number >= 0"):
        Parameter("tip_mass", 0.2, "kg", -0.1)

"""Declared parameters that the recordings contradict, and effects whose size is not told."""

from types import SimpleNamespace

import numpy as np
import pytest
from rig_campaigns import planned

from twin.diagnosis import declarations, revise, rules
from twin.diagnosis.conclude import effect_probabilities
from twin.diagnosis.diagnose import search
from twin.diagnosis.rules import CONTRADICTED, SIZE_DETERMINED, Declaration, Standing
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.unknowns import Unknown, effect_unknowns


@pytest.mark.parametrize(
    ("deviations", "rate", "found"), [(3.1, 0.01, True), (2.7, 0.01, False), (2.7, 0.05, True)]
)
def test_a_declaration_is_contradicted_at_the_rate_that_is_asked_for(deviations, rate, found):
    assert CONTRADICTED.judge(Declaration(deviations, rate, 2)).passed is found


def test_the_probability_of_a_contradiction_is_that_of_its_own_test():
    assert rules.p_value_of(Declaration(1.96, 0.01, 1)) == pytest.approx(0.05, rel=1e-3)
    assert rules.p_value_of(Declaration(1.96, 0.01, 4)) == pytest.approx(0.2, rel=1e-3)
    assert rules.p_value_of(Declaration(0.1, 0.01, 4)) == 1.0


def fit(name, values, errors, correlation=0.0):
    unknowns = effect_unknowns(name, values, {"strain_base", "strain_mid", "hub_angle"})
    errors = np.array([errors[u.name] for u in unknowns])
    covariance = np.diag(errors**2)
    covariance[0, 1] = covariance[1, 0] = correlation * errors[0] * errors[1]
    model = SimpleNamespace(effects={name: values}, declared={})
    at = np.array([u.turned(values[u.name]) for u in unknowns])
    return SimpleNamespace(unknowns=unknowns, values=at, errors=errors, covariance=covariance, model=model)


def told(size):
    return SIZE_DETERMINED.judge(Standing(size=size)).passed


def test_what_a_gauge_reads_of_a_mode_is_not_its_size():
    values = {
        "frequency": 18.4,
        "damping_ratio": 0.07,
        "inertia_share": 1e-4,
        "strain_base": 0.0,
        "strain_mid": 1e-5,
    }
    errors = {
        "frequency": 0.1,
        "damping_ratio": 0.03,
        "inertia_share": 5e-5,
        "strain_base": 1e-6,
        "strain_mid": 1e-6,
    }
    assert not told(revise.size_in_errors(fit("torsional-mode", values, errors), "torsional-mode"))
    clear = {**values, "inertia_share": 0.1}
    assert told(revise.size_in_errors(fit("torsional-mode", clear, errors), "torsional-mode"))
    # The largest damping that a fit may give to a mode, which hardly oscillates then.
    assert not told(
        revise.size_in_errors(
            fit("torsional-mode", {**clear, "damping_ratio": 0.4}, errors), "torsional-mode"
        )
    )


def test_a_cable_is_told_by_stiffness_and_rest_angle_together():
    values = {"stiffness": 0.01, "rest_angle": 0.3}
    # Its torque at zero, stiffness times rest angle, is known ten times as well as either.
    errors = {"stiffness": 0.01, "rest_angle": 0.3}
    assert told(revise.size_in_errors(fit("cable-torsion", values, errors, -0.99), "cable-torsion"))
    assert not told(revise.size_in_errors(fit("cable-torsion", values, errors), "cable-torsion"))


def contradicted(gain, declared, error=1e-3):
    """Deviations of the gain of a gauge, fitted without its prior, whose fit with the prior ended at its bound."""
    bound = float(np.exp(3 * declared))
    u = Unknown("gain", "strain_base", 1.0, declared, True, (1 / bound, bound))
    model = SimpleNamespace(effects={}, declared={})
    best = SimpleNamespace(unknowns=(u,), values=np.array([min(gain, bound)]), model=model)
    values = {"gain_base": gain, "gain_mid": 1.2}
    fitted = fit("strain-gain", values, dict.fromkeys(values, error))
    return declarations._channel_deviations(best, SimpleNamespace(name="strain-gain", fit=fitted))


def test_a_gain_is_measured_in_the_deviations_that_are_declared():
    # The other gain of the effect is off by 200 of its errors, but nothing is declared of it.
    assert contradicted(1.08, 0.02) == pytest.approx(0.08 / np.hypot(0.02, 1e-3))
    assert CONTRADICTED.judge(Declaration(contradicted(1.08, 0.02), 0.01, 2)).passed
    assert not CONTRADICTED.judge(Declaration(contradicted(1.05, 0.02), 0.01, 2)).passed
    assert contradicted(1.03, 0.02) == 0.0


def test_only_effects_that_are_an_error_of_an_uncertain_channel_are_tested():
    u = Unknown("gain", "strain_base", 1.0, 0.02, True, (0.94, 1.06))
    best = SimpleNamespace(unknowns=(u,), values=np.array([1.05]), model=SimpleNamespace(effects={}))
    assert declarations._channel_parameters(best, "strain-gain") == {"gain_base"}
    assert declarations._channel_parameters(best, "hub-sensor-gain") == set()
    best.model.effects = {"strain-gain": {}}
    assert declarations._channel_parameters(best, "strain-gain") == set()


def test_a_gain_that_no_channel_measures_shows_in_all_that_is_declared_of_the_rig(rig_campaign):
    # All masses, stiffnesses and frictions seem 3 % smaller: three standard deviations of the payload and of the link.
    files = rig_campaign(
        {"torque-gain": {"gain": 1.03}},
        3,
        experiments=planned(3, "torque-sweep", "random-steps"),
        motor_torque=False,
    )
    with ResidualPool(1) as pool:
        found = search(files.read(), pool)
    (adopted,) = found.adopted
    assert adopted.name == "torque-gain"
    assert adopted.fit.model.effects["torque-gain"]["gain"] == pytest.approx(1.03, abs=0.015)
    # A payload alone that is 3 % lighter is nearly as likely, and nothing that no declaration speaks of.
    [alike] = rules.alternatives([r.ranked for r in found.adopting])
    assert set(alike) == {"torque-gain", "payload-mass"}
    assert effect_probabilities(found, "explained")["torque-gain"] > 0.9

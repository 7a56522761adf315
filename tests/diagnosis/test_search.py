"""The loop on campaigns of the virtual rig: what is planted is named and recovered, nothing where nothing is."""

import json
from dataclasses import replace

import numpy as np
import pytest
from planted import PLANTED
from rig_campaigns import planned, planned_fit

from twin.campaigns.campaign import Campaign
from twin.diagnosis import candidates, contest, dependence, revise, rules, spectrum
from twin.diagnosis.candidates import Candidate, explore, points_at_peaks, score_gain, try_effect
from twin.diagnosis.conclude import explanatory_variables, verdict_of
from twin.diagnosis.contest import (
    better_calibration,
    confirm_in_fine_limit,
    fit_to_convergence,
    prefer_closer_free_runs,
    refit_in_own_limit,
    refit_with_own_noise,
)
from twin.diagnosis.diagnose import diagnose, search
from twin.diagnosis.fit_patch import patch_of_worst_channel
from twin.diagnosis.judgement import Judgement
from twin.diagnosis.state import Round, SearchState
from twin.effects import REGISTRY
from twin.estimation import refine
from twin.estimation.calibrate import calibrate
from twin.estimation.chain_limit import STANDARD, without_discretisation_error
from twin.estimation.minimise import minimise
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.unknowns import Unknown
from twin.rigs import preset
from twin.virtual_rig.effects import EFFECTS, OUTSIDE_EFFECTS

SEED = 4100
# Not in four short recordings: a late reading of everything is a late drive, a soft clamp's value and the flanks of a
# play are another engine's, and Stribeck's fall is loud in one recording alone, the slow ramp.
LEFT_OPEN = ("sensor-delay", "root-compliance", "backlash", "stribeck-friction")
# One of each kind goes through the search here: a friction, an angle's torque, a late drive, a line, the link's ways to
# bend, a reading. Those that are found alike have their turn in the benchmark; viscous friction goes through the whole
# loop below, a cable is known beside another, cogging is told from a hardening cable elsewhere.
ALIKE = (
    "viscous-friction",
    "position-dependent-friction",
    "cable-torsion",
    "cogging",
    "torque-gain",
    "torque-bias",
    "actuator-lag",
    "stiffness-loss",
    "air-drag",
    "air-pad-drag",
    "hub-sensor-gain",
    "strain-gain",
)
# About a minute each or more, and the benchmark plants them too; asymmetric friction shows on a slow ramp, on which
# every hub's break-away is followed.
SLOWEST = (
    "softening-stiffness",
    "payload-mass",
    "hub-sensor-nonlinearity",
    "gravity-tilt",
    "asymmetric-friction",
)


def searched(rig_campaign, effects, seed, ramp=True):
    """The search on a campaign with these undeclared effects."""
    with ResidualPool(1) as pool:
        return search(recorded(rig_campaign, effects, seed, ramp), pool)


def recorded(rig_campaign, effects, seed, ramp=True):
    """A campaign with these undeclared effects and parameters off from the declared ones.

    What the virtual rig has no parameter for is in its nature: all sensors are late, and bridges see a twist.
    Without the sweep, the second slew and the held-out runs of a full campaign, and the slow ramp where nothing asks
    for it, to be quick.
    """
    plan = planned_fit(seed)
    slews = [e for e in plan if e.name.startswith("bang-bang")]
    left_out = ("torque-sweep",) if ramp else ("torque-sweep", "break-away")
    seen = [e for e in plan if e.name not in left_out and e not in slews[:-1]]
    every = {**EFFECTS, **OUTSIDE_EFFECTS}
    known = {name: {p: v for p, v in values.items() if p in every[name]} for name, values in effects.items()}
    return rig_campaign(known, seed, experiments=seen, perturb=0.5).read()


@pytest.mark.study
@pytest.mark.parametrize("name", [name for name in REGISTRY if name not in (*LEFT_OPEN, *ALIKE, *SLOWEST)])
def test_what_is_missing_is_named_and_recovered(rig_campaign, name):
    seed = SEED + list(REGISTRY).index(name)
    found = searched(rig_campaign, {name: PLANTED[name]}, seed, ramp=False)
    assert verdict_of(found) == "explained"
    assert [c.effects[-1] for c in found.adopted] == [name]
    assert found.rounds[0].ranked[0].effects == (name,)
    fit = found.best
    if "order" in PLANTED[name]:
        assert fit.model.effects[name]["order"] == PLANTED[name]["order"]
    for u, value, error in zip(fit.unknowns, fit.values, fit.errors, strict=True):
        if u.effect == name and u.name in EFFECTS[name]:
            # Four standard errors, and what the coarse chain of a search may be off: a twentieth of the effect.
            planted = u.turned(PLANTED[name][u.name])
            neutral = u.turned(REGISTRY[name].neutral(preset("bossi2009"))[u.name])
            room = 4 * error + 0.05 * abs(planted - neutral)
            room = max(room, 0.12 * planted) if u.name.startswith("static") else room
            off = value - planted
            if u.name in ("phase", "direction"):
                off = np.angle(np.exp(1j * off))
            assert abs(off) < room, u.name


@pytest.mark.study
def test_beside_an_effect_that_is_known_and_has_changed_another_is_named(rig_campaign):
    planted = {"cable-torsion": {"stiffness": 0.012, "rest_angle": 0.2}, "actuator-delay": {"delay": 0.008}}
    campaign = recorded(rig_campaign, planted, 4153, False)
    declared = {"cable-torsion": {"stiffness": 0.008, "rest_angle": 0.1}}
    with ResidualPool(1) as pool:
        found = search(replace(campaign, effects=declared), pool)
    assert verdict_of(found) == "explained"
    assert (found.known, found.names) == (["cable-torsion"], ["actuator-delay"])
    values = found.best.model.effects
    assert values["cable-torsion"]["stiffness"] == pytest.approx(0.012, rel=0.03)
    assert values["actuator-delay"]["delay"] == pytest.approx(0.008, rel=0.1)


@pytest.mark.study
def test_a_clamp_nearly_as_soft_as_the_link_is_tried_though_its_slope_promises_little(rig_campaign):
    campaign = recorded(rig_campaign, {"root-compliance": {"stiffness": 1.5}}, 4150, False)
    names = [
        "strain-gain",
        "hub-sensor-gain",
        "torsional-mode",
        "air-pad-drag",
        "payload-mass",
        "root-compliance",
    ]
    with ResidualPool(1) as pool:
        start = calibrate(campaign, pool)
        best = explore(start.bench, start.base, names).ranked[0]
    assert best.effects == ("root-compliance",)
    assert best.fit.model.effects["root-compliance"]["stiffness"] == pytest.approx(1.5, rel=0.05)


@pytest.mark.study
def test_a_base_that_shakes_is_a_disturbance_and_no_torque_on_the_hub(rig_campaign):
    shaken = {"shaking-base": {"amplitude": 0.2, "frequency": 9.0, "phase": 0.7}}
    with ResidualPool(1) as pool:
        start = calibrate(recorded(rig_campaign, shaken, 4152, False), pool)
        quickly = try_effect(start.bench, start.base, "periodic-disturbance")
        [found] = fit_to_convergence(start.bench, start.base, [quickly])
    # The link shows it, the hub hardly does.
    assert found.score > 200
    values = found.fit.model.effects["periodic-disturbance"]
    assert values["base"] == 1.0
    assert values["frequency"] == pytest.approx(9.0, abs=0.01)
    assert values["amplitude"] == pytest.approx(0.2, rel=0.1)
    # Along the plane's x axis.
    assert np.sin(values["direction"]) == pytest.approx(0.0, abs=0.1)


@pytest.mark.study
def test_which_sensors_are_late_is_told_where_it_is_known_how_late(rig_campaign):
    campaign = recorded(rig_campaign, {"sensor-delay": {"delay": 0.04}}, 4151, False)
    with ResidualPool(1) as pool:
        start = calibrate(campaign, pool)
        late = try_effect(start.bench, start.base, "sensor-delay").fit.model.effects["sensor-delay"]
    assert late.pop("delay") == pytest.approx(0.04, rel=0.01)
    assert late == {"hub_angle": 1.0, "strain": 1.0, "motor_torque": 1.0}


@pytest.mark.study
def test_nothing_is_named_where_nothing_is_missing(rig_campaign):
    found = searched(rig_campaign, {}, 4200)
    assert verdict_of(found) == "no-missing-effect"
    for u, value in zip(found.base.unknowns, found.base.values, strict=True):
        assert abs(value - u.start) < 3 * u.scale, u.name


@pytest.mark.study
def test_a_sensor_that_clips_is_outside_the_library_and_calibrates_nothing(rig_campaign):
    clipped = {"strain-amplifier-clips": {"level": 1e-4, "level_mid": 1.0}}
    with ResidualPool(1) as pool:
        found = search(recorded(rig_campaign, clipped, 4250, False), pool)
        left = dependence.unexplained_residuals(found.bench, found.best)
    assert verdict_of(found) == "outside-library"
    assert not found.adopted
    assert explanatory_variables(found, left)[0] == "strain_base"
    for u, value in zip(found.base.unknowns, found.base.values, strict=True):
        assert abs(value - u.start) < 3 * u.scale, u.name
    lookup = patch_of_worst_channel(found, left)
    assert (lookup.channel, lookup.variable) == ("strain_base", "strain_base")
    # A clipped reading stays where it was: beyond 100 microstrain all that is more is taken away.
    at = np.array([-3e-4, -2e-4, 2e-4, 3e-4])
    seen = at[(at > lookup.x[0]) & (at < lookup.x[-1])]
    assert len(seen) >= 2
    np.testing.assert_allclose(lookup.at(seen), np.clip(seen, -1e-4, 1e-4) - seen, atol=2e-5)


@pytest.mark.slow
def test_the_whole_loop_sees_held_out_recordings_once_and_at_the_end(rig_campaign, monkeypatch):
    planted = {"viscous-friction": PLANTED["viscous-friction"]}
    slews = planned(4300, "bang-bang", "free-vibration", "break-away")
    campaign = rig_campaign(planted, 4300, experiments=slews, perturb=0.5).read()
    stages: list[str] = []
    held_out = Campaign.holdout

    def watched(campaign):
        stages.append("held out")
        return held_out(campaign)

    monkeypatch.setattr(Campaign, "holdout", watched)
    result = diagnose(campaign, stages.append)
    assert stages[-2:] == ["simulating every recording", "held out"]
    assert stages.count("held out") == 1
    assert result.verdict == "explained"
    assert [e.name for e in result.effects] == ["viscous-friction"]
    assert result.effects[0].parameters["viscous"] == pytest.approx(0.003, rel=0.05)
    [prediction] = [p for p in result.predictions.values() if p.role == "holdout"]
    # What an exact chain reaches on an independent rig, 8 noise levels in angle and 1.5 in strain, and as much
    # again for parameters that four short recordings leave open.
    for channel, levels in (("hub_angle", 16), ("strain_base", 3), ("strain_mid", 3)):
        error = prediction.errors[channel]
        assert error.after < levels * error.noise
        assert error.after < error.before / 10
        left = prediction.residual("after", channel)
        assert np.sqrt(np.nanmean(left**2)) == pytest.approx(error.after, rel=1e-6)
    assert json.loads(json.dumps(result.to_json(), allow_nan=False))["verdict"] == "explained"


@pytest.fixture(scope="module")
def viscous(rig_campaign):
    """A calibration without viscous friction, and a fit with it, on slews of a rig that has it."""
    slews = planned(4400, "bang-bang", "free-vibration")
    campaign = rig_campaign({"viscous-friction": {"viscous": 0.004}}, 4400, experiments=slews).read()
    with ResidualPool(1) as pool:
        start = calibrate(campaign, pool)
        yield start, try_effect(start.bench, start.base, "viscous-friction")


def test_of_equal_explanations_the_one_with_closer_free_runs_comes_first(viscous):
    start, right = viscous
    # As if the local view had found nothing to choose between the right effect and none.
    wrong = Candidate(("strain-drift",), start.base, right.score + 1.0)
    ranked = prefer_closer_free_runs(start.bench, [wrong, right])
    assert [c.effects for c in ranked] == [right.effects, wrong.effects]
    assert ranked[0].score == right.score > ranked[1].score
    alone = [right, replace(wrong, score=0.5 * right.score)]
    assert prefer_closer_free_runs(start.bench, alone) is alone
    same = [right, replace(right, effects=("air-drag",))]
    assert prefer_closer_free_runs(start.bench, same) is same


@pytest.mark.parametrize(("rule", "takes"), [("best-of-round", True), ("gains-elsewhere", False)])
def test_free_runs_put_nothing_in_its_place_that_its_round_turned_down(viscous, rule, takes):
    """As a gain of 0.07 % of the hub sensor, of a rig with a softening link and nothing else."""
    start, right = viscous
    wrong = Candidate(("strain-drift",), start.base, right.score + 1.0)
    judged = {right.name: (Judgement(rule, 2.0, 1.0, False),)}
    done = Round((wrong, right), judgements=judged, adopted=wrong, bench=start.bench)
    state = revise.with_closer_free_runs(SearchState(start, (done,)))
    assert state.names == [right.name if takes else wrong.name]


@pytest.mark.slow
def test_a_gain_that_is_gone_in_the_limit_of_the_chain_is_none(viscous):
    start, right = viscous
    defect = start.bench.defect
    # As if the search's chain had answered to an effect by explaining everything.
    drift = start.base.model.replace(effects={"strain-drift": {"rate_base": 0.0, "rate_mid": 0.0}})
    flattered = replace(start.base, model=drift, residual=0.1 * start.base.residual, cost=0.0)
    wrong = Candidate(("strain-drift",), flattered, right.score + 10.0)
    ranked, choice, _ = confirm_in_fine_limit(start.bench, start.base, [wrong], 0.0, 0.0)
    assert choice is None
    assert ranked[0].score < 1
    assert start.bench.defect is defect
    ranked, choice, _ = confirm_in_fine_limit(start.bench, start.base, [wrong, right], 0.0, 0.0)
    assert choice is not None
    assert choice.effects == right.effects
    assert [c.effects for c in ranked] == [right.effects, wrong.effects]
    start.bench.defect = defect


def test_what_predicts_no_other_recording_makes_room_for_the_next(viscous, monkeypatch):
    start, right = viscous
    local = replace(right, effects=("asymmetric-friction",), score=right.score + 10.0)
    elsewhere = {local.name: -1.0, right.name: 100.0}
    monkeypatch.setattr(rules, "gain_elsewhere", lambda bench, base, c: elsewhere[c.name])
    monkeypatch.setattr(contest, "refit_in_fine_limit", lambda bench, fit, jacobian: (bench, fit))
    ranked, choice, _ = confirm_in_fine_limit(start.bench, start.base, [local, right], 0.0, 0.0)
    assert choice is not None
    assert [choice.name, *(c.name for c in ranked)] == [right.name, right.name, local.name]
    ranked, choice, _ = confirm_in_fine_limit(start.bench, start.base, [local], 0.0, 0.0)
    assert (choice, [c.name for c in ranked]) == (None, [local.name])
    # It takes its place only where it would have been adopted itself.
    few = replace(right, score=rules.least_score(0.0) / 2)
    ranked, choice, _ = confirm_in_fine_limit(start.bench, start.base, [local, few], 0.0, 0.0)
    assert (choice, [c.name for c in ranked]) == (None, [local.name, few.name])


@pytest.mark.parametrize(("name", "is_kept"), [("sensor-delay", False), ("viscous-friction", True)])
def test_late_readings_show_an_unknown_state_at_other_instants(viscous, monkeypatch, name, is_kept):
    """A column of the state is kept for a fit with any other effect; for a delay it may have the opposite sign."""
    start, _ = viscous
    rate = Unknown("start", "hub_rate", 0.0, 0.01, False, (-1.0, 1.0), recording=0)
    before = start.base
    base = replace(
        before,
        unknowns=(*before.unknowns, rate),
        values=np.append(before.values, 0.0),
        jacobian=np.column_stack([before.jacobian, np.zeros(len(before.residual))]),
    )
    kept = []

    def minimise_with(bench, model, starts, unknowns, values, fixed, *_, **__):
        kept.append((rate.key in fixed, before.unknowns[0].key in fixed))
        return replace(base, model=model, unknowns=unknowns, values=values)

    monkeypatch.setattr(candidates, "minimise", minimise_with)
    effect = REGISTRY[name]
    candidates.fit_from_best(start.bench, base, name, [dict(effect.starts(before.model.declared)[0])])
    assert kept[0] == (is_kept, True)


def test_what_a_calibration_that_stopped_short_would_gain_is_no_gain_of_an_effect(viscous):
    start, right = viscous
    unknowns, values = start.base.unknowns, start.base.values.copy()
    values[[u.name for u in unknowns].index("hub_inertia")] *= 1.02
    short = minimise(start.bench, start.base.model, start.base.starts, unknowns, values, iterations=0)
    short = replace(short, jacobian=start.base.jacobian)
    assert short.cost > start.base.cost + 20
    better = better_calibration(start.bench, short, right)
    assert better is not None
    assert better.cost == pytest.approx(start.base.cost, abs=0.5)
    assert better_calibration(start.bench, start.base, right) is None


def test_data_are_corrected_for_the_chain_of_their_own_fit(viscous):
    start, right = viscous
    at = right.fit.model, right.fit.starts, right.fit.unknowns
    values = right.fit.values.copy()
    values[[u.name for u in right.fit.unknowns].index("length")] *= 1.05
    longer = minimise(start.bench, *at, values, iterations=0)

    def corrected_at(fit):
        return without_discretisation_error(start.bench, fit.model, fit.starts, STANDARD)[0]

    def promised(fit):
        bench = corrected_at(fit)
        return refine.predicted_gain(bench, refine.evaluated_on(bench, fit))

    elsewhere = corrected_at(longer)
    fit = minimise(elsewhere, *at, right.fit.values)
    assert promised(fit) > 10 * refine.MIN_GAIN
    assert promised(refit_in_own_limit(elsewhere, fit)[1]) < 0.1 * promised(fit)


@pytest.mark.slow
def test_noise_is_that_of_the_link_that_stands(viscous):
    start, right = viscous
    same, found = refit_with_own_noise(start.bench, start.base, right.fit)
    assert same is start.bench
    np.testing.assert_array_equal(found.values, right.fit.values)
    softer = start.base.model.declared["bending_stiffness"] * 0.8
    changed = start.base.model.replace(effects={"stiffness-loss": {"bending_stiffness": softer}})
    bench, found = refit_with_own_noise(start.bench, start.base, replace(start.base, model=changed))
    assert bench is not start.bench
    assert bench.groups == start.bench.groups
    # It rings lower: the noise of its strains is filtered at other frequencies.
    before, after = (b.data.views[0].whitening["strain_base"] for b in (start.bench, bench))
    assert np.abs(after / before - 1).max() > 0.1


def test_a_wave_starts_from_its_highest_peak_and_from_the_one_that_fits_as_it_stands(viscous):
    start, _ = viscous
    effect = REGISTRY["position-dependent-friction"]
    tops = spectrum.spectral_peaks(start.bench, start.base, effect)
    # As if the highest stood for far more friction than there is.
    far = replace(tops[0], coefficients=tuple(0.05 + 0 * c for c in tops[0].coefficients))
    points = points_at_peaks(start.bench, start.base, effect.name, (far, *tops[1:]))
    assert len(points) == 2
    assert points[0]["amplitude"] > 10 * points[1]["amplitude"]
    assert points[0]["order"] == pytest.approx(tops[0].order)
    [alone] = points_at_peaks(start.bench, start.base, effect.name, tops[:1])
    assert alone["order"] == pytest.approx(tops[0].order)


def test_a_gain_within_what_gauges_are_sold_with_gains_nothing(viscous):
    start, _ = viscous
    for off, gains in ((0.002, False), (0.008, True)):
        model = start.base.model.replace(effects={"strain-gain": {"gain_base": 1.0, "gain_mid": 1 - off}})
        better = replace(start.base, model=model, cost=start.base.cost - 50.0)
        assert (score_gain(start.bench, start.base, better) > 40) == gains


@pytest.mark.parametrize("name", ["sensor-delay", "actuator-delay"])
def test_a_delay_within_what_a_card_leaves_open_gains_nothing(viscous, name):
    start, _ = viscous
    neutral = REGISTRY[name].neutral(preset("bossi2009"))
    for delay, worth in ((1e-5, False), (3e-4, True)):
        late = start.base.model.replace(effects={name: {**neutral, "delay": delay}})
        better = replace(start.base, model=late, cost=start.base.cost - 100)
        assert score_gain(start.bench, start.base, better) == pytest.approx(100.0 if worth else 0.0)


def test_when_commands_act_is_not_bent_to_what_is_missing(viscous):
    start, right = viscous
    [late] = [
        value for u, value in zip(right.fit.unknowns, right.fit.values, strict=True) if u.name == "late"
    ]
    assert abs(late) < 2e-5
    assert right.fit.model.late == late
    assert right.fit.model.drive(start.prepared[0].recording).time[0] == late

"""How sure an identification is: the limit of chains, slopes, scatter and profile; peaks beside another campaign's."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from rig_campaigns import planned
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter

from twin.campaigns import rests
from twin.diagnosis import spectrum
from twin.estimation import chain_limit, jackknife, loss, refine, sandwich
from twin.estimation.fit import Fit
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.unknowns import Unknown
from twin.estimation.workbench import Workbench
from twin.identification import (
    backbone,
    bending_modes,
    break_away,
    compare_campaigns,
    estimates,
    findings,
    identified_parameters,
    joint,
    joint_finding,
    likelihood_profile,
    spectra,
)
from twin.identification.break_away_events import find_break_aways
from twin.identification.compare_campaigns import Comparison
from twin.identification.estimates import Identified
from twin.mechanics import beam, chain, planar
from twin.mechanics.state import Start
from twin.recording import Recording, Sensor
from twin.residuals import residual
from twin.residuals.cache import Cache
from twin.residuals.data import DrivenData
from twin.residuals.filters import STRIDE
from twin.residuals.groups import Group
from twin.residuals.make_view import make_view
from twin.residuals.prepared import prepare
from twin.residuals.view import move_link
from twin.rigs import preset
from twin.rigs.channel_errors import ChannelErrors
from twin.rigs.model import Model
from twin.rigs.simulate import simulate
from twin.virtual_rig import Rig as VirtualRig
from twin.virtual_rig.experiments import Experiment

RIG = preset("bossi2009")
GAUGES = {
    "strain_base": Sensor("strain_base", 2e-6, 0.02, 0.0008),
    "strain_mid": Sensor("strain_mid", 2e-6, 0.21, 0.0008),
}


def model() -> Model:
    return Model(RIG, GAUGES, chain.fit_shape(RIG, 5))


def test_weights_take_powers_of_the_step_out():
    n = np.array(chain_limit.PRECISE)
    assert chain_limit.richardson_weights(n) @ (2 + 5 / n**2 - 7 / n**4 + 11 / n**6) == pytest.approx(
        2, abs=1e-9
    )


def test_chains_go_to_the_beam():
    exact = beam.modes(RIG, 2).frequencies
    found = np.array(
        [chain_limit.with_segments(model(), n).chain.modes()[0][:2] for n in chain_limit.PRECISE]
    )
    assert chain_limit.richardson_weights(chain_limit.PRECISE) @ found == pytest.approx(exact, rel=2e-6)


@pytest.mark.parametrize("gauge", ["strain_base", "strain_mid"])
def test_curvature_beside_a_gauge_of_a_bent_link(gauge):
    # A bend with a third power, as large deflections make it: kappa = 1 - 2 x/l + 3 (x/l)^3, 2 at the tip.
    at = GAUGES[gauge].position / RIG["length"]
    values = []
    for n in chain_limit.PRECISE:
        links = chain_limit.with_segments(model(), n)
        s = links.chain.hinges / RIG["length"]
        hinges = (1 - 2 * s + 3 * s**3) * RIG["bending_stiffness"] / links.chain.stiffness
        values.append(links.curvature_rows[gauge] @ hinges)
    assert chain_limit.richardson_weights(chain_limit.PRECISE) @ np.array(values) == pytest.approx(
        1 - 2 * at + 3 * at**3, abs=1e-3 * 2.0
    )


def test_the_link_follows_the_hub_between_the_instants_of_the_grid():
    def shaken(t):
        return 0.05 * np.sin(2 * np.pi * 12 * t) * np.sin(np.pi * np.clip(t - 0.3, 0, 2.4) / 2.4) ** 2

    time = np.arange(0, 3, 0.002)
    still = np.zeros(len(time))
    channels = {"torque_command": still, "hub_angle": shaken(time), "strain_base": still}
    prepared, _ = prepare(Recording("shaken", time, channels), {"hub_angle": 1e-6, "strain_base": 2e-6})
    coarse = model().replace(step=2e-3)
    view = make_view(prepared, coarse)
    fine = np.arange(0, view.time[-1] + 1e-9, 1e-4)
    exact = CubicSpline(fine, shaken(fine))
    at_rest = np.zeros(len(coarse.chain.lengths))
    middle = exact((fine[1:] + fine[:-1]) / 2, 2)
    given = fine, exact(fine), exact(fine, 1), exact(fine, 2), middle, at_rest, at_rest
    bend = planar.simulate_prescribed_hub(coarse.plant, *given, 1e-4)[0][::20] @ [-1, 0, 0, 0, 0, 1]
    for step in (2e-3, 2.5e-4):
        motion, _ = move_link(view, prepared, coarse.replace(step=step), prepared.start)
        found = motion.angles @ [-1, 0, 0, 0, 0, 1]
        n = min(len(found), len(bend))
        assert np.abs(found[:n] - bend[:n]).max() / np.abs(bend).max() < 5e-5


@pytest.fixture(scope="module")
def sweep(rig_campaign):
    """A sweep through the first resonance, on the rig that is declared: recording, noise, model."""
    campaign = rig_campaign({}, 5, experiments=planned(5, "torque-sweep")).read()
    noise = {name: sensor.noise for name, sensor in campaign.sensors.items()}
    shape = chain.fit_shape(campaign.rig, 5)
    return campaign.fit[0], noise, Model(campaign.rig, campaign.sensors, shape, step=2e-3)


def left(sweep, **gone):
    """What the model leaves of a recording (m), channel by channel, and its view; `gone` are missing readings (m)."""
    recording, noise, twin = sweep
    lost = {channel: np.where(mask, np.nan, recording[channel]) for channel, mask in gone.items()}
    recording = recording.replace(channels={**recording.channels, **lost})
    prepared, _ = prepare(recording, noise)
    with ResidualPool(1) as pool:
        bench = Workbench(DrivenData.of([prepared], twin), pool)
        bench, _ = chain_limit.without_discretisation_error(
            bench, twin, [prepared.start], chain_limit.STANDARD
        )
        [residual] = bench.residuals([(twin, [prepared.start], None)])
    return {g.channel: residual[g.rows] for g in bench.data.groups}, bench.data.views[0]


@pytest.mark.slow
def test_noise_that_swells_where_the_link_bends_far_is_taken_for_noise(sweep):
    parts, view = left(sweep)
    scale = view.noise_scale["strain_base"]
    loud = scale > 1.5
    assert 0.02 < loud.mean() < 0.3
    assert np.median(scale) < 1.05
    assert np.std(parts["strain_base"][loud] * scale[loud]) > 1.5
    assert np.std(parts["strain_base"][loud]) == pytest.approx(1.0, abs=0.35)


@pytest.mark.slow
def test_missing_strains_leave_no_trace_beside_them(sweep):
    parts, _ = left(sweep)
    # 24 ms in every half second, through the resonance too.
    gone = (sweep[0].time + 0.3) % 0.5 < 0.023
    filled, view = left(sweep, strain_base=gone)
    known = view.known["strain_base"]
    assert known.mean() == pytest.approx(1 - gone.mean(), abs=0.01)
    # The noise of what is missing is gone from beside it as well.
    assert np.std((filled["strain_base"] - parts["strain_base"])[known[::STRIDE]]) < 0.5
    prepared, _ = prepare(sweep[0], sweep[1])
    as_it_is, bridged = (
        residual.residual(v, prepared, sweep[2], prepared.start)["strain_base"]
        for v in (view, replace(view, with_gaps={}, residuals=Cache()))
    )
    assert np.std((bridged - as_it_is)[known[::STRIDE]]) > 1.0


@pytest.mark.study
def test_a_missing_hub_angle_is_bridged_to_its_noise(sweep):
    parts, _ = left(sweep)
    bridged, _ = left(sweep, hub_angle=(sweep[0].time + 0.3) % 0.5 < 0.013)
    for channel in ("strain_base", "strain_mid"):
        assert np.std(bridged[channel]) < np.std(parts[channel]) + 0.1


@pytest.mark.study
def test_commands_that_act_a_little_late_move_no_break_away():
    time = np.arange(0, 6, 0.002)
    twin = model().replace(step=5e-4)
    prepared = []
    for command in (np.where(time < 1, 0.01, 0.15), np.clip(0.02 * (time - 1), 0, None)):
        channels = {"torque_command": command, "hub_angle": np.zeros(len(time))}
        measured = simulate(twin, Recording("start", time, channels), Start())
        prepared.append(prepare(measured, {"hub_angle": 3e-4})[0])
    starts = [p.start for p in prepared]
    for late in (0.0, 5e-6, -5e-6):
        # A jump of the command tells no level, a ramp does.
        [event] = find_break_aways(twin.replace(late=late), prepared, starts)
        assert event.recording == 1
        assert event.torque == pytest.approx(RIG["static_friction"], rel=0.01)


def test_what_a_spectrum_usually_is_about_a_place():
    white = np.random.default_rng(2).exponential(size=400)
    assert spectrum._local_level(white, 200) < 1.5
    coloured = np.where(np.abs(np.arange(400) - 200) < 80, 8.0, 1.0) * white
    assert spectrum._local_level(coloured, 200) == pytest.approx(8.0, rel=0.4)
    assert spectrum._local_level(coloured, 20) < 1.5


class Declared(dict):
    """Parameters that can be replaced, as a rig's."""

    def replace(self, source="", **values):
        return Declared({**self, **values})


@dataclass(frozen=True)
class Line:
    """Stands for a model: all that counts are its parameters a and b."""

    declared: Declared
    effects: dict = field(default_factory=dict)
    channel_errors: ChannelErrors = ChannelErrors()

    def replace(self, **changes):
        return replace(self, **changes)


class Bench:
    """Residuals: noise (one recording each) less a function (n) of a and b."""

    def __init__(self, noises, function):
        self.noise, self.function = np.concatenate(noises), function
        edges = np.cumsum([0, *(len(n) for n in noises)])
        self.groups = tuple(
            Group(i, "strain_base", slice(*edges[i : i + 2].tolist())) for i in range(len(noises))
        )
        self.weight, self.prepared = np.ones(len(self.noise)), tuple(range(len(noises)))
        self.count = np.array([float(len(n)) for n in noises])
        self.data = SimpleNamespace(groups=self.groups, row_period=lambda _: 0.002)

    def residuals(self, jobs):
        return [self.noise - self.function(m.declared["a"], m.declared["b"]) for m, _, _ in jobs]

    def sizes(self, r):
        return loss.group_sizes(r, self.groups, self.weight)

    def cost(self, r):
        return float(self.count @ loss.loss(self.sizes(r)))

    def start(self, a, b, h=1.0):
        """A fit that has not moved, with slopes over steps of h."""
        unknowns = tuple(Unknown("rig", n, 0.0, 1e3, True, (-3e3, 3e3)) for n in ("a", "b"))
        r = self.noise - self.function(a, b)
        slopes = [
            self.function(a + h, b) - self.function(a, b),
            self.function(a, b + h) - self.function(a, b),
        ]
        J = -np.column_stack(slopes) / h
        line = Line(Declared(a=a, b=b))
        return Fit(line, (), unknowns, np.array([a, b]), np.eye(2), r, self.sizes(r), self.cost(r), J)


T = np.linspace(0, 1, 1000)


def wave(a, b):
    return a * np.sin(8 * T) + b * np.cos(5 * T)


def test_errors_are_those_of_coloured_noise():
    rng, found, said, weighed = np.random.default_rng(0), [], [], []
    for k in range(200):
        # Unit variance, correlated over 20 samples.
        noise = lfilter([1], [1, -0.95], rng.standard_normal(1200))[200:] * np.sqrt(1 - 0.95**2)
        fitted = refine.refined_fit(
            Bench([noise[:500], noise[500:]], wave), Bench([noise[:500], noise[500:]], wave).start(0.0, 0.0)
        )
        found.append(fitted.values)
        if k < 20:
            e = sandwich.recording_information(Bench([noise[:500], noise[500:]], wave), fitted)
            said.append(np.sqrt(np.diag(e.covariance)))
            weighed.append(np.sqrt(np.diag(e.inverse)))
    true = np.std(found, axis=0)
    assert np.mean(said, axis=0) == pytest.approx(true, rel=0.25)
    assert (np.mean(weighed, axis=0) < 0.4 * true).all()


def test_a_rough_cost_adds_what_a_parabola_takes_to_rise_by_it():
    """As impacts in a play do: half a standard error away a residual is another one, by two nats of cost."""
    rng = np.random.default_rng(6)
    noise, jump = rng.standard_normal(1000), rng.standard_normal(1000)
    smooth = Bench([noise], wave)
    fitted = refine.refined_fit(smooth, smooth.start(0.0, 0.0))
    slopes, added = refine.jacobian_and_roughness(smooth, fitted)
    assert np.abs(added).max() < 1e-3 * fitted.covariance[0, 0]
    # Across all that the fit knows, so that its cost alone changes.
    known = np.column_stack([noise, slopes.jacobian])
    jump -= known @ np.linalg.lstsq(known, jump, rcond=None)[0]
    jump *= np.sqrt(4.0) / np.linalg.norm(jump)
    near = 0.5 * np.sqrt(np.diag(fitted.covariance)).min()

    def rough(a, b):
        away = np.linalg.norm(np.array([a, b]) - fitted.values) > near
        return wave(a, b) + jump * away

    _, added = refine.jacobian_and_roughness(Bench([noise], rough), fitted)
    # The smaller of two normal deviations is 1.71 times smaller than one of them; these two are as large.
    assert added == pytest.approx(1.71 * 2 * 2.0 * fitted.covariance, rel=0.1)


def test_a_cost_that_jumps_on_one_side_makes_a_value_no_less_certain():
    """As a torque read at the instants of its steps does, where its delay passes a whole number of samples."""
    rng = np.random.default_rng(6)
    noise, jump = rng.standard_normal(1000), 5.0 * rng.standard_normal(1000)
    smooth = Bench([noise], wave)
    fitted = refine.refined_fit(smooth, smooth.start(0.0, 0.0))
    beyond = fitted.values[0] + 1e-3 * fitted.errors[0]
    cliff = Bench([noise], lambda a, b: wave(a, b) + jump * (a > beyond))
    slopes, added = refine.jacobian_and_roughness(cliff, fitted)
    assert np.abs(added).max() < 1e-2 * fitted.covariance[0, 0]
    np.testing.assert_allclose(slopes.jacobian, fitted.jacobian, atol=1e-3)


def test_a_recording_that_contradicts_the_others_is_seen():
    rng = np.random.default_rng(1)
    noises = [rng.standard_normal(2500) for _ in range(4)]
    t = np.arange(10000) * 0.002
    known = np.sin(2 * np.pi * (0.5 * t**2)), np.cos(3 * t)
    for off, seen in ((0.0, False), (0.5, True)):
        bench = Bench(
            [noises[0] + off * known[0][:2500], *noises[1:]], lambda a, b: a * known[0] + b * known[1]
        )
        distances = sandwich.recording_information(
            bench, refine.refined_fit(bench, bench.start(0.0, 0.0))
        ).deletion_moves()
        assert (np.abs(distances).max() > 4) == seen


def test_a_recording_of_instants_alone_says_what_they_say():
    """Where the link's sensors are left out as faulty, a hub that hardly moves leaves when it broke away, no more."""
    noise = np.random.default_rng(3).standard_normal(1000)
    bench = Bench([noise[:500], noise[500:]], lambda a, b: a * np.sin(8 * T) + b * np.cos(8 * T))
    fitted = refine.refined_fit(bench, bench.start(0.0, 0.0))
    with_both = sandwich.recording_information(bench, fitted).information
    bench.data = SimpleNamespace(
        groups=[bench.data.groups[0], replace(bench.data.groups[1], channel="break_away")],
        row_period=bench.data.row_period,
    )
    alone = sandwich.recording_information(bench, fitted)
    assert alone.information == pytest.approx(with_both)
    assert np.isfinite(alone.covariance).all()


def test_the_first_state_of_a_recording_is_nothing_to_the_others():
    noise = np.random.default_rng(4).standard_normal(1000)
    bench = Bench([noise[:500], noise[500:]], lambda a, b: a * np.sin(8 * T) + b * (np.arange(1000) < 500))
    fitted = refine.refined_fit(bench, bench.start(0.0, 0.0))
    # Slopes by differences leave a trace where there is none.
    trace = fitted.jacobian + 1e-9 * np.cos(3 * T)[:, None]
    first = Unknown("start", "b", 0.0, 1e3, False, (-3e3, 3e3), 0)
    owned = replace(fitted, jacobian=trace, unknowns=(fitted.unknowns[0], first))
    distances = sandwich.recording_information(bench, owned).deletion_moves()
    assert distances[0, 1] == 0
    assert np.abs(distances).max() < 4


def test_first_states_that_move_nothing_are_not_fitted():
    fitted = Bench([np.ones(1000)], wave).start(0.0, 0.0)
    first = Unknown("start", "hub_angle", 0.5, 3e-3, False, (-1e3, 1e3), 0)
    slopes = np.column_stack([fitted.jacobian, 1e-15 * T])
    unknowns = (*fitted.unknowns, first)
    held = replace(fitted, unknowns=unknowns, values=np.array([1.0, 2.0, 85.0]), jacobian=slopes)
    assert list(refine.observable(held)) == [True, True, False]


@pytest.mark.parametrize("off", [0.0, 0.4])
def test_errors_are_those_of_recordings_that_differ(off):
    noise = np.random.default_rng(6).standard_normal((4, 2500))
    t = np.arange(10000) * 0.002
    known = np.sin(2 * np.pi * (0.5 * t**2))
    apart = off * np.repeat([1, -1, 1, -1], 2500) * known
    bench = Bench(list(noise + apart.reshape(4, -1)), lambda a, b: a * known + b * np.cos(3 * t))
    found = jackknife.with_jackknife_covariance(bench, refine.refined_fit(bench, bench.start(0.0, 0.0)))
    by_noise = np.sqrt(2 / 10000)
    assert found.errors[0] == pytest.approx(max(by_noise, off / np.sqrt(3)), rel=0.6 if off == 0 else 0.1)
    assert found.errors[1] == pytest.approx(by_noise, rel=0.6)


def test_recordings_that_contradict_each_other_leave_what_was_declared():
    covariance, even = np.diag([1e-4, 1e-4]), np.full((2, 2), 5e-5)
    influences = np.array([[0.9, 5e-3], [-0.9, -5e-3]])
    widened = jackknife.inflated_covariance(
        covariance, 0 * covariance, influences, even, np.array([0.3, 0.3])
    )
    assert np.sqrt(np.diag(widened)) == pytest.approx([0.3, 0.01])


ONE, NOTHING, ANY = np.eye(1), np.zeros((1, 1)), np.array([np.inf])


def test_a_recording_that_says_nothing_does_not_speak_for_the_others():
    influences, variances = np.array([[3.0], [4.0], [0.0]]), np.array([[0.5], [0.5], [0.0]])
    assert jackknife.inflated_covariance(ONE, NOTHING, influences, variances, ANY) == pytest.approx(25.0)


def test_moves_that_noise_explains_leave_errors_as_they_are():
    influences, variances = np.array([[0.9], [-0.6], [0.5]]), np.full((3, 1), 1 / 3)
    assert jackknife.inflated_covariance(ONE, NOTHING, influences, variances, ANY) == 1.0


def test_recordings_that_disagree_say_nothing_of_the_declaration():
    influences, variances = np.array([[0.2], [-0.2]]), np.full((2, 1), 1e-4)
    widened = jackknife.inflated_covariance(1e-4 * ONE, ONE, influences, variances, ANY)
    assert widened[0, 0] == pytest.approx(1 + 400e-4)


def test_what_is_not_determined_is_said_with_why():
    identified = {
        name: Identified(1.0, error, "m", 1.0, 0.1)
        for name, error in (("known", 0.02), ("news", 0.08), ("jumps", 1e-8), ("ends", 0.01))
    }
    found = SimpleNamespace(at_bounds=lambda: ["ends"], correlated_pairs=list)
    reasons = identified_parameters.not_determined(identified, found)
    assert set(reasons) == {"news", "jumps", "ends"}
    assert "not smooth" in reasons["jumps"]


def test_a_parameter_at_the_end_of_its_range_is_named():
    fitted = replace(Bench([np.ones(1000)], wave).start(0.0, 0.0), values=np.array([2999.0, -3000.0]))
    found = joint.JointEstimate(
        fitted, (), None, None, ("a", "b"), fitted.values, np.eye(2), (), (), np.ones((2, 2)), {}, ()
    )
    assert found.at_bounds() == ["b"]
    assert any(
        s.startswith("B is at a bound of its range")
        for s in joint_finding.joint_finding(found, (), ()).sentences
    )


def test_slopes_along_the_ridge():
    # Only a - b is seen well; slopes over rough steps are off by more than what is left of a + b.
    def valley(a, b):
        return 100 * np.sin((a - b) * (1 + T)) + (a + b) * T**2

    noise = np.random.default_rng(2).standard_normal(1000) + valley(0.3, 0.2)
    bench = Bench([noise], valley)
    fitted = refine.refined_fit(bench, bench.start(0.301, 0.202, h=0.02))
    a, b = fitted.values
    h = 1e-6
    exact = -(valley(a + h, b + h) - valley(a - h, b - h)) / (2 * h)
    assert fitted.jacobian @ [1, 1] == pytest.approx(exact, abs=0.01)
    assert np.abs(bench.start(a, b, h=0.02).jacobian @ [1, 1] - exact).max() > 0.3
    assert fitted.errors[0] == pytest.approx(fitted.errors[1], rel=0.01)


def test_profile_of_a_likelihood_that_is_no_ellipse():
    def decay(a, b):
        return 3 * np.exp(-np.exp(a) * T) + 0 * b

    bench = Bench([0.999 * np.sign(np.sin(700 * T)) + decay(1.0, 0.0)], decay)
    fitted = refine.refined_fit(bench, bench.start(1.0, 0.0, h=1e-3))
    error = 10 * fitted.errors[0]
    # With a variance that is 100 times the likelihood's, the interval is so wide that the two ends differ.
    low, high = likelihood_profile.Profile(bench, fitted, 0, error, 100.0).interval()
    a = fitted.values[0]
    costs = [bench.cost(bench.noise - decay(x, 0.0)) - fitted.cost for x in (low, high)]
    assert costs == pytest.approx([100 * 1.96**2 / 2] * 2, rel=0.05)
    assert abs((high - a) / (a - low) - 1) > 0.1


@pytest.mark.parametrize("gain", [0.1, 1.1, 60.0])
def test_how_long_a_break_away_is_unseen(gain):
    # Readings in noise levels; each hub leaves its rest at sample 200.
    rng, age = np.random.default_rng(6), np.clip(np.arange(260) - 200, 0, None)
    observed = np.where(np.arange(260) < 150, planar.STUCK, planar.UNDECIDED)
    seen = []
    for _ in range(400):
        reading = gain * age**2 / 2 + rng.standard_normal(260)
        [(onset, direction)] = rests._onsets(observed, np.zeros(260), reading, 1.0)
        assert direction == 1
        seen.append(onset - 200)
    mean, spread = break_away._detection_delay(gain)
    assert mean == pytest.approx(np.mean(seen), abs=0.1)
    assert spread == pytest.approx(np.std(seen), abs=0.1)


def swept(peaks, name="sweep"):
    """A torque sweep over 2 to 45 Hz, and a strain with these (frequency, ratio, size) modes."""
    time = np.arange(0, 24, 0.002)
    age = np.clip(time - 0.5, 0, 22)
    torque = np.sin(2 * np.pi * (2 * age + 21.5 * age**2 / 22)) * ((time > 0.5) & (time < 22.5))
    strain = 1e-7 * np.random.default_rng(0).standard_normal(len(time))
    for frequency, ratio, size in peaks:
        w = 2 * np.pi * frequency
        b, a, _ = cont2discrete(([w**2], [1, 2 * ratio * w, w**2]), 0.002, "zoh")
        strain = strain + size * lfilter(b.ravel(), a, torque)
    return spectra.frequency_response(
        [Recording(name, time, {"torque_command": torque, "strain_base": strain})]
    )


def of_modes(rig, torsion=None):
    f = beam.modes(rig, 3).frequencies / (2 * np.pi)
    extra = [(torsion, 0.01, 3e-5)] if torsion else []
    return swept([(f[0], 0.03, 1e-4), (f[1], 0.03, 1e-4), *extra])


def test_peaks_that_a_payload_moves_are_bending_modes():
    heavy = RIG.replace(tip_mass=0.3, tip_inertia=3e-4)
    here, there = of_modes(RIG, 28.0), of_modes(heavy, 28.0)
    kinds = {round(p.frequency_hz): p for p in compare_campaigns.pair_peaks(here, RIG, there, heavy)}
    assert {f: p.kind for f, p in kinds.items()} == {7: "bending", 18: "bending", 28: "not bending"}
    assert kinds[28].other_hz == pytest.approx(28.0, rel=0.01)
    assert kinds[18].other_hz == pytest.approx(kinds[18].bending_hz, rel=0.02)
    assert kinds[18].bending_hz / kinds[18].frequency_hz < 0.95


def test_a_peak_that_an_air_pad_takes_away_is_none_of_bending():
    found = compare_campaigns.pair_peaks(of_modes(RIG, 28.0), RIG, of_modes(RIG), RIG)
    assert [p.kind for p in found] == ["bending", "bending", "not bending"]
    assert found[2].other_hz is None
    said = findings.campaigns_compared(Comparison("with-pad", {}, found)).sentences
    assert any("Hz is gone" in s for s in said)
    assert (
        findings.campaigns_compared(Comparison("with-pad", {}, (), missing="no sweep")).missing == "no sweep"
    )


def at_peaks(*frequencies, response=1.0):
    """A flat response with sharp peaks of equal height, in the place of `spectra.frequency_response`."""
    f = np.arange(1.0, 45.0, 0.05)
    return SimpleNamespace(frequency=f, h1=response * np.ones(len(f)), known=f > 0, tops=frequencies)


@pytest.fixture
def pictured(monkeypatch):
    """Peaks of such responses: 1 high, and surely where they are."""

    def peaks(found):
        sure = estimates.Estimate
        return tuple(spectra.Peak(sure(f, 1e-3), sure(0.03, 1e-3), 1.0) for f in found.tops)

    monkeypatch.setattr(spectra, "peaks", peaks)


@pytest.mark.parametrize(("left", "gone", "kind"), [(0.69, False, "unknown"), (0.2, True, "not bending")])
def test_a_peak_is_gone_only_if_its_height_is(pictured, left, gone, kind):
    [found] = compare_campaigns.pair_peaks(at_peaks(30.0), RIG, at_peaks(response=left), RIG)
    assert found.other_hz is None
    assert found.height == pytest.approx(left)
    assert (found.vanished, found.kind) == (gone, kind)
    [_, said] = findings.campaigns_compared(Comparison("B", {}, (found,))).sentences
    assert ("is gone" in said) == ("no bending mode" in said) == gone


# Bossi et al. 2009, Fig. 4: sweeps of 0 to 50 Hz, a torsional mode near 28 Hz that an air-pad takes away.
TORSION = {"frequency": 28.0, "damping_ratio": 0.01, "inertia_share": 0.15}
HEAVY = VirtualRig()._replace(tip_mass=0.25, tip_inertia=2.5e-4)
FIGURE_4 = {
    "bare": (VirtualRig(), {"torsional-mode": TORSION}),
    "with-pad": (VirtualRig(), {"torsional-mode": TORSION | {"damping_ratio": 0.3}}),
    "loaded": (HEAVY, {"torsional-mode": TORSION}),
    "no-torsion": (VirtualRig(), {}),
}


@pytest.fixture(scope="module")
def figure_4(rig_campaign):
    """The campaigns of Fig. 4, a torque sweep each."""
    t = np.arange(0, 22, 0.002)
    age = np.clip(t - 0.5, 0, 20)
    taper = np.clip(age / 0.5, 0, 1) * np.clip((20 - age) / 0.3, 0, 1)
    torque = 0.15 * taper * np.sin(2 * np.pi * (2 * age + 46 * age**2 / 40))
    sweep = [Experiment("sweep", "torque-sweep", "fit", 0.0, torque)]
    return {
        name: rig_campaign(effects, 3, name=name, rig=rig, experiments=sweep).read()
        for name, (rig, effects) in FIGURE_4.items()
    }


def kinds(peaks):
    return {round(p.frequency_hz): p.kind for p in peaks}


@pytest.mark.slow
def test_the_torsional_mode_of_figure_4_vanishes_with_the_air_pad(figure_4):
    found = compare_campaigns.compare(figure_4["bare"], figure_4["with-pad"])
    [torsion] = [p for p in found.peaks if 27 < p.frequency_hz < 32]
    assert torsion.vanished
    assert all(p.kind == "bending" for p in found.peaks if p is not torsion)
    assert len(found.peaks) == 4
    assert not found.appeared
    said = findings.campaigns_compared(found).sentences
    assert [s for s in said if "no bending mode" in s] == [s for s in said if "is gone" in s]


@pytest.mark.slow
def test_the_torsional_mode_of_figure_4_stays_under_a_payload_that_moves_bending_modes(figure_4):
    found = compare_campaigns.compare(figure_4["bare"], figure_4["loaded"])
    assert list(kinds(found.peaks).values()) == ["bending", "bending", "not bending", "bending"]
    stays = found.peaks[2]
    assert stays.other_hz == pytest.approx(stays.frequency_hz, rel=0.02)
    assert stays.bending_hz < 0.95 * stays.frequency_hz


@pytest.mark.slow
def test_without_a_torsional_mode_figure_4_has_bending_modes_alone(figure_4):
    found = compare_campaigns.compare(figure_4["no-torsion"], figure_4["bare"])
    assert set(kinds(found.peaks).values()) == {"bending"}
    [torsion] = found.appeared
    assert 27 < torsion.frequency_hz < 32
    assert torsion.kind == "not bending"


@pytest.mark.slow
def test_a_peak_of_one_campaign_that_is_where_a_bending_mode_is_is_one(pictured, figure_4, monkeypatch):
    third = float(bending_modes.bending_frequencies(RIG, 3)[2])
    seen = {"bare": at_peaks(response=0.1), "with-pad": at_peaks(30.0, 1.003 * third)}
    monkeypatch.setattr(
        spectra, "frequency_response", lambda recordings, *channel: seen[names[id(recordings[0])]]
    )
    for response in seen.values():
        response.channel = "strain_base"
    names = {id(figure_4[name].fit[0]): name for name in seen}
    found = compare_campaigns.compare(figure_4["bare"], figure_4["with-pad"])
    assert [p.kind for p in found.appeared] == ["not bending", "bending"]
    [_, torsion, third_bending] = findings.campaigns_compared(found).sentences
    assert "no bending mode" in torsion
    assert "has a bending mode" in third_bending


# Bossi et al. 2009, Fig. 3: sweeps of growing amplitude. Friction lets the hub slide in all of them.
SLIDING = VirtualRig()._replace(static_positive=0.02, static_negative=0.02)


def backbone_of_sweeps(rig_campaign, effects):
    """The backbone by five sweeps of 3 to 12 Hz, beside those of the declared rig, which is the true one otherwise."""
    t = np.arange(0, 16, 0.002)
    age = np.clip(t - 0.5, 0, 14)
    taper = np.clip(age / 0.5, 0, 1) * np.clip((14 - age) / 0.3, 0, 1)
    torque = taper * np.sin(2 * np.pi * (3 * age + 9 * age**2 / 28))
    sweeps = [
        Experiment(f"sweep-{k}", "torque-sweep", "fit", 0.0, size * torque)
        for k, size in enumerate((0.05, 0.08, 0.11, 0.14, 0.17))
    ]
    campaign = rig_campaign(effects, 3, rig=SLIDING, experiments=sweeps).read()
    expected = float(bending_modes.bending_frequencies(campaign.rig, 1)[0])
    twin = Model(campaign.rig, campaign.sensors, chain.fit_shape(campaign.rig, 8))
    pairs = [(r, simulate(twin, r, Start())) for r in campaign.fit]
    return backbone.with_simulation(backbone.backbone(campaign.fit, expected), pairs, expected)


@pytest.mark.study
def test_friction_moves_a_resonance_and_the_model_says_so(rig_campaign):
    found = backbone_of_sweeps(rig_campaign, {})
    assert found.depends_on_amplitude
    assert found.slope.value < -0.1
    assert found.simulated_slope == pytest.approx(found.slope.value, abs=0.03)
    assert found.differs_from_model is False
    assert abs(found.residual_slope.value) < 0.01
    said = findings.spectra(seen_sweeps(), (), found, estimates.Estimate(7.27, 0.01)).sentences[-1]
    assert said.endswith("no evidence of a softening link.")


@pytest.mark.slow
def test_a_softening_link_moves_its_resonance_beyond_the_model(rig_campaign):
    effects = {"softening-stiffness": {"softening": 0.15, "curvature": 1.5}}
    found = backbone_of_sweeps(rig_campaign, effects)
    assert found.differs_from_model
    assert -0.1 < found.residual_slope.value < -0.02
    assert (
        ": evidence of a softening link"
        in findings.spectra(seen_sweeps(), (), found, estimates.Estimate(7.27, 0.01)).sentences[-1]
    )


def seen_sweeps():
    return SimpleNamespace(channel="strain_base", recordings=("sweep-4.csv",), by_reference=False)


def test_a_backbone_that_was_not_simulated_is_no_softening():
    found = backbone.Backbone(
        ("a", "b", "c"),
        "strain_base",
        np.ones(3),
        (),
        estimates.Estimate(7.0, 0.1),
        estimates.Estimate(-0.2, 0.05),
    )
    assert found.depends_on_amplitude
    assert found.differs_from_model is None
    assert (
        "no evidence of a softening link"
        in findings.spectra(seen_sweeps(), (), found, estimates.Estimate(7.27, 0.01)).sentences[-1]
    )


def test_the_limit_of_chains_knows_a_clamp_that_gives():
    soft = model().replace(effects={"root-compliance": {"stiffness": 40.0}})
    chains = [chain_limit.with_segments(soft, n) for n in chain_limit.PRECISE]
    assert len({len(c.chain.stiffness) - len(c.chain.rigid.stiffness) for c in chains}) == 1
    # The curvature at the gauge per tip force: (l - x) / EI, whatever the root does.
    levers = [
        c.rig["length"] - np.r_[np.zeros(len(c.chain.stiffness) - n), c.chain.rigid.hinges]
        for c, n in zip(chains, chain_limit.PRECISE, strict=True)
    ]
    bends = [lever / c.chain.stiffness for lever, c in zip(levers, chains, strict=True)]
    found = np.array([c.curvature_rows["strain_base"] @ b for c, b in zip(chains, bends, strict=True)])
    gauge = soft.sensors["strain_base"].position
    expected = (soft.rig["length"] - gauge) / soft.rig["bending_stiffness"]
    assert chain_limit.richardson_weights(chain_limit.PRECISE) @ found == pytest.approx(expected, rel=1e-6)


def test_the_interval_of_a_positive_figure_stays_above_zero():
    low, high = estimates.positive_estimate(3.4, 2.4).interval
    assert 0 < low < 3.4 < high
    assert estimates.positive_estimate(3.4, 0.01).interval == pytest.approx(
        estimates.Estimate(3.4, 0.01).interval, rel=1e-4
    )

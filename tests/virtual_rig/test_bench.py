"""Benches: what their campaigns hold and do not, that seeds decide them, and that their effects show."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from twin.campaigns.campaign import read_campaign
from twin.effects import REGISTRY
from twin.errors import InputError
from twin.virtual_rig import EFFECTS, OUTSIDE_EFFECTS
from twin.virtual_rig.bench import make_bench, writer
from twin.virtual_rig.bench.kinds import MEMBERS, PATTERN, SIZES, kind_of, missing_of
from twin.virtual_rig.bench.recording import record, repeatability, visibility
from twin.virtual_rig.bench.ruler import UNCERTAINTY, VOLTAGE_LIMIT

OPEN_LOOP, CLOSED_LOOP = 12, 7
"""Seeds of benches with the back-EMF undeclared."""


@pytest.fixture(autouse=True, scope="module")
def short_recordings():
    """Recordings of 4 s instead of 10 to 20 s."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "_DURATIONS", (4.0, 4.0))
        yield


def drawn(seed):
    generator = np.random.default_rng([seed, 0])
    return *writer._drawn_bench(seed, generator), generator


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A campaign on disk, and its truth as read from its file."""
    place = tmp_path_factory.mktemp("bench")
    make_bench(place / "bench", OPEN_LOOP, place / "truth.json")
    return place / "bench", json.loads((place / "truth.json").read_text(encoding="utf-8"))


def columns(path):
    return np.genfromtxt(path, delimiter=",", names=True)


def test_a_bench_is_read_as_a_campaign(written):
    folder, truth = written
    campaign = read_campaign(folder)
    assert [len(campaign.fit), len(campaign.holdout())] == [4, 2]
    assert truth["kind"] == "back-emf"
    assert 0.04 <= truth["effects"]["viscous-friction"]["viscous"] <= 0.08
    for recording in (*campaign.fit, *campaign.holdout()):
        moving = recording.name != "stairs.csv"
        assert recording.start == ("unknown" if moving else "rest")
        assert np.ptp(recording["hub_angle"]) > 0.1


def test_a_bench_does_not_tell_its_effects(written):
    folder, truth = written
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    assert not any(name in text for name in (*EFFECTS, *OUTSIDE_EFFECTS, "offset", "noise"))
    declared = tomllib.loads(text)["parameters"]
    assert declared == pytest.approx(truth["declared"])
    assert declared["torque_limit"] == pytest.approx(
        VOLTAGE_LIMIT * tomllib.loads(text)["channels"]["torque_command"]["gain"]
    )
    off = [abs(np.log(declared[name] / truth["true"][name])) for name in UNCERTAINTY if declared[name]]
    assert max(off) > 0.1


def test_recordings_begin_in_motion_about_an_unknown_zero(written):
    folder, truth = written
    begun = columns(folder / "square-a.csv")
    rate = np.polyfit(begun["time"][:10], begun["pot"][:10], 1)[0]
    assert abs(rate) > 0.05
    stairs = columns(folder / "stairs.csv")
    resting = stairs["link"][stairs["motor_voltage"] == 0]
    assert abs(np.mean(resting)) > 4 * np.std(resting)


def test_a_seed_decides_a_bench():
    first, again, other = (drawn(seed) for seed in (5, 5, 17))
    assert first[0].base == again[0].base
    assert first[1] == again[1]
    assert first[0].base != other[0].base
    runs = [record(bench, plan[0], generator) for bench, _, plan, generator in (first, again)]
    assert np.array_equal(runs[0].columns["link"], runs[1].columns["link"])


def test_a_seed_is_a_whole_number(tmp_path):
    with pytest.raises(InputError, match="seed"):
        make_bench(tmp_path / "bench", -1)


def test_kinds_take_turns():
    seeds = range(10 * len(PATTERN))
    found = {kind: {missing_of(s) for s in seeds if kind_of(s) == kind} for kind in MEMBERS}
    assert found == {kind: set(sets) for kind, sets in MEMBERS.items()}


def test_outside_benches_alone_lack_what_the_library_does_not_have():
    for kind, sets in MEMBERS.items():
        for names in sets:
            assert set(names) <= set(SIZES)
            assert any(name not in REGISTRY for name in names) == (kind == "outside")


def test_rigs_are_small_rulers():
    rigs = [drawn(seed)[0].base for seed in range(40)]
    assert all(0.3 <= r.length <= 0.45 and 0.05 <= r.bending_stiffness <= 1.0 for r in rigs)
    assert all(0.02 <= r.coulomb_positive <= r.static_positive <= 0.1 for r in rigs)
    assert {r.tip_mass > 0 for r in rigs} == {False, True}


def test_a_hub_that_breaks_away_slides():
    rigs = [drawn(seed)[0].rig for seed in range(120)]
    assert max(r.warming_rise for r in rigs) > 0
    assert all(r.static_positive >= r.coulomb_positive + r.warming_rise for r in rigs)


def test_zeros_lie_5_to_20_noise_levels_off():
    sensors = [drawn(seed)[0].sensors for seed in range(40)]
    off = [abs(s.link_zero * s.link_gain) / s.noise_levels()[s.link_channel] for s in sensors]
    assert 4.99 < min(off) < max(off) < 20.01
    assert {s.link_channel for s in sensors} == {"strain_base", "tip_deflection"}


def test_a_controller_follows_its_steps_and_saturates():
    bench, _, runs, generator = drawn(CLOSED_LOOP)
    assert {run.reference is None for run in runs} == {False, True}
    found = record(bench, runs[0], generator)
    reference = runs[0].reference[runs[0].lead :]
    settled = np.abs(np.abs(reference) - np.abs(reference).max()) < 1e-3
    assert found.true["hub_angle"][settled] == pytest.approx(reference[settled], abs=0.2)
    assert np.abs(found.columns["motor_voltage"]).max() > VOLTAGE_LIMIT


def test_an_effect_that_is_absent_is_invisible():
    bench, _, runs, generator = drawn(OPEN_LOOP)
    found = record(bench, runs[4], generator)
    assert visibility(bench, found, "viscous-friction") > writer.LEAST_VISIBLE
    assert visibility(bench, found, "backlash") < 0.1


def test_only_where_the_hub_sticks_does_the_static_friction_count():
    bench, _, runs, generator = drawn(OPEN_LOOP)
    slow = replace(runs[3], volts=np.linspace(0.0, runs[3].volts[-1], len(runs[3].volts)))
    assert repeatability(bench, record(bench, slow, generator))["hub_angle"] > 1e-4
    assert repeatability(bench, record(bench, runs[0], generator))["hub_angle"] < 1e-5


def test_every_voltage_moves_the_hub():
    for seed in range(40):
        bench, _, runs, _ = drawn(seed)
        rig = bench.rig
        for run in runs:
            if run.reference is None:
                delivered = bench.torque_per_volt * np.abs(run.volts).max() - rig.dead_zone
                assert delivered > rig.static_positive + rig.friction_ripple

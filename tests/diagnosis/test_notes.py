"""What the reader of a diagnosis is told beside its answer."""

from types import SimpleNamespace

import numpy as np
import pytest

from twin.campaigns.drive import RawCommand
from twin.diagnosis import notes, remainder
from twin.diagnosis.answer import ChannelError
from twin.estimation.unknowns import Unknown
from twin.residuals import static_levels

STATIC = 0.065  # N m, of the model


def with_break_aways(monkeypatch, torques, slow=True, seen=True):
    """A search whose model has one static level, on a recording in which the hub broke away at these torques [N m]."""
    runs = [
        SimpleNamespace(
            holding_torque=(abs(t), 0.01),
            direction=1 if t > 0 else -1,
            level=STATIC,
            end_of_rest=float(k),
            is_slow=slow,
        )
        for k, t in enumerate(torques)
    ]
    monkeypatch.setattr(static_levels, "rest_runs", lambda *_: enumerate(runs))
    views = [
        SimpleNamespace(time=np.arange(k, k + 1, 0.01), onsets=[(1, 1)] if seen else [])
        for k, _ in enumerate(runs)
    ]
    return SimpleNamespace(best=SimpleNamespace(model=None, starts=()), data=SimpleNamespace(views=views))


@pytest.mark.parametrize(
    ("torques", "told"),
    [
        ([0.066, 0.064, -0.066], ()),
        # One instant of three is no level.
        ([0.066, 0.09, 0.065, -0.064], ()),
        ([0.088, 0.087, -0.065], ("at 0.087 N·m forwards (the model: 0.065 N·m)",)),
        ([0.088, 0.087, -0.045], ("0.087 N·m forwards", "0.045 N·m backwards")),
    ],
)
def test_a_hub_that_breaks_away_at_another_torque_than_the_models_is_told(monkeypatch, torques, told):
    said = notes.break_away_notes(with_break_aways(monkeypatch, torques))
    assert len(said) == bool(told)
    assert all(part in said[0] for part in told)


@pytest.mark.parametrize("unsure", [{"slow": False}, {"seen": False}])
def test_a_hub_that_only_was_slow_breaks_away_nowhere(monkeypatch, unsure):
    assert notes.break_away_notes(with_break_aways(monkeypatch, [0.088, 0.087], **unsure)) == []


@pytest.mark.parametrize(
    ("role", "after", "reach", "told"),
    [
        ("holdout", 5.0, 0.0, False),
        ("holdout", 78.0, 0.0, True),
        # What a stick or a slip decides cannot be predicted.
        ("holdout", 78.0, 20.0, False),
        ("fit", 78.0, 0.0, False),
    ],
)
def test_a_held_out_recording_that_is_missed_is_told(monkeypatch, role, after, reach, told):
    monkeypatch.setattr(remainder, "unexplained_channels", lambda _: ())
    error = ChannelError(90.0, 80.0, after, 1.0, "rad", reach)
    predictions = {"slew.csv": SimpleNamespace(role=role, errors={"hub_angle": error})}
    said = notes.missed_held_out(SimpleNamespace(), predictions)
    assert len(said) == told
    assert all("slew.csv was held out, and the hub angle is missed by 78 noise levels" in s for s in said)


@pytest.mark.parametrize(
    ("role", "reach", "by_gaps", "told"),
    [
        ("holdout", 0.0, 0.0, None),
        (
            "holdout",
            40.0,
            0.0,
            "a break-away torque that is off by 0.1 % changes the prediction by 40 noise levels",
        ),
        ("holdout", 40.0, 50.0, "other commands there change the prediction by 50 noise levels"),
        ("fit", 40.0, 50.0, None),
    ],
)
def test_what_makes_a_held_out_recording_unpredictable_is_told(role, reach, by_gaps, told):
    error = ChannelError(90.0, 80.0, 78.0, 1.0, "rad", reach, by_gaps)
    said = notes._unpredictable({"slew.csv": SimpleNamespace(role=role, errors={"hub_angle": error})})
    assert len(said) == (told is not None)
    assert all(told in s for s in said)


@pytest.mark.parametrize(("value", "told"), [(0.85, True), (0.84, False), (0.0, False)])
def test_an_effect_at_the_end_of_its_range_is_told(value, told):
    share = Unknown("effect", "inertia_share", 0.1, 0.01, False, (0.0, 0.85), effect="torsional-mode")
    other = Unknown("rig", "damping_ratio", 0.02, 0.01, True, (0.0, 0.04))
    best = SimpleNamespace(unknowns=(share, other), values=np.array([value, 0.04]))
    said = notes.at_range_end(best, ["torsional-mode"])
    assert len(said) == told
    assert all("torsional-mode came to the end of its range (inertia_share 0.85)" in s for s in said)


def test_what_is_outside_the_library_says_itself_that_it_is_missed(monkeypatch):
    monkeypatch.setattr(remainder, "unexplained_channels", lambda _: ("hub_torque",))
    error = ChannelError(90.0, 80.0, 78.0, 1.0, "rad", 0.0)
    predictions = {"slew.csv": SimpleNamespace(role="holdout", errors={"hub_angle": error})}
    assert notes.missed_held_out(SimpleNamespace(), predictions) == []


def test_viscous_friction_under_a_voltage_looks_like_back_emf():
    found = {"viscous-friction": {"viscous": 0.06}}
    [said] = notes.back_emf(SimpleNamespace(torque_per_volt=0.12), found)
    assert "0.5 V·s/rad" in said
    assert notes.back_emf(SimpleNamespace(torque_per_volt=None), found) == []
    assert notes.back_emf(SimpleNamespace(torque_per_volt=0.12), {}) == []


@pytest.mark.parametrize(
    ("value", "error", "told"),
    [
        (
            1.034,
            0.001,
            "The gain of the base strain is taken as 1.0340 ± 0.0010, within its declaration, 1.00 ± 0.05.",
        ),
        (1.05, 0.02, None),
        (1.004, 0.0001, None),
        (np.exp(0.15), 0.001, "the recordings contradict this declaration."),
    ],
)
def test_a_gain_off_its_declared_value_is_told(value, error, told):
    u = Unknown("gain", "strain_base", 1.0, 0.05, True, (np.exp(-0.15), np.exp(0.15)))
    fit = SimpleNamespace(unknowns=(u,), values=np.array([value]), errors=np.array([error]))
    said = notes.channel_error_notes(fit)
    assert len(said) == (told is not None)
    assert all(told in note for note in said)


def test_a_delay_is_told_in_milliseconds():
    u = Unknown("delay", "hub_rate", 0.0, 0.003, True, (-0.009, 0.009))
    fit = SimpleNamespace(unknowns=(u,), values=np.array([0.002]), errors=np.array([1e-5]))
    [note] = notes.channel_error_notes(fit)
    assert "The delay of the hub rate is taken as 2.000 ± 0.010 ms, within its declaration, 0 ± 3 ms." in note


def drive_campaign(effects, uncertain=0.0):
    command = SimpleNamespace(gain_uncertainty=uncertain)
    return SimpleNamespace(
        raw_command=RawCommand(0.12, "V", bool(effects)), effects=effects, sensors={"torque_command": command}
    )


def fitted(**effects):
    return SimpleNamespace(model=SimpleNamespace(effects=effects))


def test_a_dead_zone_is_told_in_units_of_the_command():
    found = fitted(**{"dead-zone": {"half_width": 0.024}})
    said = notes.drive_notes(drive_campaign({}), found)
    assert "The dead zone of 0.024 N·m is 0.2 V of the command." in said
    assert any("hold if 0.12 N·m/V is right" in note for note in said)
    assert len(notes.drive_notes(drive_campaign({}, uncertain=0.1), found)) == 1
    assert notes.drive_notes(SimpleNamespace(raw_command=None), found) == []


def test_what_a_servo_bench_has_to_settle_stands_with_the_verdict():
    campaign, viscous = drive_campaign({}), fitted(**{"viscous-friction": {"viscous": 0.067}})
    campaign.torque_per_volt = 0.12
    friction, scale = notes.verdict_caveats(campaign, viscous, True)
    assert friction.endswith("may be the back-EMF of a drive that is not declared: declare it in [drive].")
    assert scale == "All values hold only if 0.12 N·m/V is right."
    assert notes.verdict_caveats(campaign, viscous, False) == (scale,)
    for settled in (drive_campaign({}, uncertain=0.1), drive_campaign({"torque-gain": {"gain": 1.0}})):
        settled.torque_per_volt = None
        assert notes.verdict_caveats(settled, viscous, True) == ()


def test_a_declared_drive_is_told_as_declared_and_as_fitted():
    declared = {"torque-gain": {"gain": 1.0}, "viscous-friction": {"viscous": 0.07}}
    effects = fitted(**{"torque-gain": {"gain": 0.8}, "viscous-friction": {"viscous": 0.066}})
    [said] = notes.drive_notes(drive_campaign(declared), effects)
    assert said.startswith(
        "[drive] declares 0.12 N·m/V at the hub; fitted: 0.096 N·m/V. Its back-EMF declares 0.07 "
    )

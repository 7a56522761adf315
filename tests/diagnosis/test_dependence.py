"""On which variable it is found to depend what a model leaves unexplained."""

from dataclasses import replace

import numpy as np
import pytest

from twin.diagnosis.dependence import (
    TRAVEL,
    Unexplained,
    parameter_drift,
    strongest_variables,
    variance_shares,
)
from twin.diagnosis.fit_patch import why_no_patch
from twin.diagnosis.notes import drifting_parameter
from twin.diagnosis.rules import MODEL_SHARE
from twin.diagnosis.traces import final_traces
from twin.recording import HUB_TORQUE

NOISE = 1e-3
COUNT = 3000  # readings of a recording, 2 ms apart


def recordings(shows):
    """Two recordings of 6 s of what a dead zone of 10 mN m leaves of slow commands, in those that show it, in noise."""
    generator = np.random.default_rng(5)
    time = 0.002 * np.arange(COUNT)
    parts = []
    for k, shown in enumerate(shows):
        command = 0.1 * np.sin(2 * np.pi * (0.6 + 0.1 * k) * time)
        lost = np.where(np.abs(command) < 0.01, -command, 0.0) if shown else np.zeros(COUNT)
        angle = np.cumsum(generator.normal(0, 0.01, COUNT))
        values = lost + generator.normal(0, NOISE, COUNT)
        parts.append((values, {"torque_command": command, "hub_angle": angle, "time": time}))
    return Unexplained(
        np.concatenate([values for values, _ in parts]),
        {name: np.concatenate([v[name] for _, v in parts]) for name in parts[0][1]},
        np.repeat(np.arange(len(parts)), COUNT),
        np.concatenate([6.0 * k + time for k in range(len(parts))]),
        np.concatenate([values / NOISE for values, _ in parts]),
    )


@pytest.mark.parametrize("shows", [(True, True), (True, False)])
def test_a_narrow_fault_is_seen_in_all_recordings_or_in_one(shows):
    (first, share), (_, next_share), *_ = variance_shares(recordings(shows))
    assert first == "torque_command"
    assert share > 3 * MODEL_SHARE
    assert next_share < MODEL_SHARE


def test_noise_depends_on_nothing():
    assert max(share for _, share in variance_shares(recordings((False, False)))) < MODEL_SHARE


def test_where_nothing_is_left_nothing_depends():
    found = recordings((False,))
    assert variance_shares(replace(found, values=np.zeros(COUNT))) == []


def test_a_fault_of_two_variables_names_both():
    found = recordings((False, False))
    generator = np.random.default_rng(6)
    rate = generator.normal(0, 1, len(found.time))
    wanes = -np.sign(rate) * (np.exp(-found.variables["time"] / 2) - 0.3) * 2 * NOISE
    fault = replace(found, values=found.values + wanes, variables={**found.variables, "hub_rate": rate})
    (first, share), (second, _), (_, rest), *_ = variance_shares(fault)
    assert {first, second} == {"time", "hub_rate"}
    assert share > 3 * MODEL_SHARE > rest


@pytest.mark.parametrize("instants", [(400, 2100, 3300, 5000), tuple(range(200, 6000, 270))])
def test_knocks_at_instants_that_nothing_tells_depend_on_time(instants):
    found = recordings((False, False))
    white = found.white.copy()
    for at in instants:
        white[at : at + 8] += 30.0
    fault = replace(found, white=white, values=NOISE * white)
    assert max(share for _, share in variance_shares(fault)) < MODEL_SHARE
    assert strongest_variables([found, fault]) == ("time",)


def test_a_stop_that_makes_the_link_ring_depends_on_the_angle():
    found = recordings((False, False))
    angle = 0.6 * np.sin(2 * np.pi * 0.5 * found.time)
    pushed = np.where(angle > 0.55, -20 * NOISE * (angle - 0.55) / 0.05, 0.0)
    ringing = found.white.copy()
    for at in np.flatnonzero(np.diff(np.sign(angle - 0.55)) > 0):
        ringing[at : at + 8] += 30.0
    stop = replace(found, values=found.values + pushed, variables={**found.variables, "hub_angle": angle})
    link = replace(stop, white=ringing, values=NOISE * ringing)
    assert strongest_variables([link]) != ()
    assert strongest_variables([link, stop])[0] == "hub_angle"


def test_what_is_loud_in_most_of_a_recording_is_no_knock():
    found = recordings((False, False))
    loud = found.white * np.where(found.time % 1.0 < 0.4, 8.0, 1.0)
    assert strongest_variables([replace(found, white=loud, values=NOISE * loud)]) == ()


def test_bristles_depend_on_how_far_the_hub_has_turned_since_it_turned_round():
    """Swings that drift, at rates that are badly known; what holds the hub back acts over the first 0.02 rad."""
    found = recordings((False, False))
    swing = 2 * np.pi * (1.0 + 0.7 * found.recording) * found.time
    angle = 0.3 * np.cos(swing) + 0.2 * found.time
    rate = np.gradient(angle, found.time)
    turned = np.append(True, np.diff(np.sign(rate)) != 0)
    travel = angle - angle[np.maximum.accumulate(np.where(turned, np.arange(len(angle)), 0))]
    held = np.where(np.abs(travel) < 0.02, 3 * NOISE * np.sign(travel), 0.0)
    known = np.sign(rate) * np.abs(np.random.default_rng(7).normal(0, 1, len(rate)))
    variables = found.variables | {"hub_angle": angle, "hub_rate": known}
    (first, share), *_ = variance_shares(replace(found, values=found.values + held, variables=variables))
    assert first == "hub_travel"
    assert share > MODEL_SHARE


def test_what_remains_is_shown_against_what_it_depends_on_the_unexplained_first():
    quiet, odd = recordings((False, False)), recordings((True, True))
    hub_rate = {"hub_rate": np.gradient(odd.variables["hub_angle"], odd.time)}
    odd = replace(odd, variables=odd.variables | hub_rate)
    behind = {"hub_torque": quiet, "strain_base": quiet, "strain_mid": odd}
    first, *others = final_traces(behind, ["strain_mid"], ("torque_command", "hub_angle"))
    assert [t.channel for t in (first, *others)] == ["strain_mid", "hub_torque", "strain_base"]
    assert [t.explained_by for t in (first, *others)] == ["torque_command", None, None]
    assert first.values is odd.values
    assert first.fitted is None
    assert first.since_start == pytest.approx(odd.time - 6.0 * odd.recording)
    [travelled] = final_traces({"strain_mid": odd}, ["strain_mid"], (TRAVEL,))
    assert TRAVEL in travelled.variables


def test_why_there_is_no_lookup_is_said():
    dead_zone = recordings((True, True))
    assert "none of the variables" in why_no_patch({"hub_torque": dead_zone}, ())
    assert "how far the hub has turned" in why_no_patch({"hub_torque": dead_zone}, (TRAVEL, "hub_rate"))
    assert "at the same instant of different recordings" in why_no_patch({"hub_torque": dead_zone}, ("time",))
    assert "no single variable" in why_no_patch({"hub_torque": dead_zone}, ("hub_angle",))
    assert "too little of the range of the commanded torque" in why_no_patch(
        {"hub_torque": dead_zone}, ("torque_command",)
    )
    by_rate = replace(dead_zone, variables={"hub_rate": dead_zone.variables["torque_command"]})
    assert "depend on the hub rate: a simulation evaluates no such function" in why_no_patch(
        {"strain_base": by_rate}, ("hub_rate",)
    )


def drifting(share):
    """What the stiffness of a link leaves that falls as each recording goes on: its slope swings and has no mean."""
    found = recordings((False, False))
    slope = 30 * np.sin(2 * np.pi * 3.3 * found.time + found.recording)
    change = share * (found.variables["time"] - 3.0)
    return replace(found, white=found.white + change * slope, slopes={"bending_stiffness": slope})


def test_a_parameter_that_changes_as_a_recording_goes_on_depends_on_time():
    (first, share), *_ = variance_shares(drifting(0.05))
    assert first == "time"
    assert share > 0.5
    assert dict(variance_shares(drifting(0.0)))["time"] < MODEL_SHARE
    assert parameter_drift(drifting(0.05)) == ("bending_stiffness", pytest.approx(share))
    assert parameter_drift(recordings((True, True))) == ("", 0.0)


def test_the_parameter_that_changes_is_named():
    [note] = drifting_parameter({HUB_TORQUE: drifting(0.05)}, ("time", "hub_rate"))
    assert "as if bending_stiffness changed during each recording" in note
    assert drifting_parameter({HUB_TORQUE: drifting(0.05)}, ("hub_rate", "time")) == []
    assert drifting_parameter({HUB_TORQUE: drifting(0.0)}, ("time",)) == []

"""What benchmarks compute besides timing, where a mistake would not show in their tables."""

import json

import beam_peers
import benches
import numpy as np
import pytest
import resumable
import where_time_goes
from fleet_tasks import failing_case

from twin.mechanics import beam
from twin.mechanics.chain import build, uniform_shape
from twin.rigs import preset


def test_mujocos_cable_with_half_bodies_at_its_ends_is_the_uniform_chain():
    rig = preset("bossi2009")
    found = beam_peers.cable_frequencies(beam_peers.cable_spec(rig, 5, shifted=True).compile())
    links = build(rig, 5, uniform_shape(5))
    for frequencies, boundary in zip(found, ("free", "clamped"), strict=True):
        # The stiffness is a central difference over 1e-5 rad.
        np.testing.assert_allclose(frequencies, links.modes(boundary)[0], rtol=1e-6)


@pytest.mark.parametrize(
    ("rate", "order", "share"), [(beam_peers.rk4_rate, 4, 1 / 120), (beam_peers.trapezoidal_rate, 2, 1 / 12)]
)
def test_a_time_step_slows_an_oscillation_by_the_error_of_its_integrator(rate, order, share):
    phase = np.array([0.1])
    assert 1 - rate(phase) == pytest.approx(share * phase**order, rel=0.02)


def test_a_step_is_the_longest_within_the_bound_and_stable():
    rig = preset("bossi2009")
    frequencies = tuple(beam.modes(rig, 3, boundary).frequencies for boundary in ("free", "clamped"))
    step = beam_peers.step_of(rig, frequencies, beam_peers.trapezoidal_rate, stable=1.0)
    assert beam_peers.error(rig, frequencies, beam_peers.trapezoidal_rate, step) <= beam_peers.WITHIN
    longer = beam_peers.SAMPLE / (round(beam_peers.SAMPLE / step) - 1)
    assert beam_peers.error(rig, frequencies, beam_peers.trapezoidal_rate, longer) > beam_peers.WITHIN
    assert beam_peers.step_of(rig, frequencies, beam_peers.rk4_rate, stable=1e-4) == pytest.approx(1e-4)


def test_a_simulation_counts_for_the_innermost_purpose():
    def calibrate():
        return first_state()

    def first_state():
        return where_time_goes.purpose()

    assert calibrate() == "first states"
    assert where_time_goes.purpose() == where_time_goes.OTHER


def test_a_campaign_that_fails_loses_no_other_answer(tmp_path):
    options = resumable.parser("", 1).parse_args([str(tmp_path)])
    with pytest.raises(RuntimeError, match="no answer to one$") as raised:
        resumable.answers({"one": 1, "two": 2, "three": 3}, failing_case, options)
    assert str(raised.value.__cause__) == "singular"
    lines = (tmp_path / resumable.FILE).read_text().splitlines()
    assert {json.loads(line)["campaign"] for line in lines} == {"two", "three"}
    assert (tmp_path / "one").is_dir()


@pytest.mark.parametrize(
    ("true", "adopted", "right"),
    [
        (["sensor-delay"], ["actuator-delay"], True),
        (["sensor-delay", "backlash"], ["backlash", "actuator-delay"], True),
        (["sensor-delay"], ["actuator-lag"], False),
        (["sensor-delay"], ["sensor-delay", "actuator-lag"], False),
    ],
)
def test_late_readings_of_a_bench_are_a_late_drive(true, adopted, right):
    answer = {"verdict": "explained", "adopted": dict.fromkeys(adopted)}
    answer["truth"] = {"kind": "other", "effects": dict.fromkeys(true)}
    assert benches.is_right(answer) is right
    assert not benches.is_right({**answer, "verdict": "outside-library"})

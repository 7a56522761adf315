"""The page of an identification: no figure of a single dot, parameters beside their declared values, its caveat."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from twin.commands import identify
from twin.files.json import to_text
from twin.files.provenance import recorded
from twin.identification import conclusion, page, pictures, rig_file
from twin.identification.break_away import StaticFriction
from twin.identification.derived import DerivedQuantities, DerivedQuantity
from twin.identification.estimates import Estimate, Identified
from twin.identification.held_out import HeldOutError
from twin.identification.procedures import Procedures
from twin.identification.result import Identification
from twin.identification.text import format_estimate
from twin.identification.trust import Trust, trust_in, without_intervals
from twin.report import pages
from twin.rigs import preset
from twin.rigs.rig_file import read_rig_file

LENGTH = Identified(0.421, 0.0002, "m", 0.42, 0.001)
INERTIA = Identified(7e-4, 1e-6, "kg*m^2", 7e-4, 2e-5)
MASS = Identified(0.155, 0.0002, "kg", 0.155, 0.001)
EVENT = SimpleNamespace(direction=1, angle=0.1, torque=0.06)


def test_a_single_break_away_is_no_figure():
    def figures(count: int):
        friction = SimpleNamespace(
            level=Estimate(0.06, 0.001), events=[EVENT] * count, errors=[0.001] * count
        )
        return page.FIGURES["break-away"](SimpleNamespace(static_friction=friction))

    assert [len(figures(count)) for count in (1, 2)] == [0, 1]


def test_parameters_are_drawn_in_declared_standard_deviations():
    assert pictures.moves({"length": LENGTH}) is None
    [points] = pictures.moves({"length": LENGTH, "tip_mass": MASS}).data
    assert points.x == pytest.approx((1.0, 0.0))
    assert points.y == ("length", "tip mass")
    assert points.error_x.array[0] == pytest.approx(1.96 * 0.2)


def test_no_interval_is_cut_off():
    wide = Identified(0.43, 0.004, "m", 0.42, 0.002)
    figure = pictures.moves({"length": wide, "tip_mass": MASS})
    low, high = figure.layout.xaxis.range
    assert high > (wide.estimate.interval[1] - wide.declared) / wide.declared_error
    assert low < -2


def test_the_circles_of_correlations_have_a_scale():
    matrix = np.array([[1.0, 0.5, 0.1], [0.5, 1.0, -1.0], [0.1, -1.0, 1.0]])
    joint = SimpleNamespace(names=("length", "tip_mass", "hub_inertia"), correlation=matrix)
    shown = pictures.correlation(joint).data
    scale = {trace.name: trace.marker.size for trace in shown if trace.name in ("1", "0.5", "0.1")}
    drawn = [size for trace in shown if trace.showlegend is False for size in trace.marker.size]
    assert sorted(drawn) == pytest.approx(sorted(scale.values()))


def test_figures_of_all_pages_have_one_colour_of_text():
    assert pictures.moves({"length": LENGTH, "tip_mass": MASS}).layout.font.color == pages.INK


def test_caveat_names_what_was_not_predicted_before_what_was_not_determined():
    missed = HeldOutError("slew.csv", "hub_angle", "rad", 3e-4, 0.4, 0.38, 0.1, 0.1, None)
    near = HeldOutError("slew.csv", "strain_base", "1", 2e-6, 3e-6, 2e-6, 2e-6, 2e-6, 2e-6)
    result = SimpleNamespace(
        all_parameters={"length": LENGTH, "tip_mass": MASS},
        not_determined={"tip_mass": "..."},
        held_out=(near, missed),
        trust=Trust(True, "Nothing contradicts it."),
    )
    said = conclusion.caveat(result)
    assert "slew.csv is not predicted: the hub angle is off by 22°, and its sensor's noise is 0.017°" in said
    result.held_out = (near,)
    assert conclusion.caveat(result) == "They do not determine tip mass."
    far = Identified(0.43, 0.0002, "m", 0.42, 0.001)
    result.all_parameters["length"] = far
    assert conclusion.caveat(result).startswith("Length moved by more than two declared standard deviations")


def joint_of(*recordings, contradictions=()):
    return SimpleNamespace(recordings=recordings, contradictions=contradictions)


def error(channel, windowed, by_steps=None, identified=9.0):
    """Errors on a held-out recording, in noise levels."""
    return HeldOutError("slew.csv", channel, "1", 1.0, 9.0, identified, 9.0, windowed, by_steps)


def test_recordings_that_move_the_estimate_contradict_the_model():
    moved = joint_of("a.csv", "b.csv", contradictions=(("b.csv", "hub_inertia", 12.94),))
    trust = trust_in(moved, ())
    assert not trust.trusted
    assert "without b.csv the hub inertia moves by 12.9 standard errors" in trust.reason
    assert trust_in(joint_of("a.csv", "b.csv"), ()).trusted
    assert trust_in(joint_of("a.csv"), ()).reason.startswith("Nothing tests the model")


@pytest.mark.parametrize(
    ("missed", "trusted"),
    [
        (error("hub_angle", 52.0), False),
        (error("strain_base", 22.7, 3.0), False),
        # A stick at another instant spoils the free run alone, one of the hub the link's windows too.
        (error("hub_angle", 1.1), True),
        (error("strain_base", 22.7, 0.6), True),
        # What the free run predicts is predicted.
        (error("hub_angle", 3.0, identified=1.5), True),
    ],
)
def test_a_held_out_error_that_no_stick_explains_contradicts_the_model(missed, trusted):
    trust = trust_in(joint_of("a.csv", "b.csv"), (missed, error("motor_torque", 1.0)))
    assert trust.trusted == trusted
    assert ("slew.csv is not predicted" in trust.reason) == (not trusted)


@pytest.fixture
def contradicted():
    """An identification whose model is contradicted."""
    parameters = {"length": LENGTH, "tip_mass": replace(MASS, methods={"slews": Estimate(0.15, 0.01)})}
    model = SimpleNamespace(effects={})
    quantity = DerivedQuantity("a total inertia", Estimate(0.03, math.nan), "kg*m^2")
    joint = SimpleNamespace(
        fit=SimpleNamespace(model=model), names=("length",), correlation=np.eye(1), correlated_pairs=list
    )
    nothing = dict.fromkeys(Procedures.__dataclass_fields__)
    friction = StaticFriction((), (), {}, None, math.nan)
    procedures = Procedures(**{**nothing, "joint": joint, "decays": (), "static_friction": friction})
    return Identification(
        "rig-7",
        preset("bossi2009"),
        procedures,
        {name: without_intervals(p) for name, p in parameters.items()},
        {"tip_mass": "strongly correlated with bending_stiffness"},
        (),
        DerivedQuantities(quantity, quantity, quantity, quantity),
        (),
        (),
        Trust(False, "The recordings contradict each other."),
        (),
        1.0,
        recorded([], None, "twin identify rig-7", {}),
    )


def test_a_contradicted_model_has_no_intervals_anywhere(contradicted, capsys, tmp_path):
    said = json.loads(to_text(contradicted.to_json()))
    assert (said["trusted"], said["reason"]) == (False, "The recordings contradict each other.")
    for p in (*said["parameters"].values(), said["parameters"]["tip_mass"]["methods"]["slews"]):
        assert (p["standard_error"], p["interval"]) == (None, None)
    assert said["total_inertia"]["joint"]["interval"] is None
    html = page.render(contradicted)
    identify._print(contradicted, {})
    screen = " ".join(capsys.readouterr().out.split())
    for text in (html, screen):
        assert "The recordings contradict the model: its parameters are not identified." in text
        assert "The recordings contradict each other. A model that lacks an effect" in text
        assert "twin diagnose" in text
        assert "±" not in text.partition("<footer>")[0]
        assert "strongly correlated with bending stiffness" in text
    file = tmp_path / "identified-rig.toml"
    file.write_text(rig_file.to_toml(contradicted), encoding="utf-8")
    rig, _ = read_rig_file(file)
    assert "standard_error" not in file.read_text(encoding="utf-8")
    assert "contradicts the model" in rig.parameters["length"].source
    assert rig["length"] == LENGTH.value
    assert rig.parameters["length"].uncertainty == preset("bossi2009").parameters["length"].uncertainty


def test_page_and_terminal_show_a_value_alike(contradicted, capsys):
    sure = replace(contradicted, trust=Trust(True, ""), identified={"length": LENGTH, "hub_inertia": INERTIA})
    identify._print(sure, {})
    screen = capsys.readouterr().out
    html = page.render(sure)
    for text in (html, screen):
        assert "hub inertia" in text
        assert "0.4210 ± 0.0004" in text
        assert "kg·m²" in text
    assert "twin identify rig-7" in html


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.0676576, 1.5e-5, "0.067658 (0.067628 to 0.067687)"),
        (1.2465482, 3e-6, "1.24655 (1.24654 to 1.24655)"),
        (1.2465482, 3e-8, "1.24654820 (1.24654814 to 1.24654826)"),
        (0.25, 0.01, "0.2500 (0.2304 to 0.2696)"),
    ],
)
def test_intervals_have_six_digits_at_most_unless_they_are_narrower(value, error, text):
    assert format_estimate(Estimate(value, error)) == text

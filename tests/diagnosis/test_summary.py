"""The summary of a diagnosis: what each step takes away of the error leads, noise levels come last."""

import synthetic_diagnosis as synthetic

from twin.diagnosis.answer import Contradiction
from twin.diagnosis.conclude import _summary

FOUND = synthetic.diagnosis(duration=0.4)


def summary(verdict, unexplained=(), depends=(), of=FOUND):
    return _summary(verdict, of.effects, unexplained, depends, of.predictions)


def test_the_budget_leads_and_noise_levels_come_last():
    said = summary("explained")
    assert said.startswith("On held-out recordings, in windows of 1 s, the hub angle is off by ")
    assert said.endswith(" noise levels.")
    assert "cable torsion" in said
    assert "depends" not in said


def test_outside_the_library_says_what_is_taken_away_and_what_is_left_beside_it():
    said = summary("outside-library", ["hub_torque"], ["hub_rate"])
    taken, left = said.index("is left and depends on the hub rate"), said.index(
        "Beside cable torsion, something outside the library is missing: the balance of the hub"
    )  # fmt: skip
    assert 0 < taken < left
    alone = summary("outside-library", ["hub_torque"], of=synthetic.outside(duration=0.4))
    assert " Something outside the library is missing: " in alone


def test_a_held_out_recording_that_contradicts_is_named():
    contradicted = (Contradiction("bang-bang-90.csv", "hub_angle", 30.0, 2.4, "fit"),)
    said = _summary("outside-library", FOUND.effects, (), (), FOUND.predictions, contradicted)
    assert "The held-out bang-bang-90.csv contradicts the model" in said
    assert "30 noise levels, but 1.2 at most in the fit recordings" in said

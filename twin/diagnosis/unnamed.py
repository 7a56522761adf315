"""Test for a missing torque on the hub that is a smooth function of one variable, but no effect of the library.

Such a torque may leave residuals that are small at each instant, but the same function of command, hub angle or time
in all recordings. It is a Gaussian process over the variable, whose standard deviation and length scale maximise the
marginal likelihood; the unknowns of the fit are nuisance parameters. The statistic is its log Bayes factor against no
function (evidence, see `twin.estimation.gaussian_process`). Its distribution where nothing is missing comes from the
sign-flip permutation test of `twin.diagnosis.permutation`.

Only the torque balance of the hub is tested, and the sensor of the motor torque for faults of the drive. Strains are
not: they differ by small smooth functions between simulators of the same sound rig.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.diagnosis import dependence
from twin.diagnosis.linearised import Basis, hats, knots, samples_at, tried_functions
from twin.diagnosis.state import DRIVE, FunctionOf, UnnamedFunction
from twin.estimation.fit import Fit
from twin.estimation.workbench import Workbench
from twin.recording import HUB_TORQUE
from twin.residuals import residual
from twin.residuals.data import DrivenData
from twin.residuals.filters import GRID, low_passed
from twin.residuals.prepared import Prepared
from twin.residuals.view import View
from twin.rigs.model import Model

_TORQUE, _COMMAND = "motor_torque", "torque_command"
_LAWS = (
    FunctionOf(_COMMAND, DRIVE),
    *(FunctionOf(variable) for variable in ("torque_command", "hub_angle", "hub_rate", "time")),
    *(FunctionOf(variable, sided=True) for variable in ("hub_angle", "time")),
)


def find_functions(bench: Workbench, best: Fit, rate: float) -> tuple[UnnamedFunction, ...]:
    """The smooth functions behind the torque balance of the hub, that with the largest evidence first.

    Args:
      bench: the data.
      best: the fit of the model, with its Jacobian.
      rate: false-alarm rate of the threshold `by_chance`.

    Returns:
      All functions that were tested; empty if no recording has a free hub.
    """
    data = bench.data
    assert isinstance(data, DrivenData)
    variables = {
        g.recording: dependence.motion_variables(data, best, g.recording)
        for g in data.groups
        if g.channel == HUB_TORQUE
    }
    if not variables:
        return ()
    bases = [(law, _basis(bench, best, variables, law)) for law in _LAWS]
    return tried_functions(bench, best, [(law, b) for law, b in bases if b is not None], rate)


def _basis(
    bench: Workbench, best: Fit, variables: Mapping[int, Mapping[str, np.ndarray]], law: FunctionOf
) -> Basis | None:
    """The basis of a function; None if its variable does not vary or the drive has no torque sensor.

    Args:
      bench, best: the data and the fit.
      variables: recording with a free hub -> variable -> (m) its values.
      law: what the function depends on, and where it acts.
    """
    data = bench.data
    assert isinstance(data, DrivenData)
    on_hub = [g for g in data.groups if g.channel == HUB_TORQUE]
    read = [g for g in data.groups if g.channel == _TORQUE and law.place == DRIVE]
    if law.place == DRIVE and not read:
        return None
    values = np.concatenate(
        [variables[g.recording][law.variable][g.instants][bench.weight[g.rows] > 0] for g in on_hub]
    )
    x = knots(values)
    if x is None:
        return None
    groups = sorted([*on_hub, *read], key=lambda g: g.rows.start)
    parts = [
        _on_hub(data.views[g.recording], best.model, variables[g.recording], law, x)
        if g.channel == HUB_TORQUE
        else _on_reading(data.views[g.recording], data.prepared[g.recording], best.model, x)
        for g in groups
    ]
    return Basis.of(bench, groups, parts, x, samples_at(values, x))


def _on_hub(
    view: View, model: Model, variables: Mapping[str, np.ndarray], law: FunctionOf, x: np.ndarray
) -> np.ndarray:
    """Derivative (k x r) of the whitened torque balance of one recording by the value at each knot."""
    added = hats(variables[law.variable], x)
    if law.sided:
        added *= np.sign(variables["hub_rate"])
    if law.sided or law.variable == _COMMAND:
        # In the balance, friction and drive torque pass the low-pass of the motion as well.
        added = low_passed(added, GRID, view.band)
    return -residual.scaled_change(view, model, HUB_TORQUE, low_passed(added, GRID))


def _on_reading(view: View, prepared: Prepared, model: Model, x: np.ndarray) -> np.ndarray:
    """Derivative (k x r) of the whitened residual of the motor torque sensor by the value at each knot."""
    time = prepared.recording.time
    read = hats(model.read_torque(prepared.recording), x)
    added = low_passed(np.array([np.interp(view.time, time, row) for row in read]), GRID)
    return -residual.scaled_change(view, model, _TORQUE, added)

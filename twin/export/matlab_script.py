"""The linear model as a MATLAB script that rebuilds it and simulates a step."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from twin.export.base import Exported, Exporter, RigToExport
from twin.export.linear import LinearModel
from twin.rigs.model import Model


class MatlabScript(Exporter):
    """A script with all numbers in it, for the Control System Toolbox."""

    name = "matlab"
    suffix = ".m"
    what = "MATLAB script that rebuilds the linear state space"

    def export(self, given: RigToExport) -> Exported:
        return Exported("\n".join(_lines(given.linear, given.model)) + "\n", given.linear.left_out)


def _lines(linear: LinearModel, model: Model) -> Iterable[str]:
    yield f"% {_plain(linear.title)}. SI units."
    yield f"% Not in it: {_plain(', '.join(linear.left_out))}."
    yield ""
    for name in ("A", "B", "C", "D"):
        yield from _matrix(name, getattr(linear, name))
    yield f"u0 = {linear.command!r};  % N m, command that holds the rig at rest there"
    yield from _matrix("y0", linear.readings[:, None], "readings at rest there")
    yield ""
    yield "rig = ss(A, B, C, D, ..."
    for key, names in (
        ("StateName", linear.states),
        ("InputName", linear.inputs),
        ("OutputName", linear.outputs),
    ):
        yield f"    '{key}', {_cells(names)}, ..."
    for key, units in (("InputUnit", linear.input_units), ("OutputUnit", linear.output_units)):
        yield f"    '{key}', {_cells(units)}, ..."
    delays = " ".join(repr(float(d)) for d in linear.output_delays)
    yield f"    'InputDelay', {linear.input_delay!r}, 'OutputDelay', [{delays}]');"
    yield ""
    yield from _simulation(model)


def _simulation(model: Model) -> Iterable[str]:
    friction, limit = model.plant.friction, model.declared["torque_limit"]
    yield "% A step of 0.01 N m for 1 s. Command and readings are u0 and y0 plus what goes into and comes out of rig."
    yield "t = (0:0.002:1)';"
    yield "y = y0' + lsim(rig, 0.01*ones(size(t)), t);"
    yield "plot(t, y(:, 1)), xlabel('time (s)'), ylabel('hub angle (rad)')"
    yield ""
    yield "% Dry friction is not in rig. A hub at rest breaks away where the torque on it exceeds the static level, and"
    yield "% slides against the Coulomb level; levels in N m towards positive and negative angles:"
    yield f"static_friction = [{friction.static_positive!r} {friction.static_negative!r}];"
    yield f"coulomb_friction = [{friction.coulomb_positive!r} {friction.coulomb_negative!r}];"
    yield f"torque_limit = {'Inf' if np.isinf(limit) else repr(float(limit))};  % N m"
    yield "% With friction, sticking included, simulate the same rig as an FMU: twin export RIG --out rig.fmu."


def _matrix(name: str, values: np.ndarray, comment: str = "") -> Iterable[str]:
    yield f"{name} = [" + (f"  % {comment}" if comment else "")
    for row in values:
        yield "    " + " ".join(repr(float(value)) for value in row)
    yield "];"


def _cells(texts: Iterable[str]) -> str:
    return "{" + " ".join(f"'{text}'" for text in texts) + "}"


def _plain(text: str) -> str:
    """Returns a text in ASCII on one line."""
    return "".join(c if c.isascii() and c.isprintable() else "?" for c in text)

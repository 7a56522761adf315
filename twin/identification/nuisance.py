"""Errors of a procedure by the nuisance parameters that it takes from the joint estimate.

The procedure is repeated with each nuisance parameter one standard error larger; the change of its result counts as
error, added in quadrature.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from twin.identification.joint import JointEstimate
from twin.rigs.model import Model

Result = TypeVar("Result")


def with_nuisance_errors(
    procedure: Callable[[Model], Result | None],
    widened: Callable[[Result, Result], Result],
    model: Model,
    perturbed: Sequence[Model],
) -> Result | None:
    """Returns the result of a procedure, its errors increased by those of nuisance parameters.

    Args:
      procedure: takes a model; returns None where the recordings do not allow it.
      widened: takes the result and that with one nuisance parameter perturbed, returns the result with larger errors.
      model: the identified model.
      perturbed: the model with one nuisance parameter perturbed, each in turn; those without a result are ignored.
    """
    result = procedure(model)
    if result is None:
        return None
    for other in perturbed:
        if (changed := procedure(other)) is not None:
            result = widened(result, changed)
    return result


def perturbed_models(joint: JointEstimate, model: Model, link_damping: bool = True) -> list[Model]:
    """Returns the model with one nuisance parameter one standard error larger, each in turn.

    Nuisance parameters are those of declared effects and, with `link_damping`, the damping ratio of the link.
    """
    models = []
    for name, value, error in zip(joint.names, joint.values, joint.errors, strict=True):
        effect, _, parameter = name.partition(".")
        if parameter:
            larger = {**model.effects[effect], parameter: float(value + error)}
            models.append(model.replace(effects={**model.effects, effect: larger}))
        elif link_damping and name == "damping_ratio":
            damping = min(float(value + error), model.declared.parameters[name].bounds[1])
            rig = model.declared.replace("one standard error larger", damping_ratio=damping)
            models.append(model.replace(declared=rig))
    return models

"""Orders of what repeats with the hub's angle: whole numbers, unless the recordings say otherwise.

A motor's magnets, a bearing or an encoder's disc are the same again after a turn. Where they turn at another rate than
the hub, behind a belt or a gear, an order may be any number: then the recordings have to say so.
"""

from __future__ import annotations

import numpy as np

from twin.diagnosis import candidates
from twin.effects import REGISTRY
from twin.estimation.fit import Fit
from twin.estimation.minimise import minimise
from twin.estimation.slopes import normal_equations
from twin.estimation.unknowns import Unknown
from twin.estimation.workbench import Workbench

_ITERATIONS = 5


def with_whole_orders(bench: Workbench, best: Fit) -> Fit:
    """The fit with every order at the nearest whole number that costs no more than the parameter it saves."""
    for u in best.unknowns:
        if _is_order(u):
            whole = _at_whole(bench, best, u)
            if whole.cost < best.cost + candidates.price(1, bench):
                best = whole
    return best


def _is_order(u: Unknown) -> bool:
    effect = REGISTRY.get(u.effect)
    return (
        effect is not None
        and effect.wave is not None
        and effect.wave.by_angle
        and u.name == effect.wave.order
    )


def _at_whole(bench: Workbench, best: Fit, order: Unknown) -> Fit:
    """The fit with an order at the nearest whole number, no longer among the unknowns."""
    index = best.unknowns.index(order)
    kept = [k for k in range(len(best.unknowns)) if k != index]
    unknowns = [best.unknowns[k] for k in kept]
    whole = float(np.round(best.values[index]))
    values = best.values[kept] + _moved_along(bench, best, index)[kept] * (whole - best.values[index])
    effects = {name: dict(p) for name, p in best.model.effects.items()}
    effects[order.effect][order.name] = whole
    model = best.model.replace(effects=effects)
    return minimise(bench, model, best.starts, unknowns, values, best.jacobian_columns, _ITERATIONS)


def _moved_along(bench: Workbench, best: Fit, index: int) -> np.ndarray:
    """How the likeliest values of all unknowns (p) move with that of one."""
    information, _ = normal_equations(bench, best)
    covariance = np.linalg.pinv(information, hermitian=True)
    variance = covariance[index, index]
    return covariance[:, index] / variance if variance > 0 else np.zeros(len(best.unknowns))

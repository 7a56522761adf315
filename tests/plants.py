"""Plants with mechanisms, for tests of the equations of motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from twin.effects import REGISTRY
from twin.mechanics.hub_law import HubLaw, HubTorque, as_arrays
from twin.mechanics.plant import Plant


@HubLaw
def _constant(t, theta, omega, values):
    return values[0]


BIAS = HubTorque("bias", _constant, (0.01,))
"""A constant torque of 0.01 N m on the hub."""


def torque_of(effect: str, **values: float) -> HubTorque:
    """The torque of an effect with these values, those not named neutral."""
    neutral = REGISTRY[effect].neutral({})
    found = REGISTRY[effect].hub_torque({**neutral, **values})
    assert found is not None
    return found


def changed(
    plant: Plant,
    link: Mapping[str, Any] | None = None,
    friction: Mapping[str, float] | None = None,
    motor: Mapping[str, float] | None = None,
    torques: tuple[HubTorque, ...] = (),
) -> Plant:
    """A plant with fields of its parts changed, and torques on its hub."""
    plant = plant.with_link(**link or {}).with_friction(**friction or {}).with_motor(**motor or {})
    return plant._replace(torques=as_arrays(torques))

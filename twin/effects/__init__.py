"""The library of effects: one file each, and its line in the registry.

Other packages add effects by `register`, or by an entry point of the group "twin.effects" that names an `Effect` class
or object:

    [project.entry-points."twin.effects"]
    magnetic-brake = "my_package.effects:MagneticBrake"
"""

import re
import warnings
from importlib.metadata import EntryPoint, entry_points

from twin.effects.actuator_delay import ActuatorDelay
from twin.effects.actuator_lag import ActuatorLag
from twin.effects.air_drag import AirDrag
from twin.effects.air_pad_drag import AirPadDrag
from twin.effects.asymmetric_friction import AsymmetricFriction
from twin.effects.backlash import Backlash
from twin.effects.base import TORSION, Drive, Effect, EffectParameter
from twin.effects.cable_torsion import CableTorsion
from twin.effects.cogging import Cogging
from twin.effects.dead_zone import DeadZone
from twin.effects.gravity_tilt import GravityTilt
from twin.effects.hub_sensor_gain import HubSensorGain
from twin.effects.hub_sensor_nonlinearity import HubSensorNonlinearity
from twin.effects.payload_mass import PayloadMass
from twin.effects.periodic_disturbance import PeriodicDisturbance
from twin.effects.position_dependent_friction import PositionDependentFriction
from twin.effects.root_compliance import RootCompliance
from twin.effects.sensor_delay import SensorDelay
from twin.effects.softening_stiffness import SofteningStiffness
from twin.effects.stiffness_loss import StiffnessLoss
from twin.effects.strain_drift import StrainDrift
from twin.effects.strain_gain import StrainGain
from twin.effects.stribeck_friction import StribeckFriction
from twin.effects.torque_bias import TorqueBias
from twin.effects.torque_gain import TorqueGain
from twin.effects.torsional_mode import TorsionalMode
from twin.effects.viscous_friction import ViscousFriction
from twin.errors import InputError
from twin.foreign import described, guarded
from twin.mechanics.hub_law import HubLaw

_BUILT_IN: tuple[Effect, ...] = (
    ViscousFriction(),
    StribeckFriction(),
    AsymmetricFriction(),
    PositionDependentFriction(),
    CableTorsion(),
    Cogging(),
    TorqueGain(),
    DeadZone(),
    TorqueBias(),
    ActuatorLag(),
    ActuatorDelay(),
    Backlash(),
    GravityTilt(),
    PeriodicDisturbance(),
    PayloadMass(),
    StiffnessLoss(),
    SofteningStiffness(),
    TorsionalMode(),
    RootCompliance(),
    AirDrag(),
    AirPadDrag(),
    HubSensorGain(),
    HubSensorNonlinearity(),
    StrainGain(),
    StrainDrift(),
    SensorDelay(),
)

REGISTRY: dict[str, Effect] = {}
"""Name -> effect, in the order in which a search tries them."""

ENTRY_POINTS = "twin.effects"
"""Group of entry points whose effects are registered on import of this package."""

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")


def register(effect: Effect) -> Effect:
    """Adds an effect to the registry; returns it.

    Raises:
      ValueError: the object is no `Effect`, its name is taken or not of the form "cable-torsion", or its `meaning`,
        `acts_on` or `parameters` are missing.
    """
    name = getattr(effect, "name", None)
    if not isinstance(effect, Effect):
        raise ValueError(f"{effect!r} is no effect; expected an object of a subclass of twin.effects.Effect")
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise ValueError(
            f"{type(effect).__name__}.name is {name!r}; expected lower case and hyphens, as 'air-drag'"
        )
    if name in REGISTRY:
        raise ValueError(
            f"the name '{name}' is taken by {type(REGISTRY[name]).__qualname__}; expected another one"
        )
    for attribute in ("meaning", "acts_on", "parameters"):
        if not getattr(effect, attribute, None):
            raise ValueError(f"{type(effect).__name__} has no '{attribute}'; see twin.effects.Effect")
    REGISTRY[name] = effect
    return effect


def unregister(name: str) -> None:
    """Removes an effect from the registry: for tests, and for a search without it.

    Raises:
      KeyError: no effect has this name.
    """
    del REGISTRY[name]


def all_on_import() -> bool:
    """Whether another process that imports this package knows every effect that is registered here."""
    return all(_ON_IMPORT.get(name) is effect for name, effect in REGISTRY.items())


def meaning(name: str) -> str:
    """`Effect.meaning` by name; "" for a name that is not in the registry."""
    return REGISTRY[name].meaning if name in REGISTRY else ""


def _register_all() -> None:
    for effect in _BUILT_IN:
        register(effect)
    for point in entry_points(group=ENTRY_POINTS):
        try:
            _register_point(point)
        except InputError as error:
            # A faulty effect of another package must not stop this one.
            warnings.warn(str(error), stacklevel=2)


def _register_point(point: EntryPoint) -> None:
    """Registers the effect of another package.

    Raises:
      InputError: its code fails, or it is no effect.
    """
    package = f" of the package {point.dist.name}" if point.dist is not None else ""
    where = f"effect '{point.name}'{package} ({point.value}) was not registered"
    with guarded(lambda error: InputError(f"{where}: {described(error)}")):
        loaded = point.load()
        register(loaded() if isinstance(loaded, type) else loaded)


_register_all()
_ON_IMPORT = dict(REGISTRY)

__all__ = [
    "REGISTRY",
    "TORSION",
    "Drive",
    "Effect",
    "EffectParameter",
    "HubLaw",
    "all_on_import",
    "meaning",
    "register",
    "unregister",
]

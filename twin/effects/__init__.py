"""The vocabulary of missing effects: one file each, and its line in the registry."""

from twin.effects.actuator_delay import ActuatorDelay
from twin.effects.air_drag import AirDrag
from twin.effects.asymmetric_friction import AsymmetricFriction
from twin.effects.base import Drive, Effect, EffectParameter
from twin.effects.cable_torsion import CableTorsion
from twin.effects.hub_sensor_gain import HubSensorGain
from twin.effects.payload_mass import PayloadMass
from twin.effects.stiffness_loss import StiffnessLoss
from twin.effects.strain_gain import StrainGain
from twin.effects.torque_bias import TorqueBias
from twin.effects.torque_gain import TorqueGain
from twin.effects.viscous_friction import ViscousFriction

REGISTRY: dict[str, Effect] = {
    effect.name: effect
    for effect in (
        ViscousFriction(),
        AsymmetricFriction(),
        CableTorsion(),
        TorqueBias(),
        TorqueGain(),
        ActuatorDelay(),
        PayloadMass(),
        StiffnessLoss(),
        AirDrag(),
        HubSensorGain(),
        StrainGain(),
    )
}

__all__ = ["REGISTRY", "Drive", "Effect", "EffectParameter"]

"""The vocabulary of missing effects: one file each, and its line in the registry."""

from twin.effects.actuator_delay import ActuatorDelay
from twin.effects.actuator_lag import ActuatorLag
from twin.effects.air_drag import AirDrag
from twin.effects.air_pad_drag import AirPadDrag
from twin.effects.asymmetric_friction import AsymmetricFriction
from twin.effects.backlash import Backlash
from twin.effects.base import TORSION, Drive, Effect, EffectParameter
from twin.effects.cable_torsion import CableTorsion
from twin.effects.cogging import Cogging
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

REGISTRY: dict[str, Effect] = {
    effect.name: effect
    for effect in (
        ViscousFriction(),
        StribeckFriction(),
        AsymmetricFriction(),
        PositionDependentFriction(),
        CableTorsion(),
        Cogging(),
        TorqueGain(),
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
}

__all__ = ["REGISTRY", "TORSION", "Drive", "Effect", "EffectParameter"]

"""Cogging torque of a permanent-magnet motor."""

import math

from twin.effects.base import ANGLES, ORDERS, TORQUES, Effect, EffectParameter
from twin.effects.wave import Wave
from twin.mechanics.hub_law import HubLaw


@HubLaw
def torque(t, theta, omega, values):
    """amplitude sin(order theta + phase)."""
    return values[0] * math.sin(values[1] * theta + values[2])


class Cogging(Effect):
    """Torque amplitude sin(order theta + phase) on the hub; with backlash, on the motor.

    The order is the number of periods a turn, the least common multiple of the numbers of poles and slots. Poles come
    in pairs, so it is at least 2; with a lower one it could not be distinguished from a spring.
    """

    name = "cogging"
    meaning = "a torque of the motor's magnets, periodic in the angle"
    acts_on = "drive"
    seen_as = (
        "At low speed the hub advances in jerks, and rests at preferred angles. The missing torque is a wave over the "
        "hub angle that does not depend on the rate."
    )
    mistaken_for = {
        "hub-sensor-nonlinearity": "a sensor's error has no torque: the gauges and the motor current do not show it",
    }
    source = "J. R. Hendershot and T. J. E. Miller, Design of Brushless Permanent-Magnet Motors, 1994"
    parameters = (
        EffectParameter("amplitude", "N*m", 0.0, (0.0, 1.0), 1e-3, possible=TORQUES),
        EffectParameter("order", "1", 2.0, (1.9, 80.0), 0.02, possible=ORDERS),
        EffectParameter("phase", "rad", 0.0, (-20.0, 20.0), 0.1, possible=ANGLES),
    )
    hub_law = torque
    on_motor = True
    undefined_at_neutral = ("order", "phase")
    wave = Wave("torque", "order")

    def write_mjcf(self, spec, joint, p):
        from twin.mechanics.mjcf import add_sinusoid

        add_sinusoid(spec, joint, self.name, p["amplitude"], p["order"], p["phase"])

"""Magnets of the motor that pull it to their own positions."""

from twin.effects.base import Effect, EffectParameter
from twin.effects.wave import Wave


class Cogging(Effect):
    """Torque amplitude sin(order theta + phase) on the hub.

    Its periods in a turn are the least common multiple of the numbers of poles and slots, and poles come in pairs:
    two at least, by which it differs from a spring.
    """

    name = "cogging"
    parameters = (
        EffectParameter("amplitude", "N*m", 0.0, (0.0, 1.0), 1e-3),
        EffectParameter("order", "1", 2.0, (1.9, 80.0), 0.02),
        EffectParameter("phase", "rad", 0.0, (-20.0, 20.0), 0.1),
    )
    along = ("order", "phase")
    wave = Wave("torque", "order")

    def plant(self, plant, p):
        return plant._replace(
            cogging_amplitude=p["amplitude"], cogging_order=p["order"], cogging_phase=p["phase"]
        )

"""A disturbance of one frequency: a fan, a pump, a mains hum in the amplifier."""

from twin.effects.base import Effect, EffectParameter
from twin.effects.wave import Wave


class PeriodicDisturbance(Effect):
    """Torque amplitude sin(2 pi frequency t + phase) on the hub, t from the start of each recording."""

    name = "periodic-disturbance"
    parameters = (
        EffectParameter("frequency", "Hz", 1.0, (0.05, 60.0), 0.002),
        EffectParameter("amplitude", "N*m", 0.0, (0.0, 1.0), 1e-3),
        EffectParameter("phase", "rad", 0.0, (-20.0, 20.0), 0.1),
    )
    along = ("frequency", "phase")
    wave = Wave("time", "frequency")

    def plant(self, plant, p):
        return plant._replace(
            disturbance_amplitude=p["amplitude"],
            disturbance_frequency=p["frequency"],
            disturbance_phase=p["phase"],
        )

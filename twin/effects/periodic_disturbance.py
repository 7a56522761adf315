"""A sinusoidal disturbance: a fan, a pump, mains hum in the amplifier, a vibrating table."""

import math

import numpy as np

from twin.effects.base import ANGLES, TORQUES, Effect, EffectParameter
from twin.effects.wave import Wave
from twin.mechanics.hub_law import HubLaw


@HubLaw
def torque(t, theta, omega, values):
    """amplitude sin(2 pi frequency t + phase)."""
    return values[1] * math.sin(2 * math.pi * values[0] * t + values[2])


class PeriodicDisturbance(Effect):
    """Torque amplitude sin(2 pi frequency t + phase) on the hub; with base = 1, acceleration of the base.

    t counts from the start of each recording. The base accelerates along the angle `direction` fixed in the plane;
    in the frame of the base this is a field of the opposite sign on all masses of link and payload. `amplitude` is
    then in m/s^2.
    """

    name = "periodic-disturbance"
    meaning = "a sinusoidal disturbance of one frequency"
    acts_on = "hub"
    seen_as = (
        "Gauges and hub vibrate at one frequency even when nothing is commanded. The residual has one line in its "
        "spectrum, the same in all recordings."
    )
    mistaken_for = {
        "torsional-mode": "a mode fades when it is no longer excited, a disturbance does not",
        "cogging": "cogging has a period in the angle, a disturbance in time",
    }
    source = "a definition; fans, pumps, mains hum"
    parameters = (
        EffectParameter("frequency", "Hz", 1.0, (0.05, 60.0), 0.002, possible=(1e-3, 1e3)),
        EffectParameter("amplitude", "N*m", 0.0, (0.0, 20.0), 1e-3, possible=TORQUES),
        EffectParameter("phase", "rad", 0.0, (-20.0, 20.0), 0.1, possible=ANGLES),
        EffectParameter("base", "1", 0.0, (0.0, 1.0), 1.0, choice=True),
        EffectParameter("direction", "rad", 0.0, (-20.0, 20.0), 0.1, possible=ANGLES),
    )
    hub_law = torque
    mjcf_is_exact = False
    undefined_at_neutral = ("frequency", "phase", "base", "direction")
    wave = Wave("time", "frequency")

    def free_parameters(self, values):
        return tuple(p for p in super().free_parameters(values) if values["base"] or p.name != "direction")

    def units(self, values):
        return {**super().units(values), "amplitude": "m/s^2" if values["base"] else "N*m"}

    def wave_parameters(self, order, coefficients):
        if len(coefficients) == 2:
            return {**super().wave_parameters(order, coefficients), "base": 0.0, "direction": 0.0}
        # The best approximation of the (axis x sine, cosine) coefficients by an oscillation along one line: rank 1.
        axes, sizes, parts = np.linalg.svd(np.reshape(coefficients, (2, 2)))
        sign = -1.0 if axes[0, 0] < 0 else 1.0
        line, (sine, cosine) = sign * axes[:, 0], sign * parts[0]
        return {
            "amplitude": float(sizes[0]),
            "frequency": order,
            "phase": math.atan2(cosine, sine),
            "base": 1.0,
            "direction": math.atan2(line[1], line[0]),
        }

    def plant(self, plant, p):
        if p["base"]:
            return plant.with_link(
                shake_x=p["amplitude"] * math.cos(p["direction"]),
                shake_y=p["amplitude"] * math.sin(p["direction"]),
                shake_frequency=p["frequency"],
                shake_phase=p["phase"],
            )
        return plant

    def hub_torque(self, p):
        return None if p["base"] else super().hub_torque(p)

    def write_mjcf(self, spec, joint, p):
        from twin.mechanics.mjcf import add_time_sinusoid

        add_time_sinusoid(spec, p["frequency"], p["amplitude"], p["phase"])

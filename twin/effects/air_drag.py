"""Quadratic air drag on the tip."""

from twin.effects.base import DRAG, Effect, EffectParameter


class AirDrag(Effect):
    """Force -coefficient |v| v on the tip, v its velocity: turbulent drag."""

    name = "air-drag"
    meaning = "drag on the tip, proportional to the square of its speed"
    acts_on = "payload"
    seen_as = (
        "Large, fast vibrations decay faster than small ones; after fast slews the link swings less. The missing force "
        "grows with the square of the tip's speed."
    )
    mistaken_for = {
        "air-pad-drag": "the decay of a large vibration: linear drag keeps the same damping ratio at every amplitude",
    }
    source = "G. K. Batchelor, An Introduction to Fluid Dynamics, 1967"
    parameters = (EffectParameter("coefficient", "N*s^2/m^2", 0.0, (0.0, 10.0), 2e-3, possible=DRAG),)

    def plant(self, plant, p):
        return plant.with_link(drag_quadratic=p["coefficient"])

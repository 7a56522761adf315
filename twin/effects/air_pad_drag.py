"""Linear drag on the tip, as an air-pad causes it."""

from twin.effects.base import DRAG, Effect, EffectParameter


class AirPadDrag(Effect):
    """Force -viscous v on the tip, v its velocity: an air film in shear."""

    name = "air-pad-drag"
    meaning = "drag on the tip, proportional to its speed"
    acts_on = "payload"
    seen_as = "Vibrations decay faster, large and small ones alike; a steady turn bends the link against the motion."
    mistaken_for = {
        "viscous-friction": "with the hub locked only the drag at the tip acts",
    }
    source = "G. K. Batchelor, An Introduction to Fluid Dynamics, 1967"
    parameters = (EffectParameter("viscous", "N*s/m", 0.0, (0.0, 10.0), 1e-3, possible=DRAG),)

    def plant(self, plant, p):
        return plant.with_link(drag_linear=p["viscous"])

"""Linear drag on the tip, as an air-pad causes it."""

from twin.effects.base import DRAG, Effect, EffectParameter


class AirPadDrag(Effect):
    """Force -viscous v on the tip, v its velocity: an air film in shear."""

    name = "air-pad-drag"
    meaning = "drag on the tip, proportional to its speed"
    acts_on = "payload"
    parameters = (EffectParameter("viscous", "N*s/m", 0.0, (0.0, 10.0), 1e-3, possible=DRAG),)

    def plant(self, plant, p):
        return plant.with_link(drag_linear=p["viscous"])

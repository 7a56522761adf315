"""Add an effect of your own: one class, registered, and the search tries it like any other.

Here an eddy-current brake on the hub: a conducting disc in the field of a magnet brakes in proportion to its rate at
low rates, and less beyond a critical one (W. R. Smythe, "On eddy currents in a rotating disk", Trans. AIEE 61, 1942).
"""

import twin
from twin.effects import Effect, EffectParameter, HubLaw, register


@HubLaw
def brake(t, theta, omega, values):
    """Torque [N·m] at a time [s], hub angle [rad] and rate [rad/s]; `values` in the order of the parameters."""
    return -values[0] * omega / (1 + (omega / values[1]) ** 2)


class EddyBrake(Effect):
    """Torque -damping omega / (1 + (omega/critical)^2) on the hub."""

    name = "eddy-brake"
    meaning = "an eddy-current brake, which brakes less beyond a critical rate"
    acts_on = "hub"
    parameters = (
        EffectParameter("damping", "N*m*s/rad", 0.0, (0.0, 1.0), 1e-4),
        EffectParameter("critical", "rad/s", 5.0, (0.5, 100.0), 0.1),
    )
    undefined_at_neutral = ("critical",)
    hub_law = brake


def main() -> dict[str, float]:
    """Registers the brake and shows what it does to the regulator's step; returns where the hub ends [deg]."""
    if EddyBrake.name not in twin.effects.REGISTRY:
        register(EddyBrake())
    braked = {"eddy-brake": {"damping": 0.01, "critical": 3.0}}
    runs = {"without": twin.run("lq-step-120"), "with the brake": twin.run("lq-step-120", effects=braked)}
    for name, run in runs.items():
        print(f"{name:<15} ends at {run.metrics['hub_final_deg']:.1f} degrees")
    return {name: run.metrics["hub_final_deg"] for name, run in runs.items()}


if __name__ == "__main__":
    main()

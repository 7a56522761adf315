"""Plants: what a controller acts on. `make_plant` builds one for a rig by its name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from twin.control.plants.base import PERIOD, READINGS, Plant
from twin.errors import InputError, nearest

if TYPE_CHECKING:
    from twin.parameters import Rig
    from twin.rigs.model import Model
    from twin.rigs.patch import Patch

KINDS: Mapping[str, str] = {
    "chain": "chain",
    "modal": "modal model",
    "compiled": "compiled chain",
    "paper": "paper's own model",
}
"""Plants by name: MuJoCo's chain, n modes, the chain in compiled equations, and the paper's model as it stands."""

Effects = Mapping[str, Mapping[str, float]]


def make_plant(
    kind: str,
    rig: Rig | None = None,
    effects: Effects | None = None,
    period: float = PERIOD,
    segments: int = 8,
    patch: Patch | None = None,
) -> Plant:
    """Returns a plant.

    Args:
      kind: one of `KINDS`.
      rig: by default `bossi2009`.
      effects: effects that act: name -> parameter -> value (SI); what is not said of one is neutral.
      period: sample period [s].
      segments: of the chain.
      patch: a correction without a cause, looked up; None for none.

    Raises:
      InputError: there is no such plant, or it cannot have these effects.
    """
    if kind not in KINDS:
        raise InputError(
            f"'{kind}' is not a plant; expected one of: {', '.join(KINDS)}{nearest(kind, KINDS)}"
        )
    if patch is not None:
        _check_readings(patch)
    model = make_model(rig, effects, segments, patch)
    if kind == "modal":
        from twin.control.plants.modal import ModalPlant

        return ModalPlant(model, period)
    if kind == "paper":
        from twin.control.plants.paper import PaperPlant

        return PaperPlant(model, period)
    from twin.control.plants.chain import ChainPlant, CompiledPlant

    return ChainPlant(model, period) if kind == "chain" else CompiledPlant(model, period)


def _check_readings(patch: Patch) -> None:
    """Makes sure that a plant has the readings of a patch: other channels are those of recordings alone.

    Raises:
      InputError: it has not.
    """
    for asked in (patch.channel, patch.variable) if patch.on_sensor else ():
        if asked not in (*READINGS, "time"):
            raise InputError(
                f"the patch of {patch.channel} by {patch.variable} has no place in a plant, which does not read "
                f"{asked}; expected a patch of the hub's torque, or of: {', '.join(READINGS)}"
            )


def make_model(
    rig: Rig | None = None,
    effects: Effects | None = None,
    segments: int = 8,
    patch: Patch | None = None,
) -> Model:
    """Returns the twin of a rig with effects and a patch, its strain bridges where `models/` has them.

    Raises:
      InputError: an effect or a parameter of one is not known, or is no finite number.
    """
    from twin.mechanics import chain
    from twin.recording import GAUGES
    from twin.rigs import preset
    from twin.rigs.model import Model
    from twin.rigs.rig_file import checked_effects

    rig = rig if rig is not None else preset("bossi2009")
    acting = checked_effects(effects or {}, rig)
    gauges = {gauge.channel: gauge for gauge in GAUGES}
    return Model(rig, gauges, chain.fit_shape(rig, segments), acting, patch=patch)

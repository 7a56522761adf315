"""Plants, the simulated rigs on which controllers act: `make_plant` builds one by its name.

    chain      MuJoCo's chain of segments, the reference                        `chain.ChainPlant`
    compiled   the same chain in compiled equations of motion, for many runs    `chain.CompiledPlant`
    modal      n exact modes, linear but for friction and saturation            `modal.ModalPlant`
    paper      the paper's own model: one mode, its own friction law            `paper.PaperPlant`

All have the interface `base.Plant`: a plant keeps its state and is advanced by one sample period under a held torque.
`drive` turns commands into delivered torques, `sensors` and `sensor_effects` true values into readings.
"""

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
"""Name of each plant -> what people call it."""

Effects = Mapping[str, Mapping[str, float]]
"""Effect name -> parameter name -> value, SI."""


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
      effects: name -> parameter -> value (SI); parameters that are not given are neutral.
      period: sample period [s].
      segments: number of hinges of the chain.
      patch: empirical lookup table; None for none.

    Raises:
      InputError: there is no such plant, or it does not support one of the effects, or the patch.
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
    """Makes sure that a plant has the channels of a patch; some exist in recordings only.

    Raises:
      InputError: it lacks one.
    """
    for channel in (patch.channel, patch.variable) if patch.on_sensor else ():
        if channel not in (*READINGS, "time"):
            raise InputError(
                f"the patch of {patch.channel} by {patch.variable} has no place in a plant, which does not read "
                f"{channel}; expected a patch of the hub's torque, or of: {', '.join(READINGS)}"
            )


def make_model(
    rig: Rig | None = None,
    effects: Effects | None = None,
    segments: int = 8,
    patch: Patch | None = None,
) -> Model:
    """Returns the model of a rig with effects and a patch, with the strain gauges of `models/`, see `gauges_on`.

    Raises:
      InputError: an effect or a parameter of one is not known, or no such rig can be simulated.
    """
    from twin.mechanics import chain
    from twin.recording import gauges_on
    from twin.rigs import preset
    from twin.rigs.model import Model, checked_model
    from twin.rigs.rig_file import checked_effects

    rig = rig if rig is not None else preset("bossi2009")
    acting = checked_effects(effects or {}, rig)
    gauges = gauges_on(rig["length"])
    return checked_model(Model(rig, gauges, chain.fit_shape(rig, segments), acting, patch=patch))

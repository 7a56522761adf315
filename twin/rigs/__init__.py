"""A rig with its effects as a model, a parameter file and MJCF; published rigs by name (`PRESETS`)."""

from twin.errors import InputError, nearest
from twin.parameters import Rig
from twin.rigs import bossi2009

PRESETS = {"bossi2009": bossi2009.reconciled, "bossi2009-printed": bossi2009.printed}


def preset(name: str) -> Rig:
    """Returns the published rig called `name`.

    Raises:
      InputError: no preset has this name.
    """
    if name not in PRESETS:
        known = ", ".join(PRESETS)
        raise InputError(f"'{name}' is not a preset; expected one of: {known}{nearest(name, PRESETS)}")
    return PRESETS[name]()

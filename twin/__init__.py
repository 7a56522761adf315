"""A MuJoCo digital twin of a planar flexible manipulator that finds which physical effect its model lacks.

    import twin

    diagnosis = twin.diagnose("my-rig")
    print(diagnosis.summary)
    diagnosis.plot().show()
    diagnosis.save("my-rig-diagnosis")

Every name is imported when it is first used, so that `import twin` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin import effects as effects
    from twin.api.answers import Diagnosis, Identification, Run
    from twin.api.functions import (
        diagnose,
        diagnose_fleet,
        identify,
        load,
        plan_experiment,
        run,
        state_space,
        validate,
    )
    from twin.api.inputs import RigFile, read_campaign, read_rig, rig
    from twin.api.simulation import RigModel, model
    from twin.api.table import Table
    from twin.campaigns.campaign import Campaign
    from twin.errors import InputError
    from twin.parameters import Rig
    from twin.recording import Recording

    __version__: str

_HOMES = {
    "twin.api.answers": ("Diagnosis", "Identification", "Run"),
    "twin.api.functions": (
        "diagnose",
        "diagnose_fleet",
        "identify",
        "load",
        "plan_experiment",
        "run",
        "state_space",
        "validate",
    ),
    "twin.api.inputs": ("RigFile", "read_campaign", "read_rig", "rig"),
    "twin.api.simulation": ("RigModel", "model"),
    "twin.campaigns.campaign": ("Campaign",),
    "twin.errors": ("InputError",),
    "twin.parameters": ("Rig",),
    "twin.recording": ("Recording",),
    "twin.api.table": ("Table",),
}
"""Module -> the public names that it has."""

__all__ = [
    "Campaign",
    "Diagnosis",
    "Identification",
    "InputError",
    "Recording",
    "Rig",
    "RigFile",
    "RigModel",
    "Run",
    "Table",
    "__version__",
    "diagnose",
    "diagnose_fleet",
    "effects",
    "identify",
    "load",
    "model",
    "plan_experiment",
    "read_campaign",
    "read_rig",
    "rig",
    "run",
    "state_space",
    "validate",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("flexlink-twin")
    if name == "effects":
        return import_module("twin.effects")
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(home), name)
    raise AttributeError(f"module 'twin' has no attribute '{name}'; see dir(twin)")


def __dir__() -> list[str]:
    return sorted(__all__)

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
    from twin.api import (
        Diagnosis,
        Identification,
        RigFile,
        RigModel,
        Run,
        diagnose,
        identify,
        load,
        model,
        plan_experiment,
        read_campaign,
        read_rig,
        rig,
        run,
        state_space,
        validate,
    )
    from twin.campaigns.campaign import Campaign
    from twin.errors import InputError
    from twin.parameters import Rig
    from twin.recording import Recording
    from twin.table import Table

    __version__: str

_HOMES = {
    "Campaign": "twin.campaigns.campaign",
    "InputError": "twin.errors",
    "Recording": "twin.recording",
    "Rig": "twin.parameters",
    "Table": "twin.table",
}
"""Public name -> the module that has it, where that is not `twin.api`."""

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
    if name in __all__:
        return getattr(import_module(_HOMES.get(name, "twin.api")), name)
    raise AttributeError(f"module 'twin' has no attribute '{name}'; see dir(twin)")


def __dir__() -> list[str]:
    return sorted(__all__)

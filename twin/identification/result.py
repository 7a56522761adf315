"""The result of an identification, and its JSON interface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from twin.files.provenance import Provenance
from twin.identification import as_json
from twin.identification.derived import DerivedQuantities
from twin.identification.estimates import Finding, Identified, Mode, mode_json, parameter_json
from twin.identification.held_out import HeldOutError
from twin.identification.procedures import Procedures
from twin.identification.trust import Trust
from twin.parameters import Rig


@dataclass(frozen=True)
class Identification:
    """An identified rig; `to_json` is its interface for programs.

    Attributes:
      campaign: name of the campaign.
      rig: as declared.
      procedures: results of every procedure.
      identified: final estimates, of the rig by name, of declared effects by effect.parameter.
      not_determined: parameter -> reason, where the recordings do not determine it.
      modes: modes of vibration found in the recordings.
      derived: quantities of the whole rig by the joint estimate.
      findings: result of each procedure in sentences, or which data it lacks.
      held_out: prediction errors on held-out recordings, which are simulated once, at the end.
      trust: whether the recordings contradict the model; if they do, all intervals are withheld.
      notes: defects of the recordings, and assumptions about them.
      wall_s: computation time [s].
      provenance: what it was computed with and from, or None if that was not recorded.
    """

    campaign: str
    rig: Rig
    procedures: Procedures
    identified: Mapping[str, Identified]
    not_determined: Mapping[str, str]
    modes: tuple[Mode, ...]
    derived: DerivedQuantities
    findings: tuple[Finding, ...]
    held_out: tuple[HeldOutError, ...]
    trust: Trust
    notes: tuple[str, ...]
    wall_s: float
    provenance: Provenance | None = None

    @property
    def parameters(self) -> dict[str, Identified]:
        """Parameters of the rig."""
        return {name: p for name, p in self.identified.items() if name in self.rig}

    @property
    def effects(self) -> dict[str, Identified]:
        """Parameters of the declared effects, by effect.parameter."""
        return {name: p for name, p in self.identified.items() if name not in self.rig}

    @property
    def all_parameters(self) -> dict[str, Identified]:
        """Parameters of the rig, then those of the effects."""
        return {**self.parameters, **self.effects}

    def to_json(self) -> dict[str, Any]:
        """Returns the result as plain values."""
        r = self.procedures
        total_inertia = self.derived.total_inertia.estimate
        return {
            "campaign": self.campaign,
            "trusted": self.trust.trusted,
            "reason": self.trust.reason,
            "parameters": {name: parameter_json(p) for name, p in self.parameters.items()},
            "effects": {name: parameter_json(p) for name, p in self.effects.items()},
            "modes": [mode_json(mode) for mode in self.modes],
            "not_determined": dict(self.not_determined),
            "findings": [
                {"procedure": f.procedure, "sentences": list(f.sentences), "missing": f.missing}
                for f in self.findings
            ],
            **({} if r.comparison is None else {"against": r.comparison.to_json()}),
            "total_inertia": as_json.total_inertia(r.momentum, total_inertia),
            "backbone": None if r.backbone is None else as_json.backbone(r.backbone),
            "friction_map": None if r.friction_map is None else as_json.friction_map(r.friction_map),
            "loss_laws": [as_json.loss_law(d) for d in r.decays],
            "levels": as_json.levels(r.static_friction, r.hub_balance),
            "correlations": as_json.correlations(r.joint, self.trust.trusted),
            "held_out": [asdict(error) for error in self.held_out],
            "notes": list(self.notes),
            "wall_s": self.wall_s,
            "provenance": None if self.provenance is None else self.provenance.to_json(),
        }

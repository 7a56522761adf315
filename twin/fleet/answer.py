"""The answer over a fleet: of each rig its diagnosis and what changed, or why it has none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeAlias

from twin.files.provenance import Provenance
from twin.fleet.changes import Change, changes
from twin.fleet.stored import StoredAnswer
from twin.report.deliver import FILES


@dataclass(frozen=True)
class RigAnswer:
    """The diagnosis of a rig.

    Attributes:
      rig: its name, by `campaign.toml`.
      campaign: the folder that was diagnosed.
      folder: of the results.
      answer: the diagnosis.
      previous: that of the campaign before, or None.
      reused: whether it was there already.
    """

    rig: str
    campaign: Path
    folder: Path
    answer: StoredAnswer
    previous: StoredAnswer | None = None
    reused: bool = False

    @property
    def changes(self) -> tuple[Change, ...]:
        """What changed since the campaign before; empty without one."""
        return () if self.previous is None else changes(self.previous, self.answer)

    def to_json(self) -> dict[str, Any]:
        """The result as plain values."""
        a = self.answer
        return {
            "rig": self.rig,
            "campaign": str(self.campaign),
            "error": None,
            "verdict": a.verdict,
            "effects": [e.model_dump() | {"not_told_from": a.rivals(e.name)} for e in a.effects],
            "depends_on": list(a.depends_on),
            "next_experiment": a.next_experiment,
            "date": a.provenance.date,
            "previous_date": None if self.previous is None else self.previous.provenance.date,
            "changes": None if self.previous is None else [asdict(c) for c in self.changes],
            "reused": self.reused,
            "wall_s": a.wall_s,
            "report": str(self.folder / FILES["report"]),
        }


@dataclass(frozen=True)
class RigFailure:
    """A rig without a diagnosis.

    Attributes:
      rig: its name, or where that could not be read, that of its folder.
      campaign: the folder.
      error: why.
    """

    rig: str
    campaign: Path
    error: str

    def to_json(self) -> dict[str, Any]:
        """The result as plain values."""
        return {"rig": self.rig, "campaign": str(self.campaign), "error": self.error}


RigResult: TypeAlias = RigAnswer | RigFailure


@dataclass(frozen=True)
class Fleet:
    """The results of all rigs.

    Attributes:
      rigs: in the order in which their campaigns were given.
      provenance: what the answer over all of them was computed with; each rig has one of its own.
    """

    rigs: tuple[RigResult, ...]
    provenance: Provenance

    @property
    def answers(self) -> tuple[RigAnswer, ...]:
        """The rigs that were diagnosed."""
        return tuple(r for r in self.rigs if isinstance(r, RigAnswer))

    @property
    def failures(self) -> tuple[RigFailure, ...]:
        """The rigs that were not."""
        return tuple(r for r in self.rigs if isinstance(r, RigFailure))

    @property
    def effects(self) -> Mapping[str, tuple[str, ...]]:
        """Effect -> the rigs that lack it, the most frequent effect first."""
        found: dict[str, list[str]] = {}
        for rig in self.answers:
            for effect in rig.answer.effects:
                found.setdefault(effect.name, []).append(rig.rig)
        return {name: tuple(rigs) for name, rigs in sorted(found.items(), key=lambda e: -len(e[1]))}

    def to_json(self) -> dict[str, Any]:
        """The answer as plain values."""
        return {
            "rigs": [r.to_json() for r in self.rigs],
            "effects": {name: list(rigs) for name, rigs in self.effects.items()},
            "failed": len(self.failures),
            "provenance": self.provenance.to_json(),
        }

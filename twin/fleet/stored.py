"""The answer of a diagnosis as its JSON file has it: what a fleet shows of a rig, and compares."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from twin.diagnosis.answer import Verdict
from twin.errors import InputError
from twin.files.text import read_text

_LARGEST = 10_000_000  # bytes; that of a long diagnosis has some hundred thousand


class _Stored(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")


class StoredEffect(_Stored):
    """An adopted effect, see `twin.diagnosis.answer.AdoptedEffect`; what is not known is None."""

    name: str
    probability: float | None
    parameters: Mapping[str, float | None]
    standard_errors: Mapping[str, float | None]


class StoredParameter(_Stored):
    """A calibrated parameter, see `twin.diagnosis.answer.Calibrated`."""

    fitted: float | None
    standard_error: float | None


class StoredRecord(_Stored):
    """What it was computed with and from, see `twin.files.provenance.Provenance`."""

    version: str
    date: str
    inputs: Mapping[str, str]


class StoredAnswer(_Stored):
    """An answer, see `twin.diagnosis.answer.Diagnosis`."""

    verdict: Verdict
    effects: tuple[StoredEffect, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    depends_on: tuple[str, ...]
    next_experiment: str | None
    calibrated: Mapping[str, StoredParameter]
    false_alarm_rate: float | None
    wall_s: float
    provenance: StoredRecord

    def rivals(self, effect: str) -> list[str]:
        """The effects that the recordings cannot tell from an adopted one, without other adopted ones."""
        adopted = {e.name for e in self.effects}
        sets = [names for names in self.indistinguishable if effect in names]
        return list(dict.fromkeys(other for names in sets for other in names if other not in adopted))


def parsed(text: str | bytes) -> StoredAnswer | None:
    """Returns the answer in a JSON text; None where there is none, as of an earlier version."""
    try:
        return StoredAnswer.model_validate_json(text)
    except ValidationError:
        return None


def read(file: Path) -> tuple[str, StoredAnswer] | None:
    """Returns text and answer of a JSON file; None where it has none."""
    try:
        text = read_text(file, str(file), _LARGEST)
    except InputError:
        return None
    answer = parsed(text)
    return None if answer is None else (text, answer)


def known(value: float | None) -> float:
    """Returns a number; NaN for None, as which JSON has it."""
    return math.nan if value is None else value

"""Sentences for people: identifiers of effects, channels and parameters in words."""

from __future__ import annotations

import re

from twin import labels
from twin.effects import REGISTRY
from twin.parameters import PARAMETERS
from twin.recording import HUB_TORQUE

# Not a part of a path or of the name of a file, such as "hub_angle.csv" or "runs/cable-torsion".
_IDENTIFIER = re.compile(r"(?<![\w./-])[a-z][a-z0-9]*(?:[-_][a-z0-9]+)+(?![\w/-]|\.\w)")
_POWER = re.compile(r"(?<=[A-Za-z])\^([234])(?![\d.])")
_MINUS = re.compile(r"(?<=[\s(\[=])-(?=\d)")
_RAISED = {"2": "²", "3": "³", "4": "⁴"}


def prose(text: str) -> str:
    """Returns a text with the identifiers that the package knows in words, powers and minus signs typeset."""
    said = _IDENTIFIER.sub(lambda found: _in_words(found.group()), text)
    return _MINUS.sub("−", _POWER.sub(lambda found: _RAISED[found.group(1)], said))


def _in_words(name: str) -> str:
    known = {
        name for effect in REGISTRY.values() for name in (effect.name, *(p.name for p in effect.parameters))
    }
    if name in labels.CHANNELS or name in labels.VARIABLES:
        return labels.variable(name).label
    return labels.words(name) if name in known or name in PARAMETERS or name == HUB_TORQUE else name

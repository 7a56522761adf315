"""What the functions of the interface take: campaigns, rigs and effects, as files or as values."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import NamedTuple, TypeAlias

from twin.campaigns.campaign import Campaign, campaign_files
from twin.campaigns.campaign import read_campaign as _read_campaign
from twin.campaigns.declared_rig import with_rig
from twin.errors import InputError, quoted
from twin.parameters import Rig
from twin.rigs import preset
from twin.rigs.check import check_parameters
from twin.rigs.rig_file import checked_effects, read_rig_file

Effects: TypeAlias = Mapping[str, Mapping[str, float]]
"""Effect name -> parameter name -> value, SI."""

FilePath: TypeAlias = str | PathLike[str]


class RigFile(NamedTuple):
    """A rig and the effects that act on it, as a parameter file declares them."""

    rig: Rig
    effects: Effects


RigLike: TypeAlias = str | PathLike[str] | Rig | RigFile
"""Name of a published rig, a parameter file, a rig, or a rig with effects."""


def read_campaign(folder: FilePath) -> Campaign:
    """Reads a campaign: `campaign.toml` and its recordings, checked and in SI units.

    Raises:
      InputError: something in the folder cannot be used.
    """
    return _read_campaign(Path(folder))


def rig(name: str = "bossi2009") -> Rig:
    """Returns a published rig; `rig["length"]` is a value in SI, `rig.parameters["length"]` has unit and source.

    Raises:
      InputError: there is none of this name.
    """
    return preset(name)


def read_rig(file: FilePath) -> RigFile:
    """Reads a parameter file (TOML), as a diagnosis or an identification writes it.

    Raises:
      InputError: the file cannot be used.
    """
    return RigFile(*read_rig_file(file))


def rig_of(given: RigLike) -> RigFile:
    if isinstance(given, RigFile):
        return RigFile(given.rig, checked_effects(given.effects, given.rig))
    if isinstance(given, Rig):
        check_parameters(given)
        return RigFile(given, {})
    if not isinstance(given, str | PathLike):
        raise InputError(f"rig is {quoted(given)}; expected a name, a parameter file, a Rig or a RigFile")
    path = Path(given)
    if path.suffix or path.exists():
        return read_rig(path)
    return RigFile(preset(str(given)), {})


def files_of(campaign: FilePath | Campaign, rig: RigLike | None) -> tuple[Path | None, list[Path]]:
    """Returns the folder of a campaign, None for a value, and the files from which it and its rig were read."""
    folder = None if isinstance(campaign, Campaign) else Path(campaign)
    files = [] if folder is None else list(campaign_files(folder))
    if isinstance(rig, str | PathLike) and Path(rig).is_file():
        files.append(Path(rig))
    return folder, files


def campaign_of(given: FilePath | Campaign, declared: RigLike | None) -> Campaign:
    campaign = given if isinstance(given, Campaign) else read_campaign(given)
    if declared is None:
        return campaign
    return with_rig(campaign, *rig_of(declared))

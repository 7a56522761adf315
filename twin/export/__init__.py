"""Exporters of rigs: one file per format, and its line in the registry."""

from __future__ import annotations

from pathlib import Path

from twin.errors import InputError, nearest
from twin.export.base import Exported, Exporter, RigToExport
from twin.export.fmu import Fmu
from twin.export.mat import MatFile
from twin.export.matlab_script import MatlabScript
from twin.export.mjcf import Mjcf

EXPORTERS: tuple[Exporter, ...] = (MatFile(), MatlabScript(), Mjcf(), Fmu())

__all__ = ["EXPORTERS", "Exported", "Exporter", "RigToExport", "exporter_of"]


def exporter_of(file: Path, name: str | None = None) -> Exporter:
    """Returns the exporter of a format; without a name, that which the ending of a file tells.

    Raises:
      InputError: there is none.
    """
    if name is None:
        found = [e for e in EXPORTERS if e.suffix == file.suffix.lower()]
        if not found:
            known = ", ".join(f"{e.suffix} ({e.what})" for e in EXPORTERS)
            raise InputError(f"{file} ends in '{file.suffix}'; expected one of: {known}; or name a --format")
        return found[0]
    by_name = {e.name: e for e in EXPORTERS}
    if name not in by_name:
        known = ", ".join(by_name)
        raise InputError(f"--format is '{name}'; expected one of: {known}{nearest(name, by_name)}")
    return by_name[name]

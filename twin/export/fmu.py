"""The rig as an FMU for co-simulation, FMI 2.0, with pythonfmu."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from twin.export.base import Exported, Exporter, RigToExport
from twin.files.extras import imported
from twin.rigs.rig_file import effect_lines, header_lines, parameter_lines

_SCRIPT = Path(__file__).with_name("twin_rig.py")


class Fmu(Exporter):
    """The compiled chain behind the interface of FMI; runs in Python, which the importing program has to find."""

    name = "fmu"
    suffix = ".fmu"
    what = "FMI 2.0 co-simulation, friction and sticking included"

    def export(self, given: RigToExport) -> Exported:
        builder = imported("pythonfmu.builder", "an FMU is written with pythonfmu", "fmu")
        with tempfile.TemporaryDirectory() as folder:
            rig_file, fmu = Path(folder) / "rig.toml", Path(folder) / "rig.fmu"
            rig_file.write_text(_rig_file(given), encoding="utf-8")
            with _same_import_path():
                builder.FmuBuilder.build_FMU(_SCRIPT, fmu, {rig_file})
            return Exported(fmu.read_bytes(), ())


@contextmanager
def _same_import_path() -> Iterator[None]:
    """Undoes what the builder does to where modules are imported from."""
    path = list(sys.path)
    try:
        yield
    finally:
        sys.path[:] = path
        sys.modules.pop(_SCRIPT.stem, None)


def _rig_file(given: RigToExport) -> str:
    """The rig as a parameter file."""
    lines = header_lines(given.rig.name, "inside an FMU")
    for parameter in given.rig.parameters.values():
        lines += parameter_lines(parameter)
    for name, values in given.effects.items():
        lines += effect_lines(name, values, {}, {}, "acting")
    return "\n".join(lines) + "\n"

"""The rig as MJCF, MuJoCo's format."""

from __future__ import annotations

from twin.export.base import Exported, Exporter, RigToExport
from twin.recording import gauges_on
from twin.rigs.mjcf_export import to_mjcf


class Mjcf(Exporter):
    """The chain for any MuJoCo viewer or program, with every effect that MuJoCo has an element for."""

    name = "mjcf"
    suffix = ".xml"
    what = "MuJoCo model"

    def export(self, given: RigToExport) -> Exported:
        gauges = gauges_on(given.rig["length"])
        comment = [f"The rig '{given.rig.name}'. Effects: {', '.join(given.effects) or 'none'}."]
        written = to_mjcf(given.rig, given.effects, gauges, comment)
        return Exported(written.xml, written.left_out)

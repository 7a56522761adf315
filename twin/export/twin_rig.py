"""The script inside an FMU, which pythonfmu copies there; beside it lies the rig file."""

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

from twin.export.stepped_rig import from_file
from twin.recording import CHANNEL_UNITS

BASE_UNITS = {"rad": {"rad": 1}, "m": {"m": 1}, "N*m": {"kg": 1, "m": 2, "s": -2}}
"""Unit of a variable -> exponents of its base units."""


class TwinRig(Fmi2Slave):
    """A flexible manipulator; input: commanded torque; outputs: what its sensors report, and whether the hub sticks."""

    author = "twin"
    description = (
        "Planar flexible manipulator with dry friction of the hub, sticking included. The machine that runs this FMU "
        "needs Python with the package flexlink-twin, of the minor version of Python that loads it."
    )

    def __init__(self, **options):
        super().__init__(**options)
        self._rig = from_file(Path(self.resources) / "rig.toml")
        self._units = {}
        self.torque_command, self.hub_angle_start = 0.0, 0.0
        self._add("torque_command", "N*m", Fmi2Causality.input, "commanded torque, held over a step")
        start = "hub angle at which the rig rests at first"
        self._add(
            "hub_angle_start", "rad", Fmi2Causality.parameter, start, variability=Fmi2Variability.tunable
        )
        for name in self._rig.readings:
            self._add_reading(name)
        sticks = {"causality": Fmi2Causality.output, "variability": Fmi2Variability.discrete}
        what = "friction holds the hub"
        self.register_variable(Boolean("sticks", description=what, getter=lambda: self._rig.sticks, **sticks))

    def _add(self, name, unit, causality, description, **more):
        self._units[name] = unit
        text = f"{description} [{unit}]"
        self.register_variable(Real(name, causality=causality, description=text, **more))

    def _add_reading(self, name):
        what, unit = "what the sensor reports", CHANNEL_UNITS[name]
        self._add(name, unit, Fmi2Causality.output, what, getter=lambda: self._rig.readings[name])

    def to_xml(self, *options):
        """The model description of pythonfmu with the name of the rig, and with units, which that does not know."""
        root = super().to_xml(*options)
        root.set("modelName", self._rig.name)
        known = Element("UnitDefinitions")
        for name, exponents in BASE_UNITS.items():
            base = {key: str(power) for key, power in exponents.items()}
            SubElement(SubElement(known, "Unit", {"name": name}), "BaseUnit", base)
        # FMI 2.0 has the units behind the kind of the model.
        root.insert(1, known)
        for variable in root.iter("ScalarVariable"):
            unit = self._units.get(variable.get("name"))
            if unit in BASE_UNITS:
                variable.find("Real").set("unit", unit)
        return root

    def exit_initialization_mode(self):
        self._rig.reset(self.hub_angle_start)

    def do_step(self, current_time, step_size):
        self._rig.advance(self.torque_command, step_size)
        return True

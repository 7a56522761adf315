"""The script inside an FMU, which pythonfmu copies there; beside it lies the rig file."""

from pathlib import Path

from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

from twin.export.stepped_rig import from_file
from twin.recording import CHANNEL_UNITS


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
        self.torque_command, self.hub_angle_start = 0.0, 0.0
        self._add("torque_command", Fmi2Causality.input, "commanded torque, held over a step [N*m]")
        start = "hub angle at which the rig rests at first [rad]"
        self._add("hub_angle_start", Fmi2Causality.parameter, start, variability=Fmi2Variability.tunable)
        for name in self._rig.readings:
            self._add_reading(name)
        sticks = {"causality": Fmi2Causality.output, "variability": Fmi2Variability.discrete}
        what = "friction holds the hub"
        self.register_variable(Boolean("sticks", description=what, getter=lambda: self._rig.sticks, **sticks))

    def _add(self, name, causality, description, **more):
        self.register_variable(Real(name, causality=causality, description=description, **more))

    def _add_reading(self, name):
        what = f"what the sensor reports [{CHANNEL_UNITS[name]}]"
        self._add(name, Fmi2Causality.output, what, getter=lambda: self._rig.readings[name])

    def exit_initialization_mode(self):
        self._rig.reset(self.hub_angle_start)

    def do_step(self, current_time, step_size):
        self._rig.advance(self.torque_command, step_size)
        return True

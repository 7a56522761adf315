"""A rig with effects as a model that can be simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.api.inputs import Effects, FilePath, RigLike, rig_of
from twin.errors import LARGEST, InputError, checked_count, checked_number
from twin.mechanics.accuracy import SEGMENT_LIMITS
from twin.recording import Recording, gauges_on
from twin.rigs.model import FINE_SEGMENTS, FINE_STEP, Model, checked_model
from twin.rigs.rig_file import checked_effects

if TYPE_CHECKING:
    import control

_TOO_MUCH = "expected torques and parameters with which the link stays slender: check their units"
_SIMULATED = ("hub_angle", "strain_base", "strain_mid", "tip_deflection", "motor_torque")


_LONGEST = 1e5
"""Longest simulation [s]: it takes a quarter of an hour."""
_TURNS = 1e3
"""Largest angle from which the hub starts [rad]: 160 turns, which no rig counts."""


@dataclass(frozen=True)
class RigModel:
    """A rig with its effects, ready to be simulated.

    Attributes:
      model: what is simulated, see `twin.rigs.model.Model`.
    """

    model: Model = field(repr=False)

    def simulate(
        self,
        time: Sequence[float] | np.ndarray,
        torque: Sequence[float] | np.ndarray,
        *,
        hub_angle: float = 0.0,
        tip_deflection: float | None = None,
        clamped: bool = False,
        channels: Sequence[str] = _SIMULATED,
    ) -> Recording:
        """Simulates the rig from rest under a torque; returns what its sensors report.

        Args:
          time: (n) instants [s], increasing.
          torque: (n) commanded torque [N·m], held from each instant to the next.
          hub_angle: where the hub starts [rad].
          tip_deflection: the tip is held there by a force until the first instant [m]; None for a link at rest.
          clamped: whether the hub is locked.
          channels: that are simulated.

        Raises:
          InputError: the arrays do not fit, a channel is not simulated, or the motion is no longer finite.
        """
        from twin.mechanics.state import Start
        from twin.rigs.simulate import simulate

        recording = _blank(time, torque, channels, clamped, tip_deflection)
        checked_number("hub_angle", hub_angle, -_TURNS, _TURNS, "rad")
        if tip_deflection is not None:
            length = self.model.rig["length"]
            checked_number("tip_deflection", tip_deflection, -length, length, "m")
        simulated = simulate(self.model, recording, Start(hub_angle=hub_angle))
        diverged = [c for c in channels if not np.isfinite(simulated[c]).all()]
        if diverged:
            raise InputError(f"the simulation diverged: {diverged[0]} is not finite; {_TOO_MUCH}")
        return simulated

    def mjcf(self) -> str:
        """Returns the rig as MJCF, what MuJoCo cannot say named in a comment."""
        from twin.rigs.mjcf_export import to_mjcf

        return to_mjcf(self.model.declared, self.model.effects, self.model.sensors).xml

    def state_space(self, hub_angle: float = 0.0) -> control.StateSpace:
        """Returns the chain linearised about rest at a hub angle [rad], for python-control; friction left out.

        Input: torque command less that which holds the rig there; outputs: readings less those at rest, SI.
        """
        from twin.export.linear import linear_model

        checked_number("hub_angle", hub_angle, -_TURNS, _TURNS, "rad")
        return linear_model(self.model, hub_angle).to_control()

    def export(self, file: FilePath, *, format: str | None = None, hub_angle: float = 0.0) -> Path:
        """Writes the rig for another program, as `twin export` does; returns the file.

        Args:
          file: ends in .mat (linear state space), .m (MATLAB script), .xml (MuJoCo) or .fmu (FMI 2.0).
          format: mat, matlab, mjcf or fmu; None for what the ending tells.
          hub_angle: about which the linear state space is made [rad].

        Raises:
          InputError: there is no such format, a library is not installed, or the file cannot be written.
        """
        from twin.export import RigToExport, exporter_of
        from twin.files.whole import write_file

        path = Path(file)
        checked_number("hub_angle", hub_angle, -_TURNS, _TURNS, "rad")
        given = RigToExport(self.model.declared, self.model.effects, hub_angle)
        write_file(path, exporter_of(path, format).export(given).content)
        return path


def _blank(
    time: Sequence[float] | np.ndarray,
    torque: Sequence[float] | np.ndarray,
    channels: Sequence[str],
    clamped: bool,
    tip_deflection: float | None,
) -> Recording:
    """A recording with nothing measured yet."""
    time, torque = _numbers("time", time), _numbers("torque", torque)
    if time.ndim != 1 or time.shape != torque.shape or len(time) < 2 or np.any(np.diff(time) <= 0):
        raise InputError(
            f"time has shape {time.shape} and torque {torque.shape}; expected two vectors of equal length, time "
            "increasing"
        )
    checked_number("the duration", time[-1] - time[0], 0.0, _LONGEST, "s")
    unknown = [c for c in channels if c not in _SIMULATED]
    if unknown:
        raise InputError(f"'{unknown[0]}' is not simulated; expected some of: {', '.join(_SIMULATED)}")
    empty = {channel: np.zeros(len(time)) for channel in channels}
    return Recording("simulated", time, {"torque_command": torque, **empty}, clamped, "open", tip_deflection)


def _numbers(name: str, values: Sequence[float] | np.ndarray) -> np.ndarray:
    """An array of finite numbers."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is no array of numbers: {error}; expected a vector") from None
    if not np.all(np.abs(array) <= LARGEST):
        raise InputError(f"{name} has a value that is not finite; expected finite numbers")
    return array


def model(
    rig: RigLike = "bossi2009", effects: Effects | None = None, segments: int = FINE_SEGMENTS
) -> RigModel:
    """Returns a rig with effects as a model that can be simulated.

    Args:
      rig: name, parameter file, rig, or rig with effects.
      effects: in the place of those that the file has; what is not said of one is neutral.
      segments: of the chain.

    Raises:
      InputError: a rig or an effect is not known.
    """
    from twin.mechanics import chain

    known = rig_of(rig)
    acting = checked_effects(known.effects if effects is None else effects, known.rig)
    gauges = gauges_on(known.rig["length"])
    checked_count("segments", segments, *SEGMENT_LIMITS)
    shape = chain.fit_shape(known.rig, segments)
    return RigModel(checked_model(Model(known.rig, gauges, shape, acting, FINE_STEP)))

"""Simulations that begin anew in every window of a recording, from the state that the measured hub gives.

The free run of an integrating rig drifts: a small error of a torque, or one wrong stick, offsets all that follows. In a
window of stated length it is bounded, and shows what the model gets wrong there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from twin.effects import Drive
from twin.mechanics import planar
from twin.mechanics.plant import Plant
from twin.mechanics.state import Motion, Start
from twin.recording import Recording
from twin.residuals.filters import GRID
from twin.residuals.make_view import hub_signals
from twin.residuals.prepared import Prepared
from twin.residuals.view import move_link
from twin.rigs.model import Model
from twin.rigs.simulate import delivered_torque, sensor_readings

WINDOW = 1.0
"""Length of a window [s]: a few periods of the first bending mode, short beside the drift of a hub."""
_NEAR = 0.02  # s before and behind the start of a window in which the hub has to be read
_LONG_BEFORE = 1e3  # s, when the drive has settled
_FEWEST = 4  # samples of a window


@dataclass(frozen=True, eq=False)
class Windowed:
    """Simulations of a recording in windows; m samples.

    Attributes:
      readings: those of every window, one behind the other; NaN where there is no window.
      window: (m) number of the window in which a sample lies, from 0; -1 where there is none.
    """

    readings: Recording
    window: np.ndarray

    @property
    def inside(self) -> np.ndarray:
        """Whether a sample lies in a window (m)."""
        return self.window >= 0


def simulate_windows(model: Model, prepared: Prepared, start: Start, free: Recording) -> Windowed | None:
    """Free simulations of `WINDOW` each, one behind the other.

    Each begins with the measured angle and rate of the hub, low-passed; the hub sticks where the recording shows a rest.
    Shape and motion of the link are those of the modelled link under the measured hub until then, so that nothing
    but the hub's readings enters: an error of the link's model shows from the first sample of a window on. A motor with
    backlash begins on the flank to which its torque pushes it.

    There is no window where the hub is not read about its start, and none in the rest behind the last whole window.

    Args:
      model: the model.
      prepared: the recording.
      start: its state at the first sample.
      free: readings of the free run of the whole recording; the motor torque, which only the command decides, is its.

    Returns:
      None where the hub is clamped or not measured, so that nothing is measured to begin with, or without any window.
    """
    if prepared.hub is None:
        return None
    recording = prepared.recording
    channels = {c: np.full(len(recording), np.nan) for c in recording.measured()}
    window = np.full(len(recording), -1)
    for k, inside, motion in _window_motions(model, prepared, start):
        part = recording.part(inside)
        on_rig = part.replace(channels={c: v for c, v in part.channels.items() if c != "motor_torque"})
        readings = sensor_readings(model, on_rig, motion, began=recording.time[0])
        for channel in readings.measured():
            channels[channel][inside] = readings[channel]
        window[inside] = k
    if "motor_torque" in channels:
        channels["motor_torque"] = np.where(window >= 0, free["motor_torque"], np.nan)
    return Windowed(recording.replace(channels=channels), window) if (window >= 0).any() else None


def _window_motions(
    model: Model, prepared: Prepared, start: Start
) -> Iterator[tuple[int, np.ndarray, Motion]]:
    """Number of each window, its samples as a mask (m), and the free motion of the chain at these."""
    assert prepared.hub is not None
    recording = prepared.recording
    signals = hub_signals(prepared, prepared.hub, model)
    driven, _ = move_link(signals, prepared, model, start)
    plant, times, torques = delivered_torque(model, recording)
    drive, since = model.drive(recording), (recording.time - recording.time[0]) / WINDOW
    read = recording.time[np.isfinite(recording["hub_angle"])]
    for k in range(int(recording.duration / WINDOW + 1e-9)):
        row = round(k * WINDOW / GRID)
        began, inside = float(signals.time[row]), np.floor(since + 1e-9) == k
        if inside.sum() < _FEWEST or not (np.abs(read - began) < _NEAR).any():
            continue
        phi, omega, mode = _state(plant, driven, row, float(drive.at(np.array([began]))[0]))
        held = _commands_from(times, torques, drive, began)
        instants = np.r_[began, recording.time[inside]]
        rows = planar.simulate(plant, *held, instants, phi, omega, mode, False, model.stable_step)
        yield (
            k,
            inside,
            Motion.from_coordinates(instants[1:], *(v[1:] for v in rows), len(model.chain.lengths)),
        )


def _state(plant: Plant, driven: Motion, row: int, torque: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Angles and rates (n + 1 + k) at a row of a driven motion, and the mode of the hub; `torque` of the motor [N m]."""
    angles, rates = driven.state()
    phi, omega, mode = plant.extend_state(angles[row]), plant.extend_state(rates[row]), int(driven.modes[row])
    if mode == 0:
        omega = omega - omega[0]
    if plant.motor.gap > 0:
        phi[-1] += np.sign(torque) * plant.motor.gap / 2
    return phi, omega, mode


def _commands_from(
    times: np.ndarray, torques: np.ndarray, drive: Drive, began: float
) -> tuple[np.ndarray, np.ndarray]:
    """Instants [s] and torques [N m] that are held from an instant on, the drive lagging as it does at that instant."""
    held = int(np.searchsorted(times, began + 1e-12, side="right")) - 1
    delivered = drive.at(np.array([began]))[0]
    later = slice(held + 1, None)
    return np.r_[began - _LONG_BEFORE, began, times[later]], np.r_[delivered, torques[held], torques[later]]

"""One recording on a uniform grid, filtered, and what the link does in it.

The measured hub angle moves the link: its strains follow without friction, and the torque that the motion takes is
known at every instant.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.fft import irfft, rfft

from twin.mechanics import planar
from twin.mechanics.state import Motion, Start
from twin.residuals import creep
from twin.residuals.filters import GRID, MOTION_BANDS, smooth
from twin.residuals.link_moves import LinkMoves, Moved
from twin.residuals.prepared import Prepared
from twin.residuals.ringing import Ringing
from twin.rigs.model import Model
from twin.rigs.simulate import initial_state

_EXTENSION = 3.0  # s by which a residual is continued on either side before it is whitened
_KEPT = 12  # simulations of a recording that are remembered
_FEWEST = 8  # instants through which a spline is laid
LEFT_OUT = 0.06
"""Span at the end of a recording that is not compared [s]: the filters take what comes behind it for a mirror image."""


@dataclass(frozen=True)
class View:
    """One recording on a uniform grid, filtered.

    Attributes:
      time: (m) [s].
      reading, rate, acceleration: (m) of the hub's reading [rad], [rad/s], [rad/s^2]; zero where clamped.
      direction: (m) of the motion of the hub, 0 where it rests or is unclear.
      sliding: (m) whether the hub surely slides, with the filter's reach.
      measured: channel -> (m) filtered readings.
      known: channel -> (m) whether the readings are there.
      holes: strain -> (m) its readings before the filter, where some are missing; there they are bridged.
      noise: name -> standard deviation of what is compared, after the filter.
      onsets: (index, direction) at which a rest of the hub ends under a slowly growing torque.
      departures: samples of the recording at which the hub is seen to leave a rest, and its direction then.
      departing: (m) whether the hub's reading about these is compared.
      band: corner of the low-pass on the motion of the hub [Hz].
      whitening: channel -> gain over frequency of `whitened`; empty where the hub is clamped.
      ringing: name -> what the noise of the hub angle does to it by way of a ringing link; empty where the hub is
        clamped.
      swell: name -> (m) size of the noise in that of the quiet stretches; empty where the hub is clamped.
      pull: (m) standard deviation of the torque with which the link pulls at the hub, by the noise of the hub's angle
        in the motion before [N m].
      moves: what the link did in the last simulations.
    """

    time: np.ndarray
    reading: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    direction: np.ndarray
    sliding: np.ndarray
    measured: dict[str, np.ndarray]
    known: dict[str, np.ndarray]
    noise: dict[str, float]
    onsets: tuple[tuple[int, int], ...]
    band: float = MOTION_BANDS[0]
    whitening: dict[str, np.ndarray] = field(default_factory=dict, repr=False)
    ringing: dict[str, Ringing] = field(default_factory=dict, repr=False)
    swell: dict[str, np.ndarray] = field(default_factory=dict, repr=False)
    holes: dict[str, np.ndarray] = field(default_factory=dict, repr=False)
    departures: tuple[creep.Event, ...] = ()
    departing: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool), repr=False)
    pull: np.ndarray = field(default_factory=lambda: np.zeros(0), repr=False)
    moves: LinkMoves = field(default_factory=lambda: LinkMoves(_KEPT), repr=False)


def whitened(values: np.ndarray, view: View, channel: str) -> np.ndarray:
    """A residual (..., m) in noise units whose noise has the same size at every frequency up to `BAND`.

    The noise of the hub angle shakes the modelled link, which rings at its clamped modes for seconds: there a
    residual means little. Before and behind the recording it is continued as its odd extension.
    """
    share = view.whitening.get(channel)
    if share is None:
        return values / view.noise[channel]
    pad = min(values.shape[-1] - 1, padding(view))
    before = 2 * values[..., :1] - values[..., pad:0:-1]
    behind = 2 * values[..., -1:] - values[..., -2 : -pad - 2 : -1]
    extended = np.concatenate([before, values, behind], axis=-1)
    white = irfft(rfft(extended) * share, extended.shape[-1])
    return white[..., pad : pad + values.shape[-1]]


def padding(view: View) -> int:
    return int(_EXTENSION / GRID)


def move(view: View, prepared: Prepared, model: Model, start: Start) -> tuple[Motion, np.ndarray]:
    """The link under the measured hub, and the torque (m) on the hub that this takes [N m].

    Candidates that act on the hub alone move the link alike: what the link does is kept for a while.
    """
    hub = hub_motion(view, model)
    phi, omega = initial_state(model, prepared.recording, start)
    # What a motor with play does is for `delivered` to say.
    plant = model.plant.without_motor()

    def simulated() -> Moved:
        first = plant.extend_state(phi), plant.extend_state(omega)
        if prepared.recording.start == "unknown":
            first = first[0], first[1] - omega[0] + hub.rate[0]
        parts = max(1, round(GRID / model.step))
        fine = planar.simulate_prescribed_hub(
            plant, *_between(view.time, hub, parts), *first, model.link_step
        )
        return fine[0][::parts].copy(), fine[1][::parts].copy(), fine[2][::parts].copy()

    on = (*plant.link, model.step, hub.angle, phi, omega)
    angles, rates, required = view.moves.get(on, simulated)
    return Motion.from_coordinates(view.time, angles, rates, hub.direction, len(phi)), required


@dataclass(frozen=True)
class Hub:
    """Motion of the hub behind its sensor (m): angle [rad], rate, acceleration, direction."""

    angle: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    direction: np.ndarray


def hub_motion(view: View, model: Model) -> Hub:
    """What the hub does, as the model of its sensor says; what a late one has not read yet goes on as it was."""
    angle = model.hub_angle_of(view.reading, view.time)
    if np.array_equal(angle, view.reading):
        return Hub(angle, view.rate, view.acceleration, view.direction)
    read = before_end(view.time, model.hub_late)
    read[:_FEWEST] = True
    spline = smooth(view.time[read], angle[read])
    last = view.time[read][-1]
    at, beyond = np.minimum(view.time, last), np.maximum(view.time - last, 0.0)
    acceleration = spline(at, 2)
    rate = spline(at, 1) + acceleration * beyond
    angle = np.where(read, angle, spline(at) + (rate - acceleration * beyond / 2) * beyond)
    return Hub(angle, rate, acceleration, np.where(view.direction == 0, 0.0, np.sign(rate)))


def before_end(time: np.ndarray, span: float) -> np.ndarray:
    """Whether instants (m) lie at least a span before the last [s]."""
    return time <= time[-1] - span


def _between(time: np.ndarray, hub: Hub, parts: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Instants, angle, rate and acceleration of a hub, with so many parts to each step of the grid.

    The acceleration of a driven link is a straight line from one instant to the next, in which an oscillation is
    (omega h)^2/12 too small. A model with short steps sees it at the end of each, and `limit.move` takes the
    error out of the others.
    """
    if parts == 1:
        return time, hub.angle, hub.rate, hub.acceleration
    finer = np.interp(np.arange(parts * (len(time) - 1) + 1) / parts, np.arange(len(time)), time)
    spline = smooth(time, hub.angle)
    return finer, spline(finer), spline(finer, 1), spline(finer, 2)

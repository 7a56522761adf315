"""The noise of what is compared in a recording whose measured hub moves the link.

Noise of the hub angle shakes the modelled link, which answers at its own frequencies and rings on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.fft import rfftfreq
from scipy.ndimage import uniform_filter1d

from twin.recording import Recording
from twin.residuals import ringing
from twin.residuals.filters import BAND, GRID, low_passed, passed, smooth
from twin.residuals.link_moves import LinkMoves
from twin.residuals.prepared import Prepared
from twin.residuals.residual import residual
from twin.residuals.ringing import Ringing, Swing
from twin.residuals.view import View, move, padding, whitened
from twin.rigs.model import Model
from twin.rigs.simulate import sensor_readings

_DRAWS = 4  # noises that are tried on the link
_LOCAL = 0.4  # s to either side over which their effect is averaged


def sensor_noise(prepared: Prepared, hub: dict[str, float]) -> dict[str, float]:
    share = np.sqrt(2 * BAND * prepared.recording.period)
    noise = {c: prepared.noise[c] * min(1.0, share) for c in prepared.channels if c != "hub_angle"}
    return {name: float(np.hypot(value, hub.get(name, 0.0))) for name, value in noise.items()}


def propagated(prepared: Prepared, view: View, model: Model) -> tuple[dict[str, float], np.ndarray]:
    """Noise of each channel, and noise (m) of the torque on the hub [N m]: a simulation with noise added to the hub."""
    plain, torque = move(view, prepared, model, prepared.start)
    noisy = _shaken(view, prepared, np.random.default_rng(0), np.ones(len(view.time)))
    moved, torque_moved = move(noisy, prepared, model, prepared.start)
    asked = Recording(
        "", view.time, {c: np.zeros(len(view.time)) for c in view.measured if c != "motor_torque"}
    )
    a, b = sensor_readings(model, asked, plain), sensor_readings(model, asked, moved)
    with np.errstate(invalid="ignore"):  # a simulation that ran away
        hub = {c: float(np.std(low_passed(a[c] - b[c], GRID))) for c in asked.measured()}
        return sensor_noise(prepared, hub), low_passed(torque_moved - torque, GRID)


def swell(view: View, prepared: Prepared, model: Model) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Name -> (m) size of the noise, in that of the quiet stretches; and the deviation (m) of the link's pull [N m].

    All else takes what noise of the hub angle does to the link as the same throughout. A link that bends far answers to
    it several times as loudly, at other frequencies than those at which it rings: noises are tried. A hub that rests
    makes none, but the link that it moved before swings on.
    """
    moving, pulled = view.direction != 0, np.zeros(len(view.time))
    if not moving.any():
        return {}, pulled
    generator = np.random.default_rng(1)
    plain = residual(view, prepared, model, prepared.start)
    _, pull = move(view, prepared, model, prepared.start)
    squares = {name: np.zeros(len(view.time)) for name in view.ringing}
    for _ in range(_DRAWS):
        shaken = _shaken(view, prepared, generator, moving)
        noisy = residual(shaken, prepared, model, prepared.start)
        squares = {name: s + (noisy[name] - plain[name]) ** 2 / _DRAWS for name, s in squares.items()}
        pulled += (move(shaken, prepared, model, prepared.start)[1] - pull) ** 2 / _DRAWS
    known = {**view.known, "hub_torque": view.sliding}
    return {name: _swelling(s, known[name], moving) for name, s in squares.items()}, np.sqrt(pulled)


def _shaken(view: View, prepared: Prepared, generator: np.random.Generator, where: np.ndarray) -> View:
    """The view with noise added to the hub, a share (m) of it at each instant."""
    sigma = prepared.noise["hub_angle"] * min(1.0, np.sqrt(prepared.recording.period / GRID))
    shaken = low_passed(generator.normal(0, sigma, len(view.time)), GRID, view.band) * where
    spline = smooth(view.time, shaken)
    return replace(
        view,
        moves=LinkMoves(1),
        reading=view.reading + shaken,
        rate=view.rate + spline(view.time, 1),
        acceleration=view.acceleration + spline(view.time, 2),
    )


def _swelling(squares: np.ndarray, known: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """Size (m) of a unit noise a part of which has these squares (m) about each instant, in that where it is usual."""
    size = 2 * int(_LOCAL / GRID) + 1
    share = uniform_filter1d(known.astype(float), size, mode="constant")
    local = uniform_filter1d(squares * known, size, mode="constant") / np.maximum(share, 1 / size)
    usual = float(np.median(local[known & moving])) if (known & moving).any() else 0.0
    return np.sqrt(1 + np.maximum(local - usual, 0.0))


def evened(view: View, swings: Sequence[Swing], torque: np.ndarray) -> tuple[float, Ringing]:
    """Standard deviation of noise (m) of the torque without its swings [N m], and these where the hub slides."""
    pulls = np.hstack([np.zeros((len(torque), 0)), *(s.pull * s.coordinate for s in swings)])
    rough = ringing.of_columns(pulls / np.std(torque))
    even = float(np.std(rough.whitened(torque)))
    return even, ringing.of_columns(pulls * view.sliding[:, None] / even)


def swinging_strains(view: View, model: Model, swings: Sequence[Swing]) -> dict[str, Ringing]:
    """Channel -> the swings that `whitened` leaves in its residual."""
    found = {}
    for channel in view.whitening:
        row = model.sensors[channel].half_thickness * model.curvature_rows[channel]
        seen = [row @ s.shape[1:] * s.coordinate for s in swings]
        columns = whitened(np.hstack([np.zeros((len(view.time), 0)), *seen]).T, view, channel).T
        found[channel] = ringing.of_columns(columns * view.known[channel][:, None])
    return found


def whitening(prepared: Prepared, view: View, model: Model) -> dict[str, np.ndarray]:
    """Channel -> gain over frequency that makes the noise of its residual white, unit variance behind the filter."""
    count = len(view.time)
    f = rfftfreq(count + 2 * min(count - 1, padding(view)), GRID)
    period = prepared.recording.period
    hub = 2 * prepared.noise["hub_angle"] ** 2 * period * passed(f, GRID, view.band) ** 2
    wide = float(np.trapezoid(passed(f, GRID) ** 2, f))
    omega = 2 * np.pi * f
    frequencies, shapes = model.chain.modes("clamped")
    # What rings for longer is for `Ringing`: a filter this sharp would ring as long itself.
    ratios = np.maximum(model.chain.damping_ratios("clamped"), 1 / (ringing.LIGHT * frequencies))
    pushes = model.chain.mass_matrix()[0, 1:] @ shapes[1:]
    found = {}
    for channel, row in model.curvature_rows.items():
        if channel not in view.measured:
            continue
        seen = model.sensors[channel].half_thickness * (row @ shapes[1:]) * pushes
        response = sum(
            size * omega**2 / (w**2 - omega**2 + 2j * z * w * omega)
            for size, w, z in zip(seen, frequencies, ratios, strict=True)
        )
        own = 2 * prepared.noise[channel] ** 2 * period
        found[channel] = 1 / np.sqrt((own + np.abs(response) ** 2 * hub) * wide)
    return found

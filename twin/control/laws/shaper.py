"""Input shapers: the reference is convolved with impulses such that it leaves no residual vibration.

A shaper wraps another controller and passes the shaped reference on to it.
Zero-vibration and extra-insensitive shapers: Singer and Seering, J. Dyn. Syst. Meas. Control 112 (1990) 76-82;
Singhose, Seering and Singer, J. Mech. Des. 116 (1994) 654-659, here in the form of three equal-strength lobes.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from twin.control.laws.base import Controller

TOLERATED = 0.05
"""Residual vibration that the extra-insensitive shaper allows at the modelled frequency [1]."""


def zero_vibration(frequency: float, damping_ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns instants [s] and amplitudes [1] of the two impulses that cancel one mode.

    Args:
      frequency: undamped natural frequency [Hz].
      damping_ratio: of the mode [1].
    """
    half, decay = _half_period(frequency, damping_ratio)
    amplitudes = np.array([1.0, decay])
    return np.array([0.0, half]), amplitudes / amplitudes.sum()


def extra_insensitive(
    frequency: float, damping_ratio: float, tolerated: float = TOLERATED
) -> tuple[np.ndarray, np.ndarray]:
    """Returns instants [s] and amplitudes [1] of three impulses that are insensitive to errors of the frequency.

    A residual of `tolerated` at the modelled frequency is accepted for zero vibration at a frequency on either side of
    it. Exact without damping; with damping the amplitudes are weighted by the decay between the impulses.
    """
    half, decay = _half_period(frequency, damping_ratio)
    outer, inner = (1 + tolerated) / 4, (1 - tolerated) / 2
    amplitudes = np.array([outer, inner * decay, outer * decay**2])
    return np.array([0.0, half, 2 * half]), amplitudes / amplitudes.sum()


def residual_vibration(
    instants: np.ndarray, amplitudes: np.ndarray, frequency: float, damping_ratio: float
) -> float:
    """Returns the residual vibration relative to that of one impulse [1] (Singer and Seering 1990)."""
    omega = 2 * math.pi * frequency
    grown = amplitudes * np.exp(damping_ratio * omega * (instants - instants[-1]))
    damped = omega * math.sqrt(1 - damping_ratio**2) * instants
    return float(np.hypot(grown @ np.cos(damped), grown @ np.sin(damped)))


class ShapedReference:
    """A controller that follows the shaped reference; impulses are discretised to samples."""

    def __init__(
        self, inner: Controller, instants: np.ndarray, amplitudes: np.ndarray, period: float
    ) -> None:
        """Takes the inner controller, the impulses [s], [1], and the sample period [s]."""
        self._inner = inner
        samples = np.asarray(instants) / period
        before = np.floor(samples).astype(int)
        self._taps = np.zeros(before[-1] + 2)
        # An impulse between two samples is split between them such that its mean instant remains.
        np.add.at(self._taps, before, amplitudes * (1 - (samples - before)))
        np.add.at(self._taps, before + 1, amplitudes * (samples - before))
        self.reset()

    @property
    def states(self) -> dict[str, float]:
        """Shaped reference [rad], and the states of the inner controller."""
        return {"shaped_reference": self._shaped, **getattr(self._inner, "states", {})}

    def reset(self) -> None:
        """Resets the past reference to the angle at which the hub rests, and the inner controller."""
        self._inner.reset()
        self._past: deque[float] | None = None
        self._shaped = 0.0

    def torque(self, measured: Mapping[str, float], reference: float) -> float:
        """Returns the torque [N m]; see `Controller`."""
        if self._past is None:
            self._past = deque([measured["hub_angle"]] * len(self._taps), len(self._taps))
        self._past.appendleft(reference)
        self._shaped = float(self._taps @ np.array(self._past))
        return self._inner.torque(measured, self._shaped)


def _half_period(frequency: float, damping_ratio: float) -> tuple[float, float]:
    """Returns half of the damped period [s] and the decay over it [1]."""
    root = math.sqrt(1 - damping_ratio**2)
    return 0.5 / (frequency * root), math.exp(-damping_ratio * math.pi / root)

"""Signs of channels that fast motions show, where no slow part of a recording shows them.

A rig of link and hub is passive: a torque u on it does the work W = integral of u dtheta, which is what its friction
takes and its energy grows by. So W is negative in the long run only where u or theta counts the wrong way round. A
voltage does positive work too: against the back-EMF it turns the hub at a rate.

At the frequency of the first mode the link turns the hub: J_h theta'' = u - friction + E I w''(0). So the hub speeds up
towards the side to which the link is bent, while the slow bending is opposite to that.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from twin.campaigns.check_channels import LowPassed
from twin.recording import Recording

CLEAR_WORK = 0.2
"""Least share of the work [1] from which a sign is taken: in recordings with the right sign it is -0.1 to 1 for each,
and 0.2 to 1 for those of a campaign together; on a rig without friction that comes to rest it is 0."""
_CLEAR = 0.6
"""Least partial correlation [1] with which bending is judged; channels with the right sign have -0.1 to 1."""
_PERIOD = 128  # values of the low-passed recording in a period of the first mode, or more
_CHANGE = 0.01  # of its range, within which a command is held
_FEWEST = 2 * _PERIOD  # values under a held command
_PART = 0.25  # of the period of the first mode; half the width of the triangular mean, which takes noise away
_SAMPLES = 5.0  # of a recording, at least the same
_SHORTEST = 6.0  # periods; shorter recordings are not judged
BENDING = ("strain_base", "strain_mid", "tip_deflection")
"""Channels that are positive where the link is bent towards positive angles."""


class Work(NamedTuple):
    """Work of a torque on the hub.

    Attributes:
      net: its work [J], or in the unit of the torque times rad.
      gross: the integral of its magnitude.
    """

    net: float
    gross: float

    @property
    def share(self) -> float:
        """Net over gross work, from -1 to 1; 0 where there is none."""
        return self.net / self.gross if self.gross > 0 else 0.0


def fast(recording: Recording, period: float) -> LowPassed | None:
    """Returns a recording with its first mode and without its noise; None where it is too short.

    Args:
      recording: with a hub angle.
      period: of the first mode [s].
    """
    if recording.duration < _SHORTEST * period:
        return None
    return LowPassed(recording, max(_PART * period, _SAMPLES * recording.period))


def work(motion: LowPassed, channel: str) -> Work:
    """Returns the work of a torque on the hub."""
    power = motion.mean(channel) * motion.rate
    known = power[np.isfinite(power)]
    return Work(motion.step * float(known.sum()), motion.step * float(np.abs(known).sum()))


def bending(motion: LowPassed, channel: str) -> float:
    """Returns the partial correlation of bending and acceleration of the hub under a held command; 0 where unclear.

    Not to be asked of a recording under a controller: its torque follows the link, so that a hub that it holds against
    the link, behind a stiff gear or in a strong drive, moves the other way.
    """
    angle, values, torque = (motion.mean(name) for name in ("hub_angle", channel, "torque_command"))
    others = [np.ones_like(angle), angle, motion.rate, motion.direction, torque]
    known = np.isfinite(np.stack([values, motion.acceleration, *others])).all(axis=0) & _held(torque)
    if np.count_nonzero(known) < _FEWEST:
        return 0.0
    basis = np.linalg.qr(np.column_stack([other[known] for other in others]))[0]
    bent, speeding = (v[known] - basis @ (basis.T @ v[known]) for v in (values, motion.acceleration))
    length = float(np.linalg.norm(bent) * np.linalg.norm(speeding))
    correlation = float(bent @ speeding) / length if length > 0 else 0.0
    return correlation if abs(correlation) > _CLEAR else 0.0


def _held(torque: np.ndarray) -> np.ndarray:
    """Where a low-passed command (m) does not change within a period of the first mode: (m) bool."""
    highest, lowest = maximum_filter1d(torque, _PERIOD), minimum_filter1d(torque, _PERIOD)
    return highest - lowest <= _CHANGE * np.ptp(torque[np.isfinite(torque)])

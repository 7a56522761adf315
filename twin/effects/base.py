"""What a missing effect is: parameters with a neutral value at which it vanishes, and where it acts."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from twin.effects.reading import Reading
from twin.effects.wave import Wave
from twin.mechanics.chain import Chain
from twin.mechanics.hub_law import HubLaw, HubTorque
from twin.mechanics.plant import Plant
from twin.parameters import Rig

if TYPE_CHECKING:
    from mujoco import MjSpec

TORSION = "torsion"
"""Name under which `Effect.sensing` finds the angle of a torsional mode against the hub [rad]."""

OPEN = 0.1
"""Share of a sample period within which nobody declares when a command is put out or a reading is taken."""

FAR = tuple(np.geomspace(1, 3000, 28).tolist())
"""`Effect.multiples` of what is told to parts in ten thousand, and may take the link to quite another frequency."""


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect.

    Attributes:
      name: as in the vocabulary.
      unit: SI unit.
      neutral: value at which the effect vanishes; None where that is the declared value of a rig parameter.
      bounds: range in which it is searched for.
      step: a small but visible size, from which a search starts.
      channel: channel without which the parameter means nothing, or None.
      inverse: whether a fit moves one over the value: a stiffness whose neutral value is infinite. `bounds` are of
        the value, `step` is of one over it.
      choice: whether it only says which of several laws acts: a start gives it, no fit moves it.
    """

    name: str
    unit: str
    neutral: float | None
    bounds: tuple[float, float]
    step: float
    channel: str | None = None
    inverse: bool = False
    choice: bool = False

    def turned(self, value: float) -> float:
        """What a fit moves for a value, and the value for what a fit moves: itself, or one over it."""
        if not self.inverse:
            return value
        return 1 / value if value else math.inf

    @property
    def span(self) -> tuple[float, float]:
        """Range of what a fit moves."""
        low, high = sorted(self.turned(value) for value in self.bounds)
        return low, high


@dataclass(frozen=True)
class Drive:
    """Torque that the drive delivers: held values behind a first-order lag.

    Attributes:
      time: (k) instants [s] from which each value is held; before the first, the torque is `before`.
      torque: (k) [N m].
      before: torque before the first instant [N m].
      lag: time constant with which the torque follows [s].
    """

    time: np.ndarray
    torque: np.ndarray
    before: float = 0.0
    lag: float = 0.0

    def replace(self, **changes) -> Drive:
        """Returns a drive with some attributes changed."""
        return replace(self, **changes)

    def at(self, t: np.ndarray) -> np.ndarray:
        """Delivered torque at the instants t (m,) [N m]."""
        index = np.searchsorted(self.time, t + 1e-9, side="right") - 1
        held = np.where(index < 0, self.before, self.torque[np.maximum(index, 0)])
        if self.lag <= 0:
            return held
        index = np.maximum(index, 0)
        late = np.exp(-np.maximum(t - self.time[index], 0.0) / self.lag)
        return held + (self.reached[index] - held) * late

    @functools.cached_property
    def reached(self) -> np.ndarray:
        """Delivered torque at the instants (k) at which the command changes, behind the lag [N m]."""
        targets = np.r_[self.before, self.torque[:-1]]
        if self.lag <= 0:
            return targets
        kept = np.exp(-np.diff(self.time, prepend=self.time[0]) / self.lag)
        reached, torque = np.empty(len(targets)), self.before
        for k, (target, share) in enumerate(zip(targets.tolist(), kept.tolist(), strict=True)):
            reached[k] = torque = target + (torque - target) * share
        return reached

    def impulse(self, t: np.ndarray) -> np.ndarray:
        """Integral of the delivered torque up to the instants t (m,) [N m s], up to a constant.

        Of a first-order lag, lag * y' = u - y: the integral of y is that of u less lag * y.
        """
        first = min(t[0], self.time[0]) - 1.0
        knots = np.maximum.accumulate(np.r_[first, self.time, max(t[-1], self.time[-1]) + 1.0])
        held = np.r_[0.0, np.cumsum(np.diff(knots) * np.r_[self.before, self.torque])]
        whole = np.interp(t, knots, held)
        return whole - self.lag * self.at(t) if self.lag > 0 else whole


class Effect:
    """A physical effect that the model may lack. Every hook is the identity unless a subclass says otherwise.

    Where it acts is where it overrides a hook:

        rig, links     parameters of the rig, its chain of segments
        plant          mechanisms of the equations of motion: friction, link, motor
        hub_law        a torque on the hub, a function of time, angle and rate
        drive          the way from commanded to delivered torque
        sensing        what sensors report

    Class attributes:
      name: as in the vocabulary.
      meaning: what the model lacks, in words that follow "The model lacks ...: ".
      acts_on: the part of the rig that it belongs to, for people.
      parameters: the `EffectParameter`s.
      hub_law: torque on the hub, see `twin.mechanics.hub_law`; it reads the values of the parameters in their order.
      on_motor: where there is a play between motor and hub, `hub_law` acts on the motor.
      mjcf_is_exact: whether the element that `write_mjcf` adds is exact with any time step.
      linearisable: whether a model that is linear about one place can stand for it. What `hub_law` says of that is
        found by evaluating it.
      along: parameters that say where or how the effect acts and mean nothing at neutral (a phase, a rest angle):
        a start gives them as they are, it does not scale them.
      wave: how the effect repeats, if it does with an order that a search has to look for.
      replaces: declared parameters that the effect takes over: they no longer count as calibration.
      multiples: of the first visible size, at which a search looks before it fits.
    """

    name: str
    meaning: str
    acts_on: Literal["drive", "hub", "link", "payload", "sensors"]
    parameters: tuple[EffectParameter, ...]
    hub_law: HubLaw | None = None
    on_motor = False
    mjcf_is_exact = True
    linearisable = True
    replaces: tuple[str, ...] = ()
    along: tuple[str, ...] = ()
    wave: Wave | None = None
    multiples: tuple[float, ...] = (1.0, 20.0, 300.0)

    @property
    def joint(self) -> bool:
        """Whether the parameters make no sense one by one."""
        return bool(self.along)

    @property
    def misreads(self) -> bool:
        """Whether it is in what sensors report."""
        return type(self).sensing is not Effect.sensing

    def neutral(self, rig: Mapping[str, float]) -> dict[str, float]:
        """Values at which the model is exactly the one without this effect."""
        return {p.name: rig[p.name] if p.neutral is None else p.neutral for p in self.parameters}

    def free(self, values: Mapping[str, float]) -> tuple[EffectParameter, ...]:
        """Parameters that a fit may move where the effect stands at these values."""
        return tuple(p for p in self.parameters if not p.choice)

    def units(self, values: Mapping[str, float]) -> dict[str, str]:
        """Parameter -> SI unit where the effect stands at these values."""
        return {p.name: p.unit for p in self.parameters}

    def resolved(self, values: Mapping[str, float], period: float) -> bool:
        """Whether an effect of this size is more than what good sensors, and a card of this period [s], leave open."""
        return True

    def starts(self, rig: Mapping[str, float]) -> tuple[dict[str, float], ...]:
        """Values close to neutral from which a search can leave it: one per direction that it should try."""
        neutral = self.neutral(rig)
        return ({p.name: p.turned(p.turned(neutral[p.name]) + p.step) for p in self.parameters},)

    def linear(self, p: Mapping[str, float]) -> tuple[float, ...]:
        """Coefficients in which its force is linear, small ones; none where parameters that are free have no such."""
        return ()

    def of_linear(self, coefficients: Sequence[float]) -> dict[str, float] | None:
        """Parameters of these coefficients; None where there are none."""
        return None

    def at_order(self, order: float, coefficients: tuple[float, ...]) -> dict[str, float]:
        """Parameters of a wave of this order whose sine and cosine have these coefficients."""
        assert self.wave is not None
        sine, cosine = coefficients[:2]
        return {
            "amplitude": math.hypot(sine, cosine),
            self.wave.order: order,
            "phase": math.atan2(cosine, sine),
        }

    def rig(self, rig: Rig, p: Mapping[str, float]) -> Rig:
        """Changes parameters of the rig itself."""
        return rig

    def links(self, links: Chain, rig: Rig, p: Mapping[str, float]) -> Chain:
        """Changes the chain of the rig."""
        return links

    def plant(self, plant: Plant, p: Mapping[str, float]) -> Plant:
        """Switches on a mechanism of the equations of motion."""
        return plant

    def hub_torque(self, p: Mapping[str, float]) -> HubTorque | None:
        """Torque on the hub; None where the effect adds none."""
        if self.hub_law is None:
            return None
        writes = type(self).write_mjcf is not Effect.write_mjcf
        write = functools.partial(self.write_mjcf, p=p) if writes else None
        values = tuple(float(p[q.name]) for q in self.parameters)
        return HubTorque(self.name, self.hub_law, values, self.on_motor, write, self.mjcf_is_exact)

    def write_mjcf(self, spec: MjSpec, joint: str, p: Mapping[str, float]) -> None:
        """Writes a `hub_law` that is not linear into a MuJoCo specification, for the joint of this name.

        Linear ones become stiffness and damping of the joint without it; what is not written is said to be left out.
        """

    def reading(self, reading: Reading, channel: str, p: Mapping[str, float]) -> Reading | None:
        """What `sensing` makes of the reading of a channel, in terms that MJCF has; None where it has none."""
        return None if self.misreads else reading

    def drive(self, drive: Drive, p: Mapping[str, float]) -> Drive:
        """Turns commanded torque (after saturation) into delivered torque."""
        return drive

    def sensing(
        self, time: np.ndarray, channels: dict[str, np.ndarray], p: Mapping[str, float]
    ) -> dict[str, np.ndarray]:
        """Turns true channel values (name -> (m,), SI) into what the sensors report."""
        return channels

    def hub_late(self, p: Mapping[str, float]) -> float:
        """By how much the hub's reading lags behind its angle [s]."""
        return 0.0

    def hub_angle_of(self, time: np.ndarray, reading: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Hub angle (m,) that the sensor reports as `reading`: the fixed point of reading + angle - report."""
        angle = np.array(reading, dtype=float)
        for _ in range(50):
            off = reading - self.sensing(time, {"hub_angle": angle}, p)["hub_angle"]
            angle = angle + off
            if np.all(np.abs(off) < 1e-9):
                break
        return angle

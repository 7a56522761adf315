"""The interface of an effect: parameters with a neutral value at which it vanishes, and hooks that change the model."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

import numpy as np

from twin.effects.reading import Reading
from twin.effects.wave import Wave
from twin.errors import InputError, checked_number, quoted
from twin.mechanics.chain import Chain
from twin.mechanics.hub_law import HubLaw, HubTorque
from twin.mechanics.plant import Plant
from twin.parameters import PARAMETERS, Rig
from twin.recording import Sensor

if TYPE_CHECKING:
    from mujoco import MjSpec

TORSION = "torsion"
"""Channel in which `Effect.sensing` receives the angle of a torsional mode against the hub [rad]."""

TIMING_TOLERANCE = 0.1
"""Share of a sample period within which the instants of output and sampling of a card are not declared."""

FAR_MULTIPLES = tuple(np.geomspace(1, 3000, 28).tolist())
"""`Effect.search_multiples` of effects that change the frequencies of the link: visible from a relative change of 1e-4,
and possibly far larger."""


# Values that a rig can have, wider than what a search tries: beyond them a model says nothing of any rig.
TIMES = (0.0, 10.0)
"""Delays and time constants [s]: of a longer one, an experiment of 5 to 20 s shows nothing."""
TORQUES = PARAMETERS["static_friction"][1]
"""Magnitude of a torque on the hub [N m]."""
ANGLES = (-1e3, 1e3)
"""Phases, directions and rest angles [rad]: whole turns are allowed, and keep 12 digits of a sine."""
GAIN_ERRORS = (1e-3, 1e3)
"""Gain errors [1]: none is 0, which is a dead channel, or negative, which is a sign in the campaign."""
ORDERS = (1e-2, 1e3)
"""Periods per turn [1]."""
DRAG = (0.0, 1e3)
"""Drag and viscous friction per length or angle, in the effect's unit."""

_LARGEST = 1e12
"""Magnitude of a parameter of another package that says nothing else: larger ones leave a double 4 digits of a rig."""


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect.

    Attributes:
      name: of the parameter.
      unit: SI unit.
      neutral: value at which the effect vanishes; None if this is the declared value of the rig parameter.
      bounds: of a fit.
      possible: smallest and largest value that a rig can have; None for any of the sign of `bounds`. Files and callers
        are held to it, and rigs drawn from the uncertainty.
      step: small change that is visible in the data, from which a search starts.
      channel: channel without which the parameter has no influence, or None.
      inverse: whether a fit uses the reciprocal of the value, as of a stiffness whose neutral value is infinite.
        `bounds` are of the value, `step` is of the reciprocal.
      choice: whether it selects one of several laws: it is given by `Effect.starts` and never fitted.
    """

    name: str
    unit: str
    neutral: float | None
    bounds: tuple[float, float]
    step: float
    channel: str | None = None
    inverse: bool = False
    choice: bool = False
    possible: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        low, high = self.possible_range
        if not low <= self.bounds[0] <= self.bounds[1] <= high:
            raise ValueError(
                f"{self.name} has the bounds {self.bounds}; expected them ascending, within {(low, high)}"
            )

    @property
    def possible_range(self) -> tuple[float, float]:
        """Smallest and largest value that a rig can have."""
        if self.possible is not None:
            return self.possible
        low, high = self.bounds
        return (0.0 if low >= 0 else min(low, -_LARGEST)), (0.0 if high <= 0 else max(high, _LARGEST))

    def checked(self, field: str, value: object) -> float:
        """Returns a value that a rig can have.

        Raises:
          InputError: it is none.
        """
        if not self.choice:
            return checked_number(field, value, *self.possible_range, self.unit)
        number = checked_number(field, value, *self.bounds)
        if number != round(number):
            raise InputError(f"{field} is {quoted(value)}; expected a whole number, as it is a choice")
        return number

    def turned(self, value: float) -> float:
        """The value, or its reciprocal if `inverse`: from value to fitted number and back."""
        if not self.inverse:
            return value
        return 1 / value if value else math.inf

    @property
    def span(self) -> tuple[float, float]:
        """Bounds of the fitted number."""
        low, high = sorted(self.turned(value) for value in self.bounds)
        return low, high


@dataclass(frozen=True)
class Drive:
    """Torque that the drive delivers: a zero-order hold followed by a first-order lag.

    Attributes:
      time: (k) instants [s] from which each value is held.
      torque: (k) [N m].
      before: torque before the first instant [N m].
      lag: time constant [s].
    """

    time: np.ndarray
    torque: np.ndarray
    before: float = 0.0
    lag: float = 0.0

    @property
    def inputs(self) -> tuple[np.ndarray, np.ndarray, float, float]:
        """All that determines it."""
        return self.time, self.torque, self.before, self.lag

    def replace(self, **changes) -> Drive:
        """A drive with some attributes changed."""
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
        """Delivered torque after the lag at the instants (k) at which the command changes [N m]."""
        targets = np.r_[self.before, self.torque[:-1]]
        if self.lag <= 0:
            return targets
        kept = np.exp(-np.diff(self.time, prepend=self.time[0]) / self.lag)
        reached, torque = np.empty(len(targets)), self.before
        for k, (target, share) in enumerate(zip(targets.tolist(), kept.tolist(), strict=True)):
            reached[k] = torque = target + (torque - target) * share
        return reached

    def impulse(self, t: np.ndarray) -> np.ndarray:
        """Integral of the delivered torque up to the instants t (m,), up to a constant [N m s].

        By the first-order lag, lag y' = u - y, the integral of y is the integral of u minus lag y.
        """
        first = min(t[0], self.time[0]) - 1.0
        knots = np.maximum.accumulate(np.r_[first, self.time, max(t[-1], self.time[-1]) + 1.0])
        held = np.r_[0.0, np.cumsum(np.diff(knots) * np.r_[self.before, self.torque])]
        whole = np.interp(t, knots, held)
        return whole - self.lag * self.at(t) if self.lag > 0 else whole


class Effect:
    """A physical effect that the model may lack. Each hook is the identity unless a subclass overrides it.

    A subclass overrides the hooks of the part of the model that it changes:

        rig, links     parameters of the rig, its chain of segments
        plant          mechanisms of the equations of motion: friction, link, motor
        hub_law        a torque on the hub, a function of time, angle and rate
        drive          from commanded to delivered torque
        sensing        from true values to sensor readings

    Class attributes:
      name: key in the registry, lower case with hyphens.
      meaning: what the model lacks, to follow "The model lacks NAME: ".
      acts_on: the part of the rig that it belongs to.
      seen_as: how it looks in recordings; for the documentation, as the two below.
      mistaken_for: effect that looks alike -> what tells the two apart.
      source: where the law is from.
      parameters: an `EffectParameter` for each.
      hub_law: torque on the hub, see `twin.mechanics.hub_law`; its values are the parameters in their order.
      on_motor: whether, with backlash, `hub_law` acts on the motor.
      mjcf_is_exact: whether the element that `write_mjcf` adds is exact with any time step.
      linearisable: whether a model linearised about a state can represent it. Whether `hub_law` is linear is found by
        evaluating it.
      undefined_at_neutral: parameters without influence at neutral, such as a phase or a rest angle. A search takes
        them from `starts` as they are; all other parameters are scaled along a ray from neutral.
      wave: how the effect is periodic, if a spectrum has to give its order.
      replaces: declared parameters that the effect replaces: they are no longer calibrated within their uncertainty.
      hidden_by: declared parameter -> its change, per unit of the effect's first parameter, that hides most of the
        effect.
      channel_errors: parameter -> errors of channels that it is, each ("gain" or "delay", channel). Where a campaign
        declares how uncertain these are, they are fitted; the effect replaces them, as a declared parameter.
      measured_by: the channel without which nothing tells its size but the declared values of other parameters.
      smooth_at_neutral: whether the score test holds: its derivative at neutral tells the gain of the effect's size.
      search_multiples: multiples of the smallest visible size at which a search evaluates the effect before a fit.
    """

    name: str
    meaning: str
    acts_on: Literal["drive", "hub", "link", "payload", "sensors"]
    seen_as = ""
    mistaken_for: Mapping[str, str] = MappingProxyType({})
    source = ""
    parameters: tuple[EffectParameter, ...]
    hub_law: HubLaw | None = None
    on_motor = False
    mjcf_is_exact = True
    linearisable = True
    replaces: tuple[str, ...] = ()
    undefined_at_neutral: tuple[str, ...] = ()
    wave: Wave | None = None
    hidden_by: Mapping[str, float] = MappingProxyType({})
    channel_errors: Mapping[str, tuple[tuple[str, str], ...]] = MappingProxyType({})
    measured_by: str | None = None
    smooth_at_neutral = True
    search_multiples: tuple[float, ...] = (1.0, 20.0, 300.0)

    @property
    def is_coupled(self) -> bool:
        """Whether the parameters have to be varied together, because some are undefined at neutral."""
        return bool(self.undefined_at_neutral)

    def replaced_errors(self, p: Mapping[str, float]) -> set[tuple[str, str]]:
        """Those of `channel_errors` that the effect is at these values."""
        return {error for errors in self.channel_errors.values() for error in errors}

    @property
    def delays_readings(self) -> bool:
        """Whether it shows the motion at other instants."""
        errors = {kind for errors in self.channel_errors.values() for kind, _ in errors}
        return self.acts_on_readings and "delay" in errors

    @property
    def acts_on_readings(self) -> bool:
        """Whether it changes sensor readings."""
        return type(self).sensing is not Effect.sensing

    def neutral(self, rig: Mapping[str, float]) -> dict[str, float]:
        """Values at which the model equals the one without this effect."""
        return {p.name: rig[p.name] if p.neutral is None else p.neutral for p in self.parameters}

    def checked(self, given: Mapping[str, object], rig: Mapping[str, float]) -> dict[str, float]:
        """Returns values that a rig can have, neutral ones where none are given.

        Raises:
          InputError: no rig can have a value.
        """
        values = self.neutral(rig)
        for p in self.parameters:
            if p.name in given:
                values[p.name] = p.checked(f"effects.{self.name}.{p.name}", given[p.name])
        return values

    def free_parameters(self, values: Mapping[str, float]) -> tuple[EffectParameter, ...]:
        """Parameters that a fit varies when the effect has these values."""
        return tuple(p for p in self.parameters if not p.choice)

    def units(self, values: Mapping[str, float]) -> dict[str, str]:
        """Parameter -> SI unit when the effect has these values."""
        return {p.name: p.unit for p in self.parameters}

    def is_resolved(self, values: Mapping[str, float], period: float) -> bool:
        """Whether the effect exceeds the tolerance of good sensors and of a card with this sample period [s]."""
        return True

    def starts(self, rig: Mapping[str, float]) -> tuple[dict[str, float], ...]:
        """Values near neutral, one for each direction in which a search should leave it."""
        neutral = self.neutral(rig)
        return ({p.name: p.turned(p.turned(neutral[p.name]) + p.step) for p in self.parameters},)

    def other_minima(self, values: Mapping[str, float]) -> tuple[dict[str, float], ...]:
        """Values from which a fit to output errors begins, too, as its cost may have minima apart from this one."""
        return ()

    def fits(self, values: Mapping[str, float], sensors: Mapping[str, Sensor]) -> bool:
        """Whether these values agree with what is declared of the sensors."""
        return True

    def taken_over(self, p: Mapping[str, float], parameter: str, value: float, unit: str) -> float:
        """Value of another parameter of a rig without this effect that behaves most alike.

        Args:
          p: the effect's parameters.
          parameter: name of the other one, of an effect's with that of the effect before it: `effect.parameter`.
          value, unit: of the other one beside the effect, SI.
        """
        return value - self.hidden_by.get(parameter, 0.0) * p[self.parameters[0].name]

    def linear_coefficients(self, p: Mapping[str, float]) -> tuple[float, ...]:
        """Coefficients in which the force of the effect is linear; empty if there are none."""
        return ()

    def from_linear_coefficients(self, coefficients: Sequence[float]) -> dict[str, float] | None:
        """Inverse of `linear_coefficients`; None where no parameters have these coefficients."""
        return None

    def wave_parameters(self, order: float, coefficients: tuple[float, ...]) -> dict[str, float]:
        """Parameters of the wave of this order with these coefficients of sine and cosine."""
        assert self.wave is not None
        sine, cosine = coefficients[:2]
        return {
            "amplitude": math.hypot(sine, cosine),
            self.wave.order: order,
            "phase": math.atan2(cosine, sine),
        }

    def rig(self, rig: Rig, p: Mapping[str, float]) -> Rig:
        """The rig with its parameters changed."""
        return rig

    def links(self, links: Chain, rig: Rig, p: Mapping[str, float]) -> Chain:
        """The chain of segments, changed."""
        return links

    def plant(self, plant: Plant, p: Mapping[str, float]) -> Plant:
        """The equations of motion with a mechanism switched on."""
        return plant

    def hub_torque(self, p: Mapping[str, float]) -> HubTorque | None:
        """Torque on the hub by `hub_law`; None if there is none."""
        if self.hub_law is None:
            return None
        writes = type(self).write_mjcf is not Effect.write_mjcf
        write = functools.partial(self.write_mjcf, p=p) if writes else None
        values = tuple(float(p[q.name]) for q in self.parameters)
        return HubTorque(self.name, self.hub_law, values, self.on_motor, write, self.mjcf_is_exact)

    def placed(self, torque: HubTorque, p: Mapping[str, float]) -> HubTorque:
        """The torque of another effect, on the side of this one's backlash where it acts."""
        return torque

    def write_mjcf(self, spec: MjSpec, joint: str, p: Mapping[str, float]) -> None:
        """Adds a nonlinear `hub_law` to a MuJoCo specification, at the joint of this name.

        Linear laws become stiffness and damping of the joint without this hook. A law that is not written is reported
        as left out.
        """

    def reading(self, reading: Reading, channel: str, p: Mapping[str, float]) -> Reading | None:
        """The reading of a channel after `sensing`, in terms of MJCF elements; None where there are none."""
        return None if self.acts_on_readings else reading

    def drive(self, drive: Drive, p: Mapping[str, float]) -> Drive:
        """Delivered torque for the commanded torque after saturation."""
        return drive

    def sensing(
        self, time: np.ndarray, channels: dict[str, np.ndarray], p: Mapping[str, float]
    ) -> dict[str, np.ndarray]:
        """Sensor readings for true channel values (name -> (m,), SI)."""
        return channels

    def hub_delay(self, p: Mapping[str, float]) -> float:
        """Delay of the hub angle reading [s]."""
        return 0.0

    def hub_angle_of(self, time: np.ndarray, reading: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Hub angle (m,) for a sensor reading (m,): the inverse of `sensing`, by fixed-point iteration."""
        angle = np.array(reading, dtype=float)
        for _ in range(50):
            off = reading - self.sensing(time, {"hub_angle": angle}, p)["hub_angle"]
            angle = angle + off
            if np.all(np.abs(off) < 1e-9):
                break
        return angle

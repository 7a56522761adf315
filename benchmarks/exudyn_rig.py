"""A second engine for campaigns of the virtual rig: Exudyn's cable elements under its implicit trapezoidal rule.

    make_campaign(folder, effects, seed, engine=exudyn_engine)

Link, hub and payload, their damping and the contact of a backlash are Exudyn's, see `exudyn_model`. What acts on the
hub from outside, drive, friction, cable and controller, and what sensors make of a motion are those of the virtual rig:
they are the definition of the effects, not mechanics.

A stuck hub is held by a constraint on its velocity, whose Lagrange multiplier is the holding torque: it does not creep.
Stick and slip events are found to `EVENT` by repeating a step with another length. At an event, and at a new command,
consistent accelerations are computed before the next step, so that the rule stays of second order.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass

import exudyn_model
import numba
import numpy as np
from cases import VIRTUAL_RIG_ALONE
from exudyn_model import exudyn

from twin.errors import InputError
from twin.virtual_rig import plant
from twin.virtual_rig.beam import Array
from twin.virtual_rig.experiments import Experiment, conducted
from twin.virtual_rig.plant import STUCK, Drive, Loop
from twin.virtual_rig.rig import Rig
from twin.virtual_rig.sensors import Sensed, Sensors

STEP = 2.5e-4  # s; the period of the second free mode is then exact to 0.01 %, and 0.03 % would be two noise levels
TORSION_STEP = 1.25e-4  # s, with a torsional oscillator: of its frequency 0.01 % would be two standard errors
CONTACT_STEP = 2e-4  # s, with a backlash: a twelfth of the shortest period of the motor on its flanks
EVENT = 1e-7  # rad/s and N m, to which the velocity or the excess of torque at an event is zero
TRIALS = 6  # repetitions of a step with an event, which a secant needs at most
TINY = 1e-12  # s, N m


def exudyn_engine(rig: Rig, sensors: Sensors, plan: Experiment, times: Array, hub_noise: Array) -> Sensed:
    """Returns what the sensors are exposed to in one experiment; see `campaign_writer.Engine`.

    Raises:
        InputError: for an effect of `VIRTUAL_RIG_ALONE`.
    """
    for effect, field in VIRTUAL_RIG_ALONE.items():
        if getattr(rig, field) != 0.0:
            raise InputError(f"Exudyn's engine has no {effect}; expected another effect, or the virtual rig.")
    hub = HubLaws(rig)

    def simulated(times: Array, commands: Array, loop: Loop | None) -> Sensed:
        return Run(rig, sensors, plan, hub).simulate(times, commands, loop)

    return conducted(sensors, plan, times, hub_noise, simulated, lambda sensed: sensed.hub_angle)


class NoConvergence(RuntimeError):
    """Newton's method found no end of a step."""


class HubLaws:
    """Laws of the virtual rig for torques on the hub, compiled with the rig's parameters as constants."""

    def __init__(self, rig: Rig):
        @numba.njit
        def delivered(target: float, start: float, since: float, t: float, angle: float) -> float:
            torque = plant.drive_torque(rig, Drive(target, start, since), t)
            return torque + rig.cogging_amplitude * math.sin(rig.cogging_order * angle + rig.cogging_phase)

        @numba.njit
        def on_hub(t: float, mode: int, angle: float, rate: float) -> float:
            torque = plant.hub_torque(rig, t, angle, rate)
            if mode != STUCK:
                torque -= plant.sliding_friction(rig, t, mode, angle, rate)
            return torque

        @numba.njit
        def excess(hold: float, angle: float) -> float:
            return plant.excess(rig, hold, angle)

        self.delivered, self.on_hub, self.excess = delivered, on_hub, excess


@dataclass
class State:
    """A copy of the state at the start of a step."""

    time: float
    position: Array
    velocity: Array
    acceleration: Array


class Run:
    """An experiment from its initial state."""

    def __init__(self, rig: Rig, sensors: Sensors, plan: Experiment, hub: HubLaws):
        self.rig, self.laws, self.clamped = rig, hub, plan.clamped
        self.half_thickness, self.start_angle = sensors.half_thickness, plan.start_angle
        self.bristles = math.isfinite(rig.bristle_stiffness) and not plan.clamped
        self.loss = 2.0 * plant.CONTACT_LOSS * math.sqrt(rig.bristle_stiffness * rig.hub_inertia)
        self.mode, self.anchor, self.hold = STUCK, plan.start_angle, 0.0
        self.drive = Drive(0.0, 0.0, 0.0)
        self.rows: list[tuple[float, ...]] = []
        self.model = exudyn_model.build(rig, sensors, plan.start_angle)
        self.system = self.model.system
        usual = STEP if self.model.torsion is None else TORSION_STEP
        self.longest = usual if self.model.motor is None else min(usual, CONTACT_STEP)
        self._start(plan)
        self._begin()

    # The start.

    def _start(self, plan: Experiment) -> None:
        """Finds the static shape of the locked rig, under gravity or with its tip held aside."""
        if plan.tip_deflection is not None:
            exudyn_model.hold_tip(self.model, self.rig, plan.tip_deflection)
        elif self.rig.tilt != 0.0:
            self._set_field(0.0)
            exudyn_model.solve_static(self.system)
        if self.model.motor_lock is not None:
            self.system.SetObjectParameter(self.model.motor_lock, "activeConnector", False)
        self._set_field(0.0)

    def _begin(self) -> None:
        """Prepares Exudyn's solver and the loads on the hub."""
        self.settings = settings = exudyn_model.integration_settings()
        self.solver = exudyn.MainSolverImplicitSecondOrder()
        load = self.system.SetLoadParameter
        if self.model.torque == self.model.friction:
            load(
                self.model.torque,
                "loadUserFunction",
                lambda _s, t, _l: self._motor_torque(t) + self._hub_torque(t),
            )
        else:
            load(self.model.torque, "loadUserFunction", lambda _s, t, _l: self._motor_torque(t))
            load(self.model.friction, "loadUserFunction", lambda _s, t, _l: self._hub_torque(t))
        if self.rig.air_drag != 0.0 or self.rig.air_pad_drag != 0.0:
            for axis, drag in enumerate(self.model.drag):
                load(drag, "loadUserFunction", lambda _s, _t, _l, axis=axis: self._drag(axis))
        self._view()
        self.solver.InitializeSolver(self.system, settings)
        self._view()
        self._lock(self.clamped or not self.bristles)
        self._restart()
        self._note()

    def _view(self) -> None:
        """Takes views of Exudyn's current state."""
        views = self.system.systemData.GetSystemStateDict(reference=True)
        self.position, self.velocity = views["ODE2Coords"], views["ODE2Coords_t"]
        self.acceleration, self.multipliers = views["ODE2Coords_tt"], views["AECoords"]

    # Loads.

    @property
    def angle(self) -> float:
        """Hub angle [rad]."""
        return self.start_angle + self.position[self.model.hub]

    @property
    def rate(self) -> float:
        """Hub rate [rad/s]."""
        return self.velocity[self.model.hub]

    def _motor_torque(self, t: float) -> float:
        """Returns the torque of drive and cogging [N m]."""
        motor = self.model.motor
        turned = self.angle if motor is None else self.start_angle + self.position[motor]
        return self.laws.delivered(*self.drive, t, turned)

    def _hub_torque(self, t: float) -> float:
        """Returns the other torques on the hub, friction of a sliding one or of bristles among them [N m]."""
        torque = self.laws.on_hub(t, self.mode, self.angle, self.rate)
        if self.mode == STUCK and self.bristles:
            torque -= self._bristle_torque() + self.loss * self.rate
        return torque

    def _bristle_torque(self) -> float:
        return self.rig.bristle_stiffness * (self.angle - self.anchor)

    def _drag(self, axis: int) -> float:
        """Returns the force of the air on the tip along an axis [N]: -(b + c |v|) v."""
        vx, vy = self.velocity[self.model.tip], self.velocity[self.model.tip + 1]
        drag = self.rig.air_pad_drag + self.rig.air_drag * math.hypot(vx, vy)
        return -drag * (vx, vy)[axis]

    def _set_field(self, t: float) -> None:
        """Sets what changes with time alone: the field on every mass [m/s^2], and the stiffness of a warming link."""
        rig = self.rig
        if rig.tilt != 0.0 or rig.disturbance_acceleration != 0.0:
            field = [*plant.body_field.py_func(rig, t, 0.0), 0.0]
            for weight in self.model.weights:
                self.system.SetLoadParameter(weight, "loadVector", field)
        if rig.fading != 0.0:
            left = 1.0 - rig.fading * (1.0 - math.exp(-t / rig.fading_time))
            for cable in self.model.cables:
                self.system.SetObjectParameter(cable, "bendingStiffness", left * rig.bending_stiffness)

    # Steps.

    def _lock(self, locked: bool) -> None:
        self.locked = locked
        self.system.SetObjectParameter(self.model.lock, "activeConnector", locked)

    def _restart(self) -> None:
        """Computes consistent accelerations and the holding torque for the forces of this instant."""
        data, t = self.system.systemData, self.solver.it.currentTime
        self._set_field(t)
        data.SetSystemState(data.GetSystemState(), configuration=exudyn.ConfigurationType.Initial)
        self.settings.timeIntegration.startTime = t
        self.solver.InitializeSolverInitialConditions(self.system, self.settings)
        self._hold()

    def _hold(self) -> None:
        """Takes the holding torque from the multipliers of the constraints, or from the bristles [N m]."""
        if self.locked:
            self.hold = float(self.multipliers[self.model.lock_row])
        elif self.mode == STUCK:
            self.hold = self._bristle_torque()

    def _saved(self) -> State:
        return State(
            self.solver.it.currentTime, self.position.copy(), self.velocity.copy(), self.acceleration.copy()
        )

    def _go_back(self, before: State) -> None:
        """Goes back to a state before a step."""
        self.solver.it.currentTime = before.time
        self.position[:], self.velocity[:] = before.position, before.velocity
        self._restart()

    def _repeat(self, before: State, h: float) -> float:
        """Repeats a step from its start with another length [s]; returns its length, see `_step_from`."""
        self._go_back(before)
        return self._step_from(before, h)

    def _step(self, h: float) -> None:
        """Integrates one step of length h [s]."""
        it = self.solver.it
        it.currentStepSize = h
        self._set_field(it.currentTime + h)
        self.solver.InitializeStep(self.system, self.settings)
        if not self.solver.DiscontinuousIteration(self.system, self.settings):
            raise NoConvergence(f"Exudyn's step at {it.currentTime:g} s did not converge.")
        self._hold()

    def _step_from(self, before: State, h: float) -> float:
        """Integrates one step of length h [s], halved where Newton's method circles about the edge of a contact.

        Returns its length.
        """
        try:
            self._step(h)
        except NoConvergence:
            h *= 0.5
            self._go_back(before)
            self._step(h)
        return h

    def _violation(self) -> float:
        """Returns what is positive after the end of a mode: reversed rate, or torque above the static level."""
        if self.mode == STUCK:
            return self.laws.excess(self.hold, self.angle)
        return -self.mode * self.rate

    def _advance(self, end: float) -> None:
        """Integrates to `end` [s] under one held command."""
        while (rest := end - self.solver.it.currentTime) > TINY:
            before, at_start = self._saved(), self._violation()
            h = self._step_from(before, rest / max(math.ceil(rest / self.longest - 1e-6), 1))
            if not self.clamped:
                h = self._to_dip(before, h)
                if (at_end := self._violation()) > 0.0:
                    self._to_event(before, h, min(at_start, 0.0), at_end)
                    self._change_mode()
            self._note()

    def _to_dip(self, before: State, h: float) -> float:
        """Repeats a step in which a sliding hub reversed twice up to its largest reversed rate; returns its length."""
        if self.mode == STUCK:
            return h
        hub, side = self.model.hub, self.mode
        ends = (before.velocity[hub], self.velocity[hub], before.acceleration[hub], self.acceleration[hub])
        dip = plant.lowest_time(h, *(side * value for value in ends))
        if dip <= 1e-9:
            return h
        return self._repeat(before, dip)

    def _to_event(self, before: State, h: float, low_value: float, high_value: float) -> None:
        """Repeats a step so that it ends at its event, by the rule of false position (Illinois)."""
        low, high = 0.0, h
        for _ in range(TRIALS):
            middle = low + (high - low) * low_value / (low_value - high_value)
            middle = min(max(middle, 1e-3 * h), h)
            middle = self._repeat(before, middle)
            value = self._violation()
            if abs(value) < EVENT:
                return
            if value > 0.0:
                high, high_value, low_value = middle, value, 0.5 * low_value
            else:
                low, low_value, high_value = middle, value, 0.5 * high_value

    def _change_mode(self) -> None:
        """A sliding hub sticks or slides on the other way, a stuck one slides."""
        if self.mode == STUCK:
            self._slide(1 if self.hold > 0.0 else -1)
            return
        if self.bristles:
            # Bristles begin with the deflection at which their torque is that of sliding.
            bent = plant.sliding_friction(self.rig, self.solver.it.currentTime, self.mode, self.angle, 0.0)
            self.anchor = self.angle - bent / self.rig.bristle_stiffness
            self.mode = STUCK
            self._restart()
            return
        self.mode = STUCK
        self._lock(True)
        self._restart()
        if self._violation() > 0.0:
            self._slide(1 if self.hold > 0.0 else -1)

    def _slide(self, direction: int) -> None:
        self.mode = direction
        self._lock(False)
        self._restart()

    # Commands and readings.

    def _note(self) -> None:
        """Records time, hub angle, strain of the gauges and angle of the torsional oscillator."""
        torsion = 0.0
        if self.model.torsion is not None:
            torsion = self.position[self.model.torsion] - self.position[self.model.hub]
        strains = (self.half_thickness * k for k in exudyn_model.gauge_curvatures(self.model))
        self.rows.append((self.solver.it.currentTime, self.angle, *strains, torsion))

    def simulate(self, times: Array, commands: Array, loop: Loop | None) -> Sensed:
        """Returns what the sensors are exposed to; see `plant.simulate`."""
        issued = np.array(commands, dtype=float)
        errors, torques = np.zeros(3), np.zeros(2)
        readings = np.maximum(times - self.rig.sensor_delay, 0.0)
        for k, given in enumerate(times + self.rig.actuator_delay):
            self._advance(float(given))
            if loop is not None:
                theta = plant.sensed_hub.py_func(self.rig, self._angle_at(float(readings[k])))
                read = plant.quantised(theta + loop.noise[k], loop.sensor_step)
                issued[k] = plant.controlled(loop, k, read, errors, torques)
            self._command(float(given), float(issued[k]))
        rows = np.array(self.rows)
        seen = [np.interp(readings, rows[:, 0], column) for column in rows[:, 1:].T]
        return Sensed(issued, seen[0], np.column_stack(seen[1:3]), seen[3])

    def _command(self, t: float, command: float) -> None:
        """Holds a new command from now on."""
        start = plant.drive_torque(self.rig, self.drive, t)
        before = self.drive.target if self.rig.actuator_lag <= 0.0 else start
        self.drive = Drive(plant.saturated(self.rig, command), start, t)
        after = self.drive.target if self.rig.actuator_lag <= 0.0 else start
        if abs(after - before) > TINY:
            self._restart()
        if self.mode == STUCK and not self.clamped and self._violation() > 0.0:
            self._slide(1 if self.hold > 0.0 else -1)

    def _angle_at(self, t: float) -> float:
        """Returns the hub angle at an earlier time [rad]."""
        k = min(max(bisect_left(self.rows, (t,)), 1), len(self.rows) - 1)
        (t0, before), (t1, after) = self.rows[k - 1][:2], self.rows[k][:2]
        share = (t - t0) / (t1 - t0) if t1 > t0 else 1.0
        return before + min(max(share, 0.0), 1.0) * (after - before)

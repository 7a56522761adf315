"""The rig simulated by MuJoCo, with stick and slip of the hub located inside a step.

Two compiled models are used in turn: one with the hub's joint while the hub slides, and one without it while the hub
sticks or is locked, so that it cannot creep. Both step with MuJoCo's RK4. Where friction acts on a motor behind a
backlash, what is said of the hub here holds for the motor, and the model without its joint is a third one.

Friction is that of `twin.mechanics.planar`, with which a test compares this module. While the hub slides, it is a
torque of constant direction. Where the hub's rate would cross zero, the step is repeated up to the crossing; there the
hub sticks if the torque that holds it does not exceed the static level. Evaluated at the same state in the model with
the joint, that torque is

    needed = theta_tt / (M^-1)_00          theta_tt: acceleration of a hub without dry friction

Forces that `mjcf.dynamics_spec` has no element for are applied in a control callback at every stage of a step, so that
the integration remains of fourth order. The callback is global to the process: it is set during a call only, and two
simulations with such forces cannot run in two threads of one process.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import mujoco
import numpy as np

from twin.mechanics.chain import Chain
from twin.mechanics.hub_law import HubTorque
from twin.mechanics.mujoco_model import ChainModel
from twin.mechanics.planar import EVENT_TOLERANCE
from twin.mechanics.plant import Plant

_NO_TIME = 1e-12  # s, remainder of a span by rounding
_LONGEST_UNCHECKED = 2.5e-3
"""Longest time between two checks for stick and slip [s]: 1/10 of the third mode's period."""


class _Rows(NamedTuple):
    """Rows of a simulation: instants (m) [s]; angles and rates of the joints (m, n + 1), to be written."""

    time: list[float]
    angles: np.ndarray
    rates: np.ndarray


class MujocoChain:
    """A chain with its friction and mechanisms, simulated by MuJoCo; keeps its state between calls.

    Angles and rates of the interface are absolute, as in `twin.mechanics.planar`: of the n + 1 segments, the hub's
    first, then of appended coordinates. Commands are not limited: that is up to the caller.
    """

    def __init__(
        self, rig: Mapping[str, float], chain: Chain, plant: Plant, torques: Sequence[HubTorque] = ()
    ) -> None:
        """Compiles both models.

        Args:
          rig: hub_inertia, tip_mass, tip_inertia.
          chain: the segments.
          plant: the numbers of its equations of motion; their inertia must be that of the chain.
          torques: the hub torques of the plant.

        Raises:
          ValueError: plant and chain, or plant and torques, do not belong together.
        """
        if mujoco.get_mju_user_warning() is None:
            # MuJoCo would write MUJOCO_LOG.TXT into the working directory; a plant that diverges is reported as such.
            mujoco.set_mju_user_warning(_ignore)
        self._plant, self._size, self._links = plant, len(plant.link.lengths), len(chain.lengths)
        self._largest_step, self._plant_step = chain.largest_step(), plant.largest_step
        # A contact of the backlash lasts a few steps only: check after each.
        self._unchecked = 0.0 if plant.motor.gap > 0 else _LONGEST_UNCHECKED
        self._sliding = ChainModel(rig, chain, plant, torques, "")
        self._clamp = ChainModel(rig, chain, plant, torques, "hub")
        self._stuck = ChainModel(rig, chain, plant, torques, "rotor") if plant.rubs_on_motor else self._clamp
        self._time = 0.0
        self.reset(np.zeros(self._size))

    # State

    @property
    def time(self) -> float:
        """Time [s]."""
        return self._time

    @property
    def mode(self) -> int:
        """0 while the hub sticks or is locked, else the direction +1 or -1 in which it slides."""
        return self._mode

    @property
    def torque(self) -> float:
        """Delivered torque of the motor now [N m], lag included."""
        return self._delivered(self._time)

    @property
    def joints(self) -> np.ndarray:
        """Joint angles, hub and hinges (n + 1) [rad]: the qpos of `mjcf.build_spec`'s model."""
        return self._write_state(np.empty(self._size), np.empty(self._size))[0]

    @property
    def angles(self) -> np.ndarray:
        """Absolute angles of the segments (n + 1) [rad]."""
        return self._absolute(self.joints)

    @property
    def rates(self) -> np.ndarray:
        """Absolute rates of the segments (n + 1) [rad/s]."""
        return self._absolute(self._write_state(np.empty(self._size), np.empty(self._size))[1])

    def reset(
        self,
        phi: np.ndarray,
        omega: np.ndarray | None = None,
        mode: int = 0,
        time: float = 0.0,
        clamped: bool = False,
        torque: float = 0.0,
    ) -> None:
        """Sets the state.

        Args:
          phi: absolute angles (n + 1) [rad].
          omega: absolute rates (n + 1) [rad/s]; 0 by default.
          mode: 0 the hub sticks, +1 or -1 it slides.
          time: time [s].
          clamped: the hub is locked.
          torque: torque that was delivered until now [N m], from which an actuator lag starts.
        """
        rates = np.zeros(len(phi)) if omega is None else omega
        self._time, self._mode, self._clamped = float(time), int(mode), bool(clamped)
        self._u = self._u_before = float(torque)
        self._since = self._time
        self._last_margin, self._margin_change = math.nan, 0.0
        self._at_rest = 0.0  # rad, of what is locked
        qpos, qvel = self._relative(phi), self._relative(rates)
        if self._is_locked:
            self._lock(qpos, qvel)
        else:
            self._sliding.set_state(qpos, qvel)

    # Motion

    def advance(self, torque: float, span: float, h_max: float | None = None) -> None:
        """Integrates over `span` [s] under a held torque command [N m].

        Steps are at most `h_max` [s], by default the largest that is stable.
        """
        self._command(torque)
        with self._control_callback():
            self._advance(span, self._largest_step if h_max is None else h_max)

    def simulate(
        self,
        command_time: np.ndarray,
        command: np.ndarray,
        out_time: np.ndarray,
        phi0: np.ndarray,
        omega0: np.ndarray,
        mode0: int = 0,
        clamped: bool = False,
        h_max: float | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Integrates from out_time[0] to out_time[-1]; arguments and results are those of `planar.simulate`.

        Args:
          command_time, command: (k) instants [s] and torque [N m] held from each to the next; 0 before them.
          out_time: (m) instants at which the state is returned [s].
          phi0, omega0: (n + 1) state at out_time[0].
          mode0: 0 hub sticks, +1 or -1 it slides.
          clamped: the hub is locked.
          h_max: largest step [s], by default the largest that is stable.

        Returns:
          (m, n + 1) angles [rad], (m, n + 1) rates [rad/s], (m) mode.
        """
        start = float(out_time[0])
        self.reset(phi0, omega0, mode0, start, clamped)
        instants, torques = _commands_from(start, command_time, command)
        if (settled := int(np.searchsorted(command_time, start - 1e-9)) - 1) >= 0:
            self._u = self._u_before = float(command[settled])
        angles, rates = np.empty((len(out_time), len(phi0))), np.empty((len(out_time), len(phi0)))
        rows, modes = _Rows(out_time.tolist(), angles, rates), np.empty(len(out_time))
        h_largest = self._largest_step if h_max is None else h_max
        pointer, row, wanted = 0, 0, rows.time
        with self._control_callback():
            while row < len(wanted):
                while pointer < len(instants) and instants[pointer] <= self._time + _NO_TIME:
                    self._command(torques[pointer])
                    pointer += 1
                held = instants[pointer] if pointer < len(instants) else math.inf
                count = self._several_rows(rows, row, held, h_largest)
                if count == 0 and (left := min(wanted[row], held) - self._time) > _NO_TIME:
                    self._advance(left, h_largest)
                if count == 0 and self._time >= wanted[row] - _NO_TIME:
                    self._write_state(angles[row], rates[row])
                    count = 1
                modes[row : row + count] = self._mode
                row += count
        return self._absolute(angles), self._absolute(rates), modes

    # Integration

    def _several_rows(self, rows: _Rows, row: int, held: float, h_max: float) -> int:
        """Integrates over rows in the present mode and writes them, while its end is far.

        A sliding hub is checked at each row, and one that sticks at the last, as that takes its accelerations.

        Args:
          rows: to be written.
          row: the first that is not written.
          held: until when the command is [s].
          h_max: largest step [s].

        Returns:
          How many rows were written; 0 where the end may be near, or no row is before the next check.
        """
        locked, start = self._is_locked, self._time
        sticks = locked and not self._clamped
        until = min(held, start + self._unchecked) if sticks else held
        before = math.inf if self._clamped else self._last_margin if sticks else self._mode_margin()
        # Not a number of one that sticks behind a command, and where the mode has changed.
        is_next = start + _NO_TIME < rows.time[row] <= min(until, start + self._unchecked)
        if not (is_next and before > 2 * self._margin_change):
            return 0
        write, model = (self._locked_rows, self._locked) if locked else (self._sliding_rows, self._sliding)
        model.save()
        model.apply_torque(self._u, 0 if locked else self._mode)
        last = write(rows, row, until, min(h_max, self._plant_step))
        if not sticks:
            return last - row
        self._last_margin = self._stiction_margin()
        self._margin_change = abs(self._last_margin - before)
        if min(before, self._last_margin) > self._margin_change:
            return last - row
        model.restore()
        self._time, self._last_margin = start, before
        return 0

    def _locked_rows(self, rows: _Rows, row: int, until: float, h_max: float) -> int:
        """Integrates a hub that is locked or sticks over the rows until a time [s]; returns the first row behind."""
        first, model, (wanted, angles, rates) = row, self._locked, rows
        others = angles[:, self._others], rates[:, self._others]
        while row < len(wanted) and wanted[row] <= until:
            span = wanted[row] - self._time
            steps = 1 if span <= h_max else math.ceil(span / h_max - 1e-9)
            model.step(self._time, span / steps, steps)
            others[0][row], others[1][row] = model.qpos, model.qvel
            self._time, row = wanted[row], row + 1
        angles[first:row, self._locked_joint], rates[first:row, self._locked_joint] = self._at_rest, 0.0
        return row

    def _sliding_rows(self, rows: _Rows, row: int, until: float, h_max: float) -> int:
        """The same of a hub that slides; ends where it may come to rest."""
        model, first, (wanted, angles, rates) = self._sliding, row, rows
        mode, joint, before = self._mode, model.rubbing, self._mode_margin()
        while row < len(wanted) and wanted[row] <= until:
            span = wanted[row] - self._time
            if span > self._unchecked:
                break
            steps = 1 if span <= h_max else math.ceil(span / h_max - 1e-9)
            model.step(self._time, span / steps, steps)
            after = float(model.qvel[joint]) * mode
            self._margin_change = change = abs(after - before)
            if not (before > change and after > change):
                if row == first:
                    model.restore()
                else:
                    model.set_state(angles[row - 1], rates[row - 1])
                break
            angles[row], rates[row] = model.qpos, model.qvel
            self._time, before, row = wanted[row], after, row + 1
        self._last_margin = before
        return row

    def _absolute(self, joints: np.ndarray) -> np.ndarray:
        """Absolute angles (..., n + 1 + k) from joint angles."""
        angles = np.array(joints)
        np.cumsum(joints[..., : self._links], axis=-1, out=angles[..., : self._links])
        if self._plant.link.torsion_stiffness > 0:
            angles[..., self._links] += joints[..., 0]
        return angles

    def _relative(self, angles: np.ndarray) -> np.ndarray:
        """Joint angles (n + 1 + k) from absolute angles."""
        joints = np.array(angles, dtype=float)
        joints[: self._links] = np.diff(angles[: self._links], prepend=0.0)
        if self._plant.link.torsion_stiffness > 0:
            joints[self._links] -= angles[0]
        return joints

    @property
    def _is_locked(self) -> bool:
        return self._clamped or self._mode == 0

    def _lock(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Sets the state of the model without the joint of what is locked, from that of all joints."""
        self._locked = self._clamp if self._clamped else self._stuck
        self._locked_joint = 0 if self._clamped else self._sliding.rubbing
        self._others = slice(1, None) if self._locked_joint == 0 else slice(None, -1)
        self._at_rest = float(qpos[self._locked_joint])
        self._sliding.set_state(qpos, qvel)
        self._sliding.qvel[self._locked_joint] = 0.0
        self._sliding_others = self._sliding.qpos[self._others], self._sliding.qvel[self._others]
        self._locked.set_state(qpos[self._others], qvel[self._others])
        self._locked.lock_at(self._at_rest)

    def _write_state(self, angles: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Writes hub and hinge angles and rates to the arrays (n + 1 each); returns them."""
        if self._is_locked:
            joint, others = self._locked_joint, self._others
            angles[joint], rates[joint] = self._at_rest, 0.0
            angles[others], rates[others] = self._locked.qpos, self._locked.qvel
        else:
            angles[:], rates[:] = self._sliding.qpos, self._sliding.qvel
        return angles, rates

    def _command(self, torque: float) -> None:
        self._u_before = self._delivered(self._time)
        self._u, self._since = float(torque), self._time
        self._last_margin = math.nan

    def _delivered(self, time: float) -> float:
        """Delivered torque of the motor at a time [s] [N m], with its first-order lag behind the command."""
        if self._plant.motor.lag <= 0:
            return self._u
        return self._u + (self._u_before - self._u) * math.exp((self._since - time) / self._plant.motor.lag)

    def _advance(self, span: float, h_max: float) -> None:
        end = self._time + span
        h_max = min(h_max, self._plant_step)
        while (left := end - self._time) > _NO_TIME:
            steps = max(1, math.ceil(left / h_max - 1e-9))
            if self._clamped:
                self._locked.apply_torque(self._u, 0)
                self._locked.step(self._time, left / steps, steps)
                break
            h = left / steps
            self._move(h, min(steps, int(self._unchecked / h)))
        self._time = end

    def _move(self, h: float, steps: int) -> None:
        """Integrates in the present mode: by several steps while its end is far, else by one, or up to the mode's end.

        The end is far if the margin (see `_mode_margin`) is larger than its change over the several steps.
        """
        before = self._last_margin if self._last_margin == self._last_margin else self._mode_margin()
        if self._mode == 0 and before < 0:
            self._switch_mode()
            return
        model, start, mode = self._locked if self._mode == 0 else self._sliding, self._time, self._mode
        model.save()
        model.apply_torque(self._u, mode)
        if steps > 1 and before > 2 * self._margin_change:
            after = self._margin_after(model, start, steps * h, steps)
            self._margin_change = abs(after - before)
            if min(before, after) > self._margin_change:
                self._last_margin = after
                return
            model.restore()
            model.apply_torque(self._u, mode)

        after = self._margin_after(model, start, h)
        self._margin_change, self._last_margin = steps * abs(after - before), after
        if after < 0:
            _locate_zero(
                lambda length: self._margin_after(model, start, length), model.restore, h, before, after
            )
            self._switch_mode()

    def _margin_after(self, model: ChainModel, start: float, length: float, count: int = 1) -> float:
        """Integrates the model from the time `start` over `length` [s] by `count` steps; returns `_mode_margin`."""
        model.step(start, length / count, count)
        self._time = start + length
        return self._mode_margin()

    def _mode_margin(self) -> float:
        """Margin to the end of the present mode: rate [rad/s] of a sliding hub, or unused static friction [N m]."""
        if self._mode == 0:
            return self._stiction_margin()
        return float(self._sliding.qvel[self._sliding.rubbing]) * self._mode

    def _switch_mode(self) -> None:
        """Switches the mode at its end: the rate of a sliding hub is zero, or friction cannot hold one at rest."""
        self._last_margin, self._margin_change = math.nan, 0.0
        sliding = self._sliding
        if self._mode == 0:
            # `_stiction_margin` has just set the sliding model to this state.
            self._mode = 1 if sliding.needed > 0 else -1
            return
        sliding.qvel[sliding.rubbing] = 0.0
        needed = self._holding_torque()
        if abs(needed) > self._static(float(sliding.qpos[sliding.rubbing]), needed):
            self._mode = 1 if needed > 0 else -1
            return
        self._mode = 0
        self._lock(sliding.qpos, sliding.qvel)

    def _stiction_margin(self) -> float:
        """Static friction level less the torque that holds the hub [N m]; negative: the hub breaks away.

        Sets the model with all joints to the present state of the locked one.
        """
        self._sliding_others[0][:], self._sliding_others[1][:] = self._locked.qpos, self._locked.qvel
        needed = self._holding_torque()
        return self._static(self._at_rest, needed) - abs(needed)

    def _holding_torque(self) -> float:
        """Torque [N m] of friction, reversed, that keeps the hub at rest; at the state of the model with the joint."""
        self._sliding.apply_torque(self._u, 0)
        return self._sliding.torque_to_hold(self._time)

    def _static(self, theta: float, direction: float) -> float:
        """Static level [N m], as `planar.static_level`; avoids the cost of passing a plant to compiled code."""
        p = self._plant
        level, _ = p.friction.levels(direction)
        if p.friction.amplitude != 0:
            level += p.friction.amplitude / 2 * (1 + math.sin(p.friction.order * theta + p.friction.phase))
        return level

    @contextmanager
    def _control_callback(self) -> Iterator[None]:
        """Installs the control callback during a call, if the plant has forces without a MuJoCo element."""
        force = self._forces_without_element()
        if force is None:
            yield
            return
        before = mujoco.get_mjcb_control()
        mujoco.set_mjcb_control(force)
        try:
            yield
        finally:
            mujoco.set_mjcb_control(before)

    def _forces_without_element(self) -> Callable[[mujoco.MjModel, mujoco.MjData], None] | None:
        """Returns a control callback that applies forces which vary within a step and have no element; None without."""
        p, sliding = self._plant, self._sliding
        hub = bool(sliding.varying) or p.motor.lag > 0 or p.friction.stribeck_velocity > 0 or p.motor.gap > 0
        soft, drag, shaken = p.link.softening != 0, p.link.drag_quadratic != 0, p.link.is_shaken
        if not (hub or soft or drag or shaken):
            return None
        joints = sliding.model.nv

        def force(model: mujoco.MjModel, data: mujoco.MjData) -> None:
            which = sliding if model.nv == joints else self._locked
            if hub:
                which.apply_varying_torques(data.time, self._delivered(data.time) - self._u)
            if soft:
                which.apply_softening()
            if drag:
                which.apply_tip_drag()
            if shaken:
                which.apply_base_acceleration(data.time)

        return force


def _ignore(warning: str) -> None:
    """Takes a warning of MuJoCo."""


def _commands_from(
    start: float, instants: np.ndarray, torques: np.ndarray
) -> tuple[list[float], list[float]]:
    """Returns the commands that act from `start` on: the last one at or before it, and all later ones."""
    first = max(int(np.searchsorted(instants, start + _NO_TIME, side="right")) - 1, 0)
    return instants[first:].tolist(), torques[first:].tolist()


def _locate_zero(
    value: Callable[[float], float], restore: Callable[[], None], high: float, at_low: float, at_high: float
) -> float:
    """Returns a point between 0 and `high` at which `value` has just become negative, within EVENT_TOLERANCE.

    Illinois algorithm: regula falsi with one end's value halved when the other moves twice (M. Dowell, P. Jarratt,
    BIT 11, 1971). `restore` is called before each call of `value`, the last of which is at the returned point and
    leaves the state there. The point is never 0, so that time advances.
    """
    low, moved, last = 0.0, 0, high
    at_low = max(at_low, 0.0)
    while high - low > EVENT_TOLERANCE:
        middle = high - at_high * (high - low) / (at_high - at_low)
        # Keep off the ends, so that the bracket shrinks from both sides.
        last = middle = min(max(middle, low + EVENT_TOLERANCE / 2), high - EVENT_TOLERANCE / 2)
        restore()
        at_middle = value(middle)
        if at_middle < 0:
            high, at_high = middle, at_middle
            at_low, moved = (at_low / 2 if moved == -1 else at_low), -1
        else:
            low, at_low = middle, at_middle
            at_high, moved = (at_high / 2 if moved == 1 else at_high), 1
    if last != high:
        restore()
        value(high)
    return high

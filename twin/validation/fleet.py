"""One controller on a fleet of rigs, in two processes.

The controller is synthesised for the rig as believed, because that is the one that goes to the hardware; every
process makes the same one again, since not every controller can be sent to another process.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from twin.control import closed_loop, plants, scenarios
from twin.control.laws import library
from twin.control.laws.base import Controller
from twin.control.plants.chain import CompiledPlant
from twin.control.plants.sensor_effects import SensorEffects
from twin.control.plants.sensors import Sensors
from twin.errors import InputError
from twin.parameters import Rig
from twin.validation.figures import figures
from twin.validation.linear_form import LinearForm, NoLinearFormError, identify
from twin.validation.linear_rig import sampled_chain, sampled_modes
from twin.validation.loop import Margins, margins
from twin.validation.rigs import DrawnRig, Effects

PROCESSES = 2
_CHUNK = 5  # rigs that a process takes at a time
_MODE_COUNTS = range(1, 5)
_POINTS = 250  # of a trace
TRACED = ("hub_angle", "tip_deflection", "motor_torque")


@dataclass(frozen=True)
class Job:
    """What every process has to know.

    Attributes:
      controller: name or FILE.py:NAME.
      rig: as believed, for which the controller is synthesised.
      scenario: name of the scenario.
    """

    controller: str
    rig: Rig
    scenario: str

    def law(self, period: float) -> Controller:
        """Returns the controller for a sample period [s]."""
        return library.controller(self.controller, self.rig, period)


@dataclass(frozen=True)
class Outcome:
    """One rig under the controller.

    Attributes:
      drawn: the rig.
      figures: by name of the requirement.
      time: (k) [s].
      traces: channel -> (k) true values, SI, a few of the samples.
      left_out: effects that the linear loop does not know.
    """

    drawn: DrawnRig
    figures: Mapping[str, float]
    time: np.ndarray = field(repr=False)
    traces: Mapping[str, np.ndarray] = field(repr=False)
    left_out: tuple[str, ...] = ()


class _ReadOnce(CompiledPlant):
    """The compiled chain, its channels worked out once a sample, however often a run asks: a fifth of its time."""

    _known: dict[str, float] | None = None

    def reset(self, hub_angle: float = 0.0) -> None:
        self._known = None
        super().reset(hub_angle)

    def advance(self, torque: float) -> None:
        self._known = None
        super().advance(torque)

    def read(self) -> dict[str, float]:
        if self._known is None:
            self._known = super().read()
        return self._known


class Bench:
    """A controller and its linear form, ready to be put on one rig after another."""

    def __init__(self, job: Job, period: float = plants.PERIOD) -> None:
        """Makes the controller and looks for its linear form.

        Raises:
          InputError: there is no such scenario or controller, or it fails.
        """
        self._period = period
        # Its proportions serve all rigs: finding them takes longer than a run, and the stiffness is of each rig.
        self._believed = plants.make_model(job.rig)
        self._scenario = scenarios.scenario(job.scenario)
        self._law = job.law(period)
        self.no_form = ""
        self.form: LinearForm | None = None
        try:
            self.form = identify(self._law, period)
        except NoLinearFormError as reason:
            self.no_form = str(reason)

    def outcome(self, drawn: DrawnRig) -> Outcome:
        """Runs the scenario on a rig and looks at its linear loop.

        Raises:
          InputError: the controller fails.
        """
        model = self._believed.replace(declared=drawn.rig, effects=drawn.effects)
        plant = _ReadOnce(model, self._period)
        try:
            sensors = Sensors(effects=SensorEffects(model, plant))
            run = closed_loop.run(
                plant, self._law, self._scenario.reference, self._scenario.duration, sensors
            )
        except InputError as error:
            raise InputError(f"on rig {drawn.number}: {error}") from None
        found = figures(run, drawn.rig["length"])
        left_out: tuple[str, ...] = ()
        if self.form is not None:
            linear, left_out = sampled_chain(model, self._period)
            m = margins(self.form, linear, self._period)
            found |= {
                "growth_rate": m.growth,
                "gain_margin": m.gain,
                "phase_margin": m.phase,
                "disk_margin": m.disk,
            }
        kept = np.linspace(0, len(run.time) - 1, _POINTS).round().astype(int)
        traces = {name: run.true[name][kept] for name in TRACED}
        return Outcome(drawn, found, run.time[kept], traces, left_out)

    def by_modes(self, rig: Rig, effects: Effects) -> dict[int, Margins]:
        """Returns the margins on a rig by the number of bending modes; none without a linear form."""
        if self.form is None:
            return {}
        model = self._believed.replace(declared=rig, effects=effects)
        linear = {modes: sampled_modes(model, self._period, modes) for modes in _MODE_COUNTS}
        return {modes: margins(self.form, rig, self._period) for modes, rig in linear.items()}


def run_fleet(
    job: Job, rigs: Sequence[DrawnRig], report: Callable[[str], None], processes: int = PROCESSES
) -> list[Outcome]:
    """Returns the outcome of each rig, in their order.

    Args:
      job: controller and scenario.
      rigs: the fleet.
      report: told how far it is.
      processes: how many work at a time; 1 for none beside this one.

    Raises:
      InputError: the controller fails on a rig.
    """
    outcomes = []
    for outcome in _outcomes(job, rigs, processes):
        outcomes.append(outcome)
        report(f"{len(outcomes)} of {len(rigs)} rigs")
    return outcomes


def _outcomes(job: Job, rigs: Sequence[DrawnRig], processes: int) -> Iterator[Outcome]:
    if processes == 1 or len(rigs) <= _CHUNK:
        yield from map(Bench(job).outcome, rigs)
        return
    # Fresh processes: a fork of one with threads, as numerical libraries have, may hang.
    fresh = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(processes, fresh, _prepare, (job,))
    try:
        yield from pool.map(_work, rigs, chunksize=_CHUNK)
    finally:
        pool.shutdown(cancel_futures=True)


_bench: Bench


def _prepare(job: Job) -> None:
    global _bench
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)  # the processes share the cores; matrices are small
    _bench = Bench(job)


def _work(drawn: DrawnRig) -> Outcome:
    return _bench.outcome(drawn)

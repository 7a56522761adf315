"""One controller on many rigs, side by side.

The controller is synthesised for the nominal rig, because that one goes to the hardware. It is reset before each rig;
one from a user's file is then made anew. Every thread of a worker makes its own, since not every controller can be
pickled.
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np

from twin.control import closed_loop, plants, scenarios
from twin.control.laws import library
from twin.control.laws.base import Controller
from twin.control.plants.chain import CompiledPlant
from twin.control.plants.sensor_effects import SensorEffects
from twin.control.plants.sensors import Sensors
from twin.errors import InputError
from twin.executors import lost_its_executor, lost_its_process
from twin.executors.processes import processes
from twin.parameters import Rig
from twin.rigs.check import check_parameters
from twin.validation.linear_form import LinearForm, NoLinearFormError, linear_form_of
from twin.validation.linear_rig import sampled_chain, sampled_modes
from twin.validation.margins import Margins, margins
from twin.validation.metrics import performance_metrics
from twin.validation.rigs import DrawnRig, Effects

PROCESSES = 2
"""Processes by default."""
_CHUNK_SIZE = 5  # rigs that a worker takes at a time
_MODE_COUNTS = range(1, 5)  # bending modes of the modal models whose margins are compared
_TRACE_POINTS = 250  # samples of a run that are kept for plots
TRACED = ("hub_angle", "tip_deflection", "motor_torque")
"""Channels of a run that are kept for plots."""


@dataclass(frozen=True)
class Job:
    """What every worker needs.

    Attributes:
      controller: name or FILE.py:NAME.
      rig: nominal rig, for which the controller is synthesised.
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
    """Result of the controller on one rig.

    Attributes:
      drawn: the rig.
      metrics: by name of the requirement, in its unit.
      time: (k) instants of the traces [s].
      traces: channel -> (k) true values, SI.
      left_out: effects that the linear loop does not contain.
    """

    drawn: DrawnRig
    metrics: Mapping[str, float]
    time: np.ndarray = field(repr=False)
    traces: Mapping[str, np.ndarray] = field(repr=False)
    left_out: tuple[str, ...] = ()


class _CachedPlant(CompiledPlant):
    """The compiled chain with its channels computed once per sample, however often a run reads them: saves a fifth."""

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


class Evaluator:
    """Evaluates one controller on one rig after another; an outcome does not depend on those before it.

    Attributes:
      form: linear form of the controller; None where it has none.
      no_form: why it has none; "" where it has one.
    """

    def __init__(self, job: Job, period: float = plants.PERIOD) -> None:
        """Makes the controller and identifies its linear form.

        Raises:
          InputError: there is no such scenario or controller, or it fails.
        """
        self._period = period
        # The proportions of its segments serve all rigs: fitting them takes longer than a run.
        self._nominal = plants.make_model(job.rig)
        self._scenario = scenarios.scenario(job.scenario)
        self._law = job.law(period)
        self.no_form = ""
        self.form: LinearForm | None = None
        try:
            self.form = linear_form_of(self._law, period)
        except NoLinearFormError as reason:
            self.no_form = str(reason)

    def outcome(self, drawn: DrawnRig) -> Outcome:
        """Simulates the scenario on a rig and computes the margins of its linear loop.

        Raises:
          InputError: the controller fails.
        """
        model = self._nominal.replace(declared=drawn.rig, effects=drawn.effects)
        check_parameters(model.rig)
        plant = _CachedPlant(model, self._period)
        try:
            sensors = Sensors(effects=SensorEffects(model, plant))
            run = closed_loop.run(
                plant, self._law, self._scenario.reference, self._scenario.duration, sensors
            )
        except InputError as error:
            raise InputError(f"on rig {drawn.number}: {error}") from None
        metrics = performance_metrics(run, drawn.rig["length"])
        left_out: tuple[str, ...] = ()
        if self.form is not None:
            linear, left_out = sampled_chain(model, self._period)
            m = margins(self.form, linear, self._period)
            metrics |= {
                "growth_rate": m.growth,
                "gain_margin": m.gain,
                "phase_margin": m.phase,
                "disk_margin": m.disk,
            }
        kept = np.linspace(0, len(run.time) - 1, _TRACE_POINTS).round().astype(int)
        traces = {name: run.true[name][kept] for name in TRACED}
        return Outcome(drawn, metrics, run.time[kept], traces, left_out)

    def by_modes(self, rig: Rig, effects: Effects) -> dict[int, Margins]:
        """Returns number of bending modes of a modal model -> margins on it; empty without a linear form."""
        if self.form is None:
            return {}
        model = self._nominal.replace(declared=rig, effects=effects)
        linear = {modes: sampled_modes(model, self._period, modes) for modes in _MODE_COUNTS}
        return {modes: margins(self.form, rig, self._period) for modes, rig in linear.items()}


def run_fleet(
    job: Job, rigs: Sequence[DrawnRig], report: Callable[[str], None], executor: Executor | None = None
) -> list[Outcome]:
    """Returns the outcome of each rig, in their order.

    Args:
      job: controller and scenario.
      rigs: the rigs.
      report: called with a text on the progress.
      executor: where they run; None for processes of this machine, or for a few rigs this one.

    Raises:
      InputError: the controller fails on a rig.
    """
    outcomes = []
    for outcome in _outcomes(job, rigs, executor):
        outcomes.append(outcome)
        report(f"{len(outcomes)} of {len(rigs)} rigs")
    return outcomes


def _outcomes(job: Job, rigs: Sequence[DrawnRig], executor: Executor | None) -> Iterator[Outcome]:
    if executor is not None:
        yield from _outcomes_elsewhere(job, rigs, executor)
    elif len(rigs) <= _CHUNK_SIZE:
        yield from map(Evaluator(job).outcome, rigs)
    else:
        with processes(PROCESSES) as pool:
            yield from _outcomes_elsewhere(job, rigs, pool)


def _outcomes_elsewhere(job: Job, rigs: Sequence[DrawnRig], executor: Executor) -> Iterator[Outcome]:
    chunks = [rigs[k : k + _CHUNK_SIZE] for k in range(0, len(rigs), _CHUNK_SIZE)]
    run = secrets.token_hex(8)
    running = [executor.submit(_evaluate, run, job, chunk) for chunk in chunks]
    try:
        for chunk in running:
            yield from chunk.result()
    except Exception as error:
        if lost_its_executor(error):
            raise InputError(
                "what ran the rigs has ended; expected a scheduler that runs until they end"
            ) from None
        if not lost_its_process(error):
            raise
        raise InputError(
            f"{job.controller}: a process ended while it ran this controller; expected one that neither ends its "
            "process nor makes compiled code crash, and enough memory"
        ) from None
    finally:
        for chunk in running:
            chunk.cancel()


_own = threading.local()
"""The evaluator of a thread of a worker, and the run that it is of: a later run may find a file changed."""


def _evaluate(run: str, job: Job, rigs: Sequence[DrawnRig]) -> list[Outcome]:
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):  # the workers share the cores; matrices are small
        if getattr(_own, "run", None) != run:
            _own.evaluator, _own.run = Evaluator(job), run
        return [_own.evaluator.outcome(rig) for rig in rigs]

"""The public interface: what the commands do, as functions that return values.

`import twin` offers these names without importing anything heavy; defaults are those of the commands. What cannot be
used raises `twin.InputError`, whose message names the file, line or field and what would be right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from twin.campaigns.campaign import Campaign
from twin.campaigns.campaign import read_campaign as _read_campaign
from twin.control.closed_loop import Run as _Run
from twin.control.experiment import Experiment
from twin.diagnosis.answer import AdoptedEffect
from twin.diagnosis.answer import Diagnosis as _Diagnosis
from twin.errors import InputError
from twin.parameters import Rig
from twin.progress import Progress, silent
from twin.recording import CHANNEL_UNITS, GAUGES, Recording
from twin.rigs import preset
from twin.rigs.model import FINE_SEGMENTS, FINE_STEP, Model
from twin.rigs.rig_file import checked_effects, read_rig_file
from twin.table import Table

if TYPE_CHECKING:
    import control
    import plotly.graph_objects as go
    from dm_control.rl.control import Environment

    from twin.diagnosis.plan import ExperimentPlan
    from twin.identification.result import Identification as _Identification
    from twin.validation.requirements import Requirements
    from twin.validation.validation import Validation as _Validation

Effects: TypeAlias = Mapping[str, Mapping[str, float]]
"""Effect name -> parameter name -> value, SI."""

FilePath: TypeAlias = str | PathLike[str]

_SIMULATED = ("hub_angle", "strain_base", "strain_mid", "tip_deflection", "motor_torque")


class RigFile(NamedTuple):
    """A rig and the effects that act on it, as a parameter file declares them."""

    rig: Rig
    effects: Effects


RigLike: TypeAlias = str | PathLike[str] | Rig | RigFile
"""Name of a published rig, a parameter file, a rig, or a rig with effects."""


def read_campaign(folder: FilePath) -> Campaign:
    """Reads a campaign: `campaign.toml` and its recordings, checked and in SI units.

    Raises:
      InputError: something in the folder cannot be used.
    """
    return _read_campaign(Path(folder))


def rig(name: str = "bossi2009") -> Rig:
    """Returns a published rig; `rig["length"]` is a value in SI, `rig.parameters["length"]` has unit and source.

    Raises:
      InputError: there is none of this name.
    """
    return preset(name)


def read_rig(file: FilePath) -> RigFile:
    """Reads a parameter file (TOML), as a diagnosis or an identification writes it.

    Raises:
      InputError: the file cannot be used.
    """
    return RigFile(*read_rig_file(file))


def _rig_of(given: RigLike) -> RigFile:
    if isinstance(given, RigFile):
        return given
    if isinstance(given, Rig):
        return RigFile(given, {})
    path = Path(given)
    if path.suffix or path.exists():
        return read_rig(path)
    return RigFile(preset(str(given)), {})


def _campaign_of(given: FilePath | Campaign, declared: RigLike | None) -> Campaign:
    campaign = given if isinstance(given, Campaign) else read_campaign(given)
    if declared is None:
        return campaign
    known = _rig_of(declared)
    return replace(campaign, rig=known.rig, effects=known.effects)


@dataclass(frozen=True)
class Diagnosis:
    """What a campaign's model lacks.

    Attributes:
      answer: all of it, see `twin.diagnosis.answer.Diagnosis`.
      campaign: what was diagnosed.
    """

    answer: _Diagnosis = field(repr=False)
    campaign: Campaign = field(repr=False)

    @property
    def verdict(self) -> str:
        """ "explained", "no-missing-effect" or "outside-library"."""
        return self.answer.verdict

    @property
    def summary(self) -> str:
        """The verdict in plain sentences."""
        from twin.report import display

        return f"{display.headline(self.answer)} {self.answer.summary}".strip()

    @property
    def effects(self) -> tuple[AdoptedEffect, ...]:
        """The adopted effects, the most important first."""
        return self.answer.effects

    @property
    def rig(self) -> RigFile:
        """The augmented rig: fitted parameters, known and adopted effects; for `model`, `run` and `validate`."""
        both = (*self.answer.known, *self.answer.effects)
        return RigFile(self.answer.fitted, {e.name: dict(e.parameters) for e in both})

    def table(self) -> Table:
        """Root-mean-square errors of the held-out recordings, or of all if none was held out, SI units."""
        from twin.report import display

        names = ("recording", "channel", "before", "calibrated", "after", "noise", "unit")
        rows = [
            (file, channel, e.before, e.calibrated, e.after, e.noise, CHANNEL_UNITS[channel])
            for file, prediction in display.evaluated_predictions(self.answer).items()
            for channel, e in prediction.errors.items()
        ]
        return Table.of_rows(names, rows)

    def parameters(self) -> Table:
        """Parameters of the adopted effects with standard errors."""
        rows = [
            (e.name, name, value, e.standard_errors.get(name), e.units[name])
            for e in self.effects
            for name, value in e.parameters.items()
        ]
        return Table.of_rows(("effect", "parameter", "value", "standard_error", "unit"), rows)

    def ranking(self) -> Table:
        """All candidates of the first round, their scores, and the rule by which each was turned down."""
        turned_down = {name: self.answer.failed_rule(name) for name, _ in self.answer.ranking}
        rows = [
            (name, score, rule.judgement.rule if (rule := turned_down[name]) is not None else None)
            for name, score in self.answer.ranking
        ]
        return Table.of_rows(("effect", "score", "turned_down_by"), rows)

    def plot(self, recording: str | None = None) -> go.Figure:
        """Every channel of a recording, measured, before and after; by default the first held-out one.

        Raises:
          InputError: there is no such recording.
        """
        import plotly.io

        from twin.report import display, figures

        shown = self.answer.predictions
        name = (
            recording
            if recording is not None
            else next(iter(display.evaluated_predictions(self.answer)), None)
        )
        if name is None or name not in shown:
            raise InputError(f"there is no recording '{name}'; expected one of: {', '.join(shown)}")
        figure = figures.recording_figure(shown[name])
        if figure is None:
            raise InputError(f"{name} has no channel that is simulated; expected one with readings")
        return plotly.io.from_json(figure.json).update_layout(height=figure.height)

    def save(self, folder: FilePath, force: bool = False) -> dict[str, Path]:
        """Writes report, rerun recording, answer, augmented rig and MJCF; returns what each file is -> its path.

        Args:
          folder: where to; made if it is not there.
          force: whether it may hold something else than earlier results.

        Raises:
          InputError: the folder holds something else, or cannot be written.
        """
        from twin.report import deliver

        chosen = deliver.FOLDER.choose(Path(folder), Path(self.answer.campaign), force)
        return dict(deliver.deliver(self.answer, self.campaign.sensors, chosen).paths)

    def to_json(self) -> dict[str, Any]:
        """Returns the answer as plain values: what `twin diagnose --json` writes."""
        return self.answer.to_json()

    def __repr__(self) -> str:
        names = ", ".join(e.name for e in self.effects)
        return f"<Diagnosis of {self.answer.campaign}: {self.verdict}{f' ({names})' if names else ''}>"

    def _repr_html_(self) -> str:
        import html

        effects = self.parameters()._repr_html_() if self.effects else ""
        text = html.escape(self.summary)
        return f"<p><b>{self.verdict}</b>. {text}</p>{effects}{self.table()._repr_html_()}"


def diagnose(
    campaign: FilePath | Campaign,
    *,
    rig: RigLike | None = None,
    false_alarm_rate: float = 0.01,
    workers: int | None = None,
    progress: Progress = silent,
) -> Diagnosis:
    """Finds which physical effect a campaign's model lacks.

    Args:
      campaign: its folder, or what `read_campaign` returned.
      rig: declares the rig instead of the campaign, with the effects that it is known to have.
      false_alarm_rate: how often something may be found where nothing is missing.
      workers: number of threads; by default one a processor.
      progress: called with the name of each stage.

    Raises:
      InputError: the campaign or the rate cannot be used.
    """
    from twin.diagnosis.diagnose import diagnose as search

    given = _campaign_of(campaign, rig)
    return Diagnosis(search(given, progress, workers, false_alarm_rate), given)


@dataclass(frozen=True)
class Identification:
    """What the recordings of a campaign say of its declared parameters.

    Attributes:
      answer: all of it, see `twin.identification.result.Identification`.
    """

    answer: _Identification = field(repr=False)

    def table(self) -> Table:
        """Declared and identified value of each parameter, standard error and 95 % interval."""
        names = ("parameter", "declared", "value", "standard_error", "low", "high", "unit", "not_determined")
        rows = []
        for name, p in self.answer.all_parameters.items():
            low, high = p.estimate.interval
            why = self.answer.not_determined.get(name)
            rows.append(
                (name, p.declared, p.estimate.value, p.estimate.standard_error, low, high, p.unit, why)
            )
        return Table.of_rows(names, rows)

    def save(self, folder: FilePath, force: bool = False) -> dict[str, Path]:
        """Writes report, answer and rig file; returns what each file is -> its path.

        Raises:
          InputError: the folder holds something else, or cannot be written.
        """
        from twin.identification import deliver

        chosen = deliver.FOLDER.choose(Path(folder), Path(self.answer.campaign), force)
        return dict(deliver.deliver(self.answer, chosen))

    def to_json(self) -> dict[str, Any]:
        """Returns the answer as plain values: what `twin identify --json` writes."""
        return self.answer.to_json()

    def _repr_html_(self) -> str:
        return self.table()._repr_html_()


def identify(
    campaign: FilePath | Campaign,
    *,
    rig: RigLike | None = None,
    against: FilePath | Campaign | None = None,
    progress: Progress = silent,
) -> Identification:
    """Identifies stiffness, inertias, damping and friction from the recordings of a campaign.

    Args:
      campaign: its folder, or what `read_campaign` returned.
      rig: declares the rig instead of the campaign, with the effects that it is known to have.
      against: a campaign of the same rig with another payload, whose spectral peaks are compared.
      progress: called with the name of each stage.

    Raises:
      InputError: a campaign cannot be used.
    """
    from twin.identification.identify import identify as run

    other = None if against is None else _campaign_of(against, None)
    return Identification(run(_campaign_of(campaign, rig), progress, other=other))


def plan_experiment(
    campaign: FilePath | Campaign,
    *,
    between: tuple[str, str] | None = None,
    progress: Progress = silent,
) -> ExperimentPlan:
    """Ranks experiments by how far they would drive two explanations of a campaign apart.

    Args:
      campaign: its folder, or what `read_campaign` returned.
      between: names of two effects; None for the two that explain most.
      progress: called with the name of each stage.

    Raises:
      InputError: a name is not that of an effect.
    """
    from twin.diagnosis.plan import plan

    return plan(_campaign_of(campaign, None), between, progress)


@dataclass(frozen=True)
class RigModel:
    """A rig with its effects, ready to be simulated.

    Attributes:
      model: what is simulated, see `twin.rigs.model.Model`.
    """

    model: Model = field(repr=False)

    def simulate(
        self,
        time: Sequence[float] | np.ndarray,
        torque: Sequence[float] | np.ndarray,
        *,
        hub_angle: float = 0.0,
        tip_deflection: float | None = None,
        clamped: bool = False,
        channels: Sequence[str] = _SIMULATED,
    ) -> Recording:
        """Simulates the rig from rest under a torque; returns what its sensors report.

        Args:
          time: (n) instants [s], increasing.
          torque: (n) commanded torque [N m], held from each instant to the next.
          hub_angle: where the hub starts [rad].
          tip_deflection: the tip is held there by a force until the first instant [m]; None for a link at rest.
          clamped: whether the hub is locked.
          channels: that are simulated.

        Raises:
          InputError: the arrays do not fit, or a channel is not simulated.
        """
        from twin.mechanics.state import Start
        from twin.rigs.simulate import simulate

        recording = _blank(time, torque, channels, clamped, tip_deflection)
        return simulate(self.model, recording, Start(hub_angle=hub_angle))

    def mjcf(self) -> str:
        """Returns the rig as MJCF, what MuJoCo cannot say named in a comment."""
        from twin.rigs.mjcf_export import to_mjcf

        return to_mjcf(self.model.declared, self.model.effects, self.model.sensors).xml


def _blank(
    time: Sequence[float] | np.ndarray,
    torque: Sequence[float] | np.ndarray,
    channels: Sequence[str],
    clamped: bool,
    tip_deflection: float | None,
) -> Recording:
    """A recording with nothing measured yet."""
    time, torque = (np.asarray(values, dtype=float) for values in (time, torque))
    if time.ndim != 1 or time.shape != torque.shape or len(time) < 2 or np.any(np.diff(time) <= 0):
        raise InputError(
            f"time has shape {time.shape} and torque {torque.shape}; expected two vectors of equal length, time "
            "increasing"
        )
    unknown = [c for c in channels if c not in _SIMULATED]
    if unknown:
        raise InputError(f"'{unknown[0]}' is not simulated; expected some of: {', '.join(_SIMULATED)}")
    empty = {channel: np.zeros(len(time)) for channel in channels}
    return Recording("simulated", time, {"torque_command": torque, **empty}, clamped, "open", tip_deflection)


def model(
    rig: RigLike = "bossi2009", effects: Effects | None = None, segments: int = FINE_SEGMENTS
) -> RigModel:
    """Returns a rig with effects as a model that can be simulated.

    Args:
      rig: name, parameter file, rig, or rig with effects.
      effects: in the place of those that the file has; what is not said of one is neutral.
      segments: of the chain.

    Raises:
      InputError: a rig or an effect is not known.
    """
    from twin.mechanics import chain

    known = _rig_of(rig)
    acting = checked_effects(known.effects if effects is None else effects, known.rig)
    gauges = {gauge.channel: gauge for gauge in GAUGES}
    return RigModel(Model(known.rig, gauges, chain.fit_shape(known.rig, segments), acting, FINE_STEP))


@dataclass(frozen=True)
class Run:
    """A closed-loop run.

    Attributes:
      experiment: what was run.
      run: samples, states and outline, see `twin.control.closed_loop.Run`.
    """

    experiment: Experiment = field(repr=False)
    run: _Run = field(repr=False)

    @property
    def metrics(self) -> dict[str, float]:
        """Figures of the run, as `twin run --json` writes them."""
        return self.experiment.metrics(self.run)

    @property
    def recording(self) -> Recording:
        """What the sensors and the command line of the rig would have recorded."""
        return self.run.recording(self.experiment.scenario)

    def save(self, file: FilePath) -> Path:
        """Writes the run as CSV (a recording) or, for a name that ends in .rrd, for the rerun viewer.

        Raises:
          InputError: the name ends otherwise, or the file cannot be written.
        """
        path = Path(file)
        if path.suffix == ".csv":
            from twin.report.run_csv import write_csv

            write_csv(self.run, path)
        elif path.suffix == ".rrd":
            from twin.report import run_rerun

            track = run_rerun.of_run(self.run, self.experiment.plant)
            run_rerun.write_rrd([track], self.experiment.rig["length"], path, self.experiment.scenario)
        else:
            raise InputError(f"{path.name} ends in '{path.suffix}'; expected .csv or .rrd")
        return path


def run(
    scenario: str = "lq-step-120",
    *,
    plant: str = "chain",
    controller: str | None = None,
    rig: RigLike = "bossi2009",
    effects: Effects | None = None,
    noise: int | None = None,
) -> Run:
    """Runs an experiment of Bossi et al. (2009) under a controller.

    Args:
      scenario: name of the experiment.
      plant: "chain", "modal" or "paper".
      controller: name, or FILE.py:NAME; None for the scenario's own.
      rig: name, parameter file, rig, or rig with effects.
      effects: in the place of those that the file has.
      noise: seed of the sensors' noise; None for noiseless sensors.

    Raises:
      InputError: something of this is not known, or the controller fails.
    """
    known = _rig_of(rig)
    acting = known.effects if effects is None else effects
    experiment = Experiment(scenario, plant, known.rig, acting, controller, noise)
    return Run(experiment, experiment.run())


def validate(
    controller: str,
    *,
    rig: RigLike = "bossi2009",
    scenario: str = "lq-step-120",
    rigs: int = 200,
    seed: int = 0,
    requirements: FilePath | None = None,
    progress: Callable[[str], None] = silent,
) -> _Validation:
    """Tries a controller on rigs drawn from the uncertainty of the parameters, against requirements.

    Args:
      controller: name, or FILE.py:NAME.
      rig: as believed: the controller is synthesised for it.
      scenario: the experiment.
      rigs: number of rigs to draw.
      seed: of the draw.
      requirements: file with other limits (TOML); None for the stated defaults.
      progress: called with the name of each stage.

    Raises:
      InputError: something of this cannot be used.
    """
    from twin.rigs.rig_file import read_uncertainty
    from twin.validation import validation
    from twin.validation.requirements import defaults, read_requirements

    known = _rig_of(rig)
    from_file = isinstance(rig, str | PathLike) and (Path(rig).suffix or Path(rig).exists())
    errors = read_uncertainty(rig) if from_file else ({},)  # type: ignore[arg-type]
    limits: Requirements = defaults() if requirements is None else read_requirements(Path(requirements))
    job = validation.Job(controller, known.rig, scenario)
    return validation.validate(job, known.effects, errors[0], limits, rigs, seed, progress, *errors[1:])


def load(
    rig: RigLike = "bossi2009",
    *,
    effects: Effects | None = None,
    reference: Callable[[float], float] | None = None,
    duration: float = 5.0,
    period: float = 2e-3,
) -> Environment:
    """Returns the MuJoCo chain of a rig as a `dm_env` environment whose action is a torque.

    Args:
      rig: name, parameter file, rig, or rig with effects.
      effects: in the place of those that the file has.
      reference: wanted hub angle [rad] by time [s]; None for a step of 120 degrees.
      duration: of an episode [s].
      period: sample period [s].

    Raises:
      InputError: a rig or effect is not known, or dm_control is not installed.
    """
    try:
        from twin.control.environment import rig_environment
    except ModuleNotFoundError as error:
        raise InputError(
            f"twin.load needs dm-control, and {error.name} is not installed; dm-control has no wheels for Python 3.13 "
            "and later (its dependency labmaze has none): use Python 3.11 or 3.12, all else works without it"
        ) from error
    known = _rig_of(rig)
    acting = known.effects if effects is None else effects
    wanted = reference if reference is not None else (lambda time: math.radians(120.0))
    return rig_environment(known.rig, acting, wanted, duration, period)


def state_space(rig: RigLike = "bossi2009", modes: int = 2) -> control.StateSpace:
    """Returns the linear model of Bossi et al. (2009), section III, with so many bending modes, for python-control.

    Inputs: torque [N m]; outputs: hub angle [rad], tip deflection [m] and two strains [1]; friction left out.

    Args:
      rig: name, parameter file, or rig; effects are left out.
      modes: number of bending modes.

    Raises:
      InputError: the rig is not known.
    """
    import control

    from twin.mechanics.modal import state_space as build

    system = build(_rig_of(rig).rig, modes, GAUGES)
    return control.ss(
        system.A,
        system.B,
        system.C,
        np.zeros((len(system.C), system.B.shape[1])),
        inputs=["torque"],
        outputs=list(system.output_labels),
        name="flexible link",
    )

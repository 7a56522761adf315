"""The commands as functions."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.api.answers import Diagnosis, Identification, Run
from twin.api.inputs import Effects, FilePath, RigLike, campaign_of, files_of, rig_of
from twin.campaigns.campaign import Campaign
from twin.control.experiment import Experiment
from twin.errors import InputError, checked_count, quoted
from twin.files.provenance import recorded
from twin.progress import Progress, silent
from twin.recording import GAUGES

_MOST_MODES = 50
"""Most bending modes of a linear model: of higher ones the beam theory of a slender link says nothing."""

if TYPE_CHECKING:
    import control
    from dm_control.rl.control import Environment

    from twin.diagnosis.plan import ExperimentPlan
    from twin.fleet.answer import Fleet, RigResult
    from twin.validation.requirements import Requirements
    from twin.validation.validation import Validation as _Validation


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
      workers: number of threads, and of processes that compute residuals; by default one a processor.
      progress: called with the name of each stage.

    Raises:
      InputError: the campaign or the rate cannot be used.
    """
    from twin.diagnosis.diagnose import diagnose as search
    from twin.diagnosis.permutation import SEEDS

    given = campaign_of(campaign, rig)
    folder, files = files_of(campaign, rig)
    record = recorded(files, folder, None, SEEDS)
    answer = search(given, progress, workers, false_alarm_rate)
    return Diagnosis(replace(answer, provenance=record), given)


def diagnose_fleet(
    campaigns: Iterable[FilePath],
    out: FilePath,
    *,
    executor: Executor | None = None,
    rig: FilePath | None = None,
    false_alarm_rate: float = 0.01,
    force: bool = False,
    ended: Callable[[RigResult], None] | None = None,
) -> Fleet:
    """Diagnoses many rigs side by side, writes a folder of results for each, and a page over all of them.

    A rig has the name that its `campaign.toml` gives. One that has an answer of the same files in `out` is not
    diagnosed again; one that cannot be diagnosed is in the answer with its error.

    Args:
      campaigns: folder of each rig's campaign.
      out: folder of the results; made if it is not there.
      executor: any of `concurrent.futures`, each task of which takes one thread for minutes; by default a process for
        each processor.
      rig: parameter file that declares every rig instead of its campaign.
      false_alarm_rate: how often something may be found where nothing is missing, of each rig.
      force: whether `out` may hold something else than earlier results.
      ended: called with the result of each rig as it is there.

    Raises:
      InputError: there are no campaigns, the rate or a file cannot be used, or `out` cannot be written.
    """
    from twin.executors.processes import processes
    from twin.fleet import run
    from twin.fleet.store import FOLDER

    folders = tuple(Path(c) for c in campaigns)
    if not folders:
        raise InputError("there are no campaigns; expected the folder of one at least")
    chosen = FOLDER.choose(Path(out), Path(out), force)
    asked = run.Asked(folders, chosen, None if rig is None else Path(rig), false_alarm_rate)
    here = processes(min(os.cpu_count() or 1, len(folders))) if executor is None else nullcontext(executor)
    with here as chosen_executor:
        return run.diagnose_fleet(asked, chosen_executor, ended or (lambda result: None))


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

    other = None if against is None else campaign_of(against, None)
    folder, files = files_of(campaign, rig)
    read = (*files, *(() if against is None else files_of(against, None)[1]))
    record = recorded(read, folder, None, {})
    answer = run(campaign_of(campaign, rig), progress, other=other)
    return Identification(replace(answer, provenance=record))


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

    return plan(campaign_of(campaign, None), between, progress)


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
      controller: name, or FILE.py:NAME, a file that is executed; None for the scenario's own.
      rig: name, parameter file, rig, or rig with effects.
      effects: in the place of those that the file has.
      noise: seed of the sensors' noise; None for noiseless sensors.

    Raises:
      InputError: something of this is not known, or the controller fails.
    """
    known = rig_of(rig)
    acting = known.effects if effects is None else effects
    if controller is not None and not isinstance(controller, str):
        raise InputError(f"controller is {quoted(controller)}; expected a name, or FILE.py:NAME")
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
    executor: Executor | None = None,
    progress: Callable[[str], None] = silent,
) -> _Validation:
    """Tries a controller on rigs drawn from the uncertainty of the parameters, against requirements.

    Args:
      controller: name, or FILE.py:NAME, a file that is executed anew for every rig.
      rig: as believed: the controller is synthesised for it.
      scenario: the experiment.
      rigs: number of rigs to draw.
      seed: of the draw.
      requirements: file with other limits (TOML); None for the stated defaults.
      executor: any of `concurrent.futures`; by default two processes.
      progress: called with the name of each stage.

    Raises:
      InputError: something of this cannot be used.
    """
    from twin.rigs.rig_file import read_uncertainty
    from twin.validation import validation
    from twin.validation.requirements import defaults, read_requirements
    from twin.validation.rigs import INDEPENDENT

    known = rig_of(rig)
    from_file = isinstance(rig, str | PathLike) and (Path(rig).suffix or Path(rig).exists())
    errors, correlations = read_uncertainty(rig) if from_file else ({}, INDEPENDENT)  # type: ignore[arg-type]
    limits: Requirements = defaults() if requirements is None else read_requirements(Path(requirements))
    job = validation.Job(controller, known.rig, scenario)
    result = validation.validate(
        job, known.effects, errors, limits, rigs, seed, progress, correlations, executor
    )
    files = [Path(given) for given in (rig, requirements) if isinstance(given, str | PathLike)]
    record = recorded((f for f in files if f.is_file()), None, None, {"drawn_rigs": seed})
    return replace(result, provenance=record)


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
    known = rig_of(rig)
    acting = known.effects if effects is None else effects
    wanted = reference if reference is not None else (lambda time: math.radians(120.0))
    return rig_environment(known.rig, acting, wanted, duration, period)


def state_space(rig: RigLike = "bossi2009", modes: int = 2) -> control.StateSpace:
    """Returns the linear model of Bossi et al. (2009), section III, with so many bending modes, for python-control.

    Inputs: torque [N·m]; outputs: hub angle [rad], tip deflection [m] and two strains [1]; friction left out.

    Args:
      rig: name, parameter file, or rig; effects are left out.
      modes: number of bending modes.

    Raises:
      InputError: the rig is not known, or not so many modes can be computed.
    """
    import control

    from twin.mechanics.modal import state_space as build

    checked_count("modes", modes, 1, _MOST_MODES)
    system = build(rig_of(rig).rig, modes, GAUGES)
    return control.ss(
        system.A,
        system.B,
        system.C,
        np.zeros((len(system.C), system.B.shape[1])),
        inputs=["torque"],
        outputs=list(system.output_labels),
        name="flexible link",
    )

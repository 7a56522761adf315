"""Plans the experiment that discriminates between two effects as explanations of a campaign."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from twin.campaigns.campaign import Campaign
from twin.diagnosis import candidates, experiments, rules
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.experiments import Plan
from twin.diagnosis.separation import Explanation
from twin.effects import REGISTRY
from twin.errors import InputError, nearest
from twin.estimation.calibrate import Calibration, calibrate, noise_levels
from twin.estimation.residual_pool import ResidualPool
from twin.files.writers import write_table
from twin.progress import Progress, silent
from twin.recording import CHANNEL_UNITS, MEASURED


@dataclass(frozen=True)
class ExperimentPlan:
    """Experiments that discriminate between two effects.

    Attributes:
      names: of the effects.
      plans: experiments, best first.
      score: the larger score of the two, each alone beside the calibrated model.
    """

    names: tuple[str, str]
    plans: list[Plan]
    score: float

    def recommendation(self) -> str:
        """What to record, and whether the present recordings support either effect, as sentences."""
        text = experiments.recommendation(self.plans, self.names)
        if self.score >= rules.MODEL_ERROR_SCORE:
            return text
        return (
            f"These recordings support neither {self.names[0]} nor {self.names[1]}: the better one gains "
            f"{self.score:.1f}, less than the {rules.MODEL_ERROR_SCORE:g} that a diagnosis requires. {text}"
        )


def plan(
    campaign: Campaign, between: tuple[str, str] | None = None, progress: Progress = silent
) -> ExperimentPlan:
    """Fits two effects to a campaign, each alone, and ranks experiments by how well they discriminate between them.

    Args:
      campaign: the recordings; held-out ones are not used.
      between: names of two effects; None for the two with the largest scores.
      progress: called with a message at every stage.

    Raises:
      InputError: a name is no effect of the library, or both are the same.
    """
    if between is not None:
        _check_names(between)
    with threadpool_limits(1), ResidualPool(os.cpu_count() or 1) as pool:
        start = calibrate(campaign, pool, progress)
        pair = _best_two(start, progress) if between is None else _fit_each(start, between, progress)
        progress("simulating experiments")
        plans = plans_for_pair(campaign, pair, pool)
    first, second = (c.effects[-1] for c in pair)
    return ExperimentPlan((first, second), plans, max(c.score for c in pair))


def _check_names(between: tuple[str, str]) -> None:
    for name in between:
        if name not in REGISTRY:
            raise InputError(
                f"'{name}' is not an effect; expected two of: {', '.join(REGISTRY)}{nearest(name, REGISTRY)}"
            )
    if between[0] == between[1]:
        raise InputError(f"{between[0]} was given twice; expected two effects to tell apart")


def _best_two(start: Calibration, progress: Progress) -> tuple[Candidate, Candidate]:
    names = candidates.candidate_names(start.base.model, start.bench.channels())
    first, second, *_ = candidates.explore(start.bench, start.base, names, progress).ranked
    return first, second


def _fit_each(start: Calibration, names: tuple[str, str], progress: Progress) -> tuple[Candidate, Candidate]:
    progress(f"fitting {names[0]} and {names[1]}")
    first, second = (candidates.try_effect(start.bench, start.base, name) for name in names)
    return first, second


def write_torque(plans: Sequence[Plan], path: Path) -> Plan:
    """Writes time [s] and torque_command [N m] of the best experiment that has a torque; returns its plan.

    Decays with a locked hub have none: the tip is released by hand.

    Raises:
      InputError: no experiment has a torque, or the path cannot be written.
    """
    best = next((p for p in plans if np.any(p.experiment.recording["torque_command"])), None)
    if best is None:
        raise InputError("no torque makes any of these experiments; expected none with --out")
    recording = best.experiment.recording
    columns = {"time": recording.time, "torque_command": recording["torque_command"]}
    write_table(columns, {"time": "s", "torque_command": CHANNEL_UNITS["torque_command"]}, path)
    return best


def to_json(plan: ExperimentPlan) -> dict[str, Any]:
    """The plan as plain values."""
    return {
        "between": list(plan.names),
        "score": plan.score,
        "experiments": [
            {
                "name": p.experiment.name,
                "how": p.experiment.how,
                "noise_levels_apart": p.separation,
                "channel": p.channel,
                "sensor_to_add": p.sensor[0] if p.sensor else None,
            }
            for p in plan.plans
        ],
    }


PLANNING_STEP = 1e-3  # s, time step of the simulations


def plans_for_pair(
    campaign: Campaign, pair: tuple[Candidate, Candidate], pool: ResidualPool
) -> list[experiments.Plan]:
    """Experiments by how well they discriminate between two candidates, best first."""
    noise = {c: s for c, s in noise_levels(campaign).items() if c in MEASURED}
    first, second = (Explanation.of_fit(c.fit, PLANNING_STEP) for c in pair)
    return experiments.rank(first, second, noise, pool)

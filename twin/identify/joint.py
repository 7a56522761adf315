"""One estimate of all declared parameters from all fit recordings: the calibration of the diagnosis, and its check.

The calibration follows the hub as it was measured, whose noise and filters bias it a little. How much is found out
by the calibrated rig itself: it is simulated through every recording, with its sensors' noise, and the simulated
recordings say by how much they pull the estimate off the parameters that they were made with (B. Efron, 1979,
parametric bootstrap; here by one Gauss-Newton step each). That pull is taken off, and its scatter counts as error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from twin import chain, diagnose, driven, fit, search
from twin.campaign import Campaign
from twin.fit import Fit, Prepared, Workbench
from twin.model import Model, simulate
from twin.parameters import Rig
from twin.recording import Recording
from twin.search import Progress, silent

REPLICAS = 6
"""Simulated campaigns by which the estimate is checked."""


@dataclass(frozen=True)
class Joint:
    """The joint estimate.

    Attributes:
      fit: the calibration as the diagnosis has it.
      bench: what it was fitted on.
      prepared: the recordings, made ready.
      names: (p) parameters of the rig that were free.
      values: (p) estimate, the bias taken off.
      covariance: (p x p) of `values`.
      linear_covariance: (p x p) that the calibration itself gives.
      bias: (p) mean pull of the replicas.
      spread: (p) its standard deviation from replica to replica.
      notes: what was left out of the recordings.
    """

    fit: Fit
    bench: Workbench
    prepared: tuple[Prepared, ...]
    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    linear_covariance: np.ndarray
    bias: np.ndarray
    spread: np.ndarray
    notes: tuple[str, ...]

    @property
    def errors(self) -> np.ndarray:
        """Standard errors (p)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix (p x p)."""
        return self.covariance / np.outer(self.errors, self.errors)

    @property
    def model(self) -> Model:
        """The model at the estimate."""
        values = {name: float(v) for name, v in zip(self.names, self.values, strict=True)}
        declared = self.fit.model.declared.replace(source="identified", **values)
        return self.fit.model.replace(declared=declared)


def estimate(campaign: Campaign, pool: ThreadPoolExecutor, progress: Progress = silent) -> Joint:
    """Calibrates all declared parameters within their uncertainty, and checks the estimate."""
    noise = diagnose.noises(campaign)
    shape = chain.fit_shape(campaign.rig, diagnose.SEARCH_SEGMENTS)
    model = Model(campaign.rig, campaign.sensors, shape, step=diagnose.SEARCH_STEP)
    progress("reading the recordings")
    sound, cuts = diagnose.sound_stretches(campaign.fit, noise, model)
    _, prepared, notes = diagnose.on_best_clock(sound, noise, model, pool)
    bench = Workbench(driven.DrivenData(prepared, model), pool)
    progress("fitting all declared parameters")
    base = diagnose.calibrated(bench, model)
    progress("checking the estimate on simulated recordings")
    pulls = _pulls(bench, base, pool)
    return _checked(base, bench, pulls, (*cuts, *notes))


def prior_deviation(rig: Rig, name: str) -> float:
    """Standard deviation of a declared parameter, as said or as a careful lab would say; 0 where it is exact."""
    parameter = rig.parameters[name]
    relative = parameter.uncertainty
    if relative is None:
        relative = fit.ASSUMED_UNCERTAINTY.get(name, 0.0)
    return relative * abs(parameter.value)


def _checked(base: Fit, bench: Workbench, pulls: np.ndarray, notes: tuple[str, ...]) -> Joint:
    mine = [i for i, u in enumerate(base.unknowns) if u.owner == "rig"]
    pulls = pulls[:, mine]
    bias, spread = pulls.mean(axis=0), pulls.std(axis=0, ddof=1)
    low, high = np.array([base.unknowns[i].bounds for i in mine]).T
    linear = base.covariance[np.ix_(mine, mine)]
    return Joint(
        base,
        bench,
        bench.prepared,
        tuple(base.unknowns[i].name for i in mine),
        np.clip(base.values[mine] - bias, low, high),
        _widened(linear, bias, spread),
        linear,
        bias,
        spread,
        notes,
    )


def _widened(linear: np.ndarray, bias: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """The covariance (p x p), its errors no smaller than the replicas' scatter, and uncertain by half the bias."""
    errors = np.sqrt(np.diag(linear))
    wider = np.sqrt(np.maximum(errors, spread) ** 2 + (bias / 2) ** 2)
    return linear * np.outer(wider / errors, wider / errors)


def _pulls(bench: Workbench, base: Fit, pool: ThreadPoolExecutor) -> np.ndarray:
    """Gauss-Newton steps (replicas x unknowns) that simulated recordings ask of the rig that they come from."""
    exact = search.fine(base.model)
    starts = [fit.reading_start(exact, p, s) for p, s in zip(bench.prepared, base.starts, strict=True)]
    clean = list(
        pool.map(lambda i: simulate(exact, bench.prepared[i].recording, starts[i]), range(len(starts)))
    )
    steps = [_step_of(bench, base, clean, np.random.default_rng([17, k])) for k in range(REPLICAS)]
    return np.array(steps)


def _step_of(
    bench: Workbench, base: Fit, clean: Sequence[Recording], generator: np.random.Generator
) -> np.ndarray:
    """One Gauss-Newton step (p) on a replica, weighted as the recordings themselves are."""
    known = [p.recording for p in bench.prepared]
    noisy = [
        _with_noise(c, k, p.noise, generator) for c, k, p in zip(clean, known, bench.prepared, strict=True)
    ]
    prepared = tuple(fit.prepare(r, p.noise)[0] for r, p in zip(noisy, bench.prepared, strict=True))
    prepared = tuple(replace(p, start=s) for p, s in zip(prepared, base.starts, strict=True))
    data = driven.DrivenData(prepared, base.model)
    weights = fit.row_weights(bench, base.residual)
    information, _ = fit.normal_equations(bench, base)
    gradient = np.zeros(len(base.values))
    for i in range(len(prepared)):
        parts = data.residual(base.model, i, base.starts[i])
        for group in bench.data.groups:
            if group.recording != i or group.channel not in parts:
                continue
            rows = group.rows
            r = np.clip(np.nan_to_num(parts[group.channel]), -30, 30) - bench.defect[rows]
            gradient += base.jacobian[rows].T @ (weights[rows] * r)
    return -np.linalg.pinv(information, hermitian=True) @ gradient


def _with_noise(
    clean: Recording, measured: Recording, noise: Mapping[str, float], generator: np.random.Generator
) -> Recording:
    """The simulated recording as its sensors would have read it, missing where the measured one is."""
    channels = dict(measured.channels)
    for name, sigma in noise.items():
        if name in clean and name in measured:
            shaken = clean[name] + sigma * generator.standard_normal(len(clean))
            channels[name] = np.where(np.isfinite(measured[name]), shaken, np.nan)
    return measured.replace(channels=channels)

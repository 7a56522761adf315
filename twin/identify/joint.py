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

from twin import calibration, chain, driven, fit, search
from twin.campaign import Campaign
from twin.fit import Fit, Prepared, Workbench
from twin.model import Model, Start, simulate
from twin.parameters import Rig
from twin.recording import Recording
from twin.search import Progress, silent

REPLICAS = 6
"""Simulated campaigns by which the estimate is checked."""
FINEST_SEGMENTS = 20
_STEPS = 2
_WILD = 30.0  # noise levels; a replica may stick where the rig did not


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
    start = calibration.calibrate(campaign, pool, progress)
    bench = start.bench
    base = _on_finest_chain(bench, start.base)
    progress("checking the estimate on simulated recordings")
    pulls = _pulls(bench, base, pool)
    return _checked(base, bench, pulls, start.notes)


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


def _on_finest_chain(bench: Workbench, base: Fit) -> Fit:
    """The fit with the chain's own error taken out to the last: it is what is left where all else is right."""
    bench.refine(base.model, _finest(base.model), base.starts)
    return fit.minimise(bench, base.model, base.starts, base.unknowns, base.values, iterations=4)


def _finest(model: Model) -> Model:
    return model.replace(shape=chain.fit_shape(model.declared, FINEST_SEGMENTS), step=search.FINE_STEP)


def _pulls(bench: Workbench, base: Fit, pool: ThreadPoolExecutor) -> np.ndarray:
    """How far (replicas x unknowns) simulated recordings pull the estimate off the rig that they come from."""
    exact = _finest(base.model)
    starts = [fit.reading_start(exact, p, s) for p, s in zip(bench.prepared, base.starts, strict=True)]
    clean = list(
        pool.map(lambda i: simulate(exact, bench.prepared[i].recording, starts[i]), range(len(starts)))
    )
    return np.array([_pull(bench, base, clean, np.random.default_rng([17, k])) for k in range(REPLICAS)])


def _pull(
    bench: Workbench, base: Fit, clean: Sequence[Recording], generator: np.random.Generator
) -> np.ndarray:
    """Where (p) a replica's fit ends less where it should: Gauss-Newton steps with the Jacobian kept."""
    noisy = [
        _with_noise(c, p.recording, p.noise, generator) for c, p in zip(clean, bench.prepared, strict=True)
    ]
    prepared = [fit.prepare(r, p.noise)[0] for r, p in zip(noisy, bench.prepared, strict=True)]
    prepared = [replace(p, start=s) for p, s in zip(prepared, base.starts, strict=True)]
    data = driven.DrivenData(prepared, base.model)
    weights = fit.row_weights(bench, base.residual)
    information, _ = fit.normal_equations(bench, base)
    solve = np.linalg.pinv(information, hermitian=True)
    x = base.values
    for _ in range(_STEPS):
        residual = _against(bench, data, fit.placed(base.model, base.unknowns, x), base.starts)
        x = x - solve @ (base.jacobian.T @ (weights * residual) + _prior_pull(base, x))
    return x - base.values


def _prior_pull(base: Fit, x: np.ndarray) -> np.ndarray:
    """Gradient (p) of the priors, centred on the rig that a replica comes from."""
    return np.array(
        [
            (v - b) / u.scale**2 if u.prior else 0.0
            for u, v, b in zip(base.unknowns, x, base.values, strict=True)
        ]
    )


def _against(bench: Workbench, data: driven.DrivenData, model: Model, starts: Sequence[Start]) -> np.ndarray:
    """Residual (n) of a replica, laid out as that of the recordings."""
    residual = np.zeros(len(bench.weight))
    for i in range(len(data.prepared)):
        parts = data.residual(model, i, starts[i])
        for group in bench.data.groups:
            if group.recording == i and group.channel in parts:
                rows = group.rows
                off = np.nan_to_num(parts[group.channel]) - bench.defect[rows]
                residual[rows] = np.clip(off, -_WILD, _WILD) * bench.weight[rows]
    return residual


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

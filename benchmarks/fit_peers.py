"""A fit of five parameters of a rig, and a diagnosis, beside least squares over MuJoCo rollouts and MuJoCo's sysid.

Recordings of the virtual rig (random steps and a slew; 18 s at 500 Hz; stiction at the Coulomb level, as MuJoCo has no
other) whose declared parameters are one standard deviation off. All fits begin there, keep within three
of them, and run on two threads; the others simulate four segments, the most that are stable at steps of 2 ms:

    twin           `calibrate`: the measured hub angle drives the link; compiled equations. It fits the time at which
                   commands act and the initial states besides, and weighs channels by what is left of them
    least_squares  scipy on output errors: the rig as `twin` exports it, rolled out by `mujoco.rollout`, all columns of
                   a Jacobian and all recordings at once; ftol at twin's tolerance
    mujoco.sysid   its optimizer on the same output errors; xtol 1e-4 and steps of 1e-3, as it has none of the cost

Errors are those of the five parameters against the truth in standard deviations of the declaration. The last column
simulates each answer by one and the same model and compares hub angle and strains with the recordings, RMS in
multiples of the noise. Then the time of a diagnosis of the same recordings, and of the same with undeclared viscous
friction, against one such fit for each effect of the library.
"""

from __future__ import annotations

import argparse
import io
import re
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import machine
import mujoco
import mujoco.rollout
import numpy as np
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits

from twin.campaigns.campaign import Campaign, read_campaign
from twin.diagnosis.diagnose import diagnose
from twin.effects import REGISTRY
from twin.estimation.calibrate import calibrate
from twin.estimation.residual_pool import ResidualPool
from twin.mechanics import mjcf
from twin.mechanics.chain import build, fit_shape
from twin.recording import Recording
from twin.virtual_rig import UNCERTAINTY, Sensors, make_campaign
from twin.virtual_rig import Rig as TrueRig
from twin.virtual_rig.experiments import bang_bang, random_steps

NAMES = ("bending_stiffness", "hub_inertia", "damping_ratio", "tip_mass", "coulomb_friction")
SIGNS = (1, -1, 1, -1, 1)  # of the error of each declared parameter, in standard deviations
CHANNELS = ("hub_angle", "strain_base", "strain_mid")
RANGE = 3.0  # standard deviations that a parameter may move
TOLERANCE = 5e-5  # relative reduction of the cost at which twin's minimisation stops
THREADS = 2
STEP, SEGMENTS = 2e-3, 4  # s; five have a mode of 178 Hz, beyond 1/(pi STEP) = 159 Hz
EFFECTS = {"nothing": {}, "viscous friction": {"viscous-friction": {"viscous": 0.003}}}


class Answer(NamedTuple):
    """Values of the fitted parameters, and how many recordings were simulated for them."""

    values: np.ndarray
    simulated: int | None


def make(folder: Path, effects: dict[str, dict[str, float]]) -> tuple[Campaign, np.ndarray]:
    """Writes and reads a campaign; returns it with the true values of the five parameters."""
    level = TrueRig().coulomb_positive
    rig = TrueRig()._replace(static_positive=level, static_negative=level)
    sensors, generator = Sensors(), np.random.default_rng(1)
    plans = [random_steps(rig, sensors, generator), bang_bang(rig, sensors, generator, 60.0)]
    truth = make_campaign(folder, effects, 1, rig=rig, experiments=plans)
    file = folder / "campaign.toml"
    text, uncertain = file.read_text(encoding="utf-8").split("[uncertainty]")
    for name, sign in zip(NAMES, SIGNS, strict=True):
        value = truth.true[name] * (1 + sign * UNCERTAINTY[name])
        text = re.sub(rf"(?m)^{name} = .*$", f"{name} = {value:.10g}", text)
    for name in set(UNCERTAINTY) - set(NAMES):
        uncertain = re.sub(rf"(?m)^{name} = .*$", f"{name} = 0", uncertain)
    file.write_text(f"{text}[uncertainty]{uncertain}", encoding="utf-8")
    return read_campaign(folder), np.array([truth.true[name] for name in NAMES])


class Rollouts:
    """The output errors of a campaign's free recordings by `mujoco.rollout`."""

    def __init__(self, campaign: Campaign) -> None:
        """Compiles nothing yet; the chain's proportions are those of the declared rig."""
        self.campaign, self.rig = campaign, campaign.rig
        self.shape = fit_shape(self.rig, SEGMENTS)
        self.noise = np.array([campaign.sensors[c].noise for c in CHANNELS])
        self.recordings: Sequence[Recording] = campaign.fit
        self.longest = max(len(r.time) for r in self.recordings)
        self.simulated = 0
        self.pool = mujoco.rollout.Rollout(nthread=THREADS)
        self.gauges = [s for c, s in campaign.sensors.items() if c.startswith("strain")]

    def spec(self, values: np.ndarray) -> mujoco.MjSpec:
        """The exported rig with some values of its parameters and the sensors that are compared."""
        rig = self.rig.replace(source="fit", **dict(zip(NAMES, map(float, values), strict=True)))
        links = build(rig, SEGMENTS, self.shape)
        spec = mjcf.build_spec(rig, links, gauges=self.gauges)
        for sensor in [s for s in spec.sensors if s.name not in CHANNELS]:
            spec.delete(sensor)
        spec.option.timestep = STEP
        return spec

    def start(self, model: mujoco.MjModel, recording: Recording) -> np.ndarray:
        """State at rest at the hub's mean angle before the first command."""
        moved = int(np.argmax(recording.channels["torque_command"] != 0))
        data = mujoco.MjData(model)
        data.qpos[0] = recording.channels["hub_angle"][:moved].mean()
        state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        return state

    def residuals(self, columns: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Output errors of all recordings, in multiples of the noise, for some vectors of the parameters."""
        models = [self.spec(values).compile() for values in columns]
        starts = [self.start(models[0], r) for r in self.recordings]
        control = np.zeros((len(self.recordings), self.longest, 1))
        for row, r in zip(control, self.recordings, strict=True):
            row[: len(r.time), 0] = r.channels["torque_command"]
        batch = [model for model in models for _ in self.recordings]
        _, seen = self.pool.rollout(
            batch,
            [mujoco.MjData(models[0]) for _ in range(THREADS)],
            np.array(starts * len(models)),
            np.tile(control, (len(models), 1, 1)),
        )
        self.simulated += len(batch)
        # Sensors are those of the state at which a step begins: row k is sample k.
        rows = len(self.recordings)
        return [
            np.concatenate(
                [
                    self.errors(s, r)
                    for s, r in zip(seen[i * rows : (i + 1) * rows], self.recordings, strict=True)
                ]
            )
            for i in range(len(models))
        ]

    def errors(self, seen: np.ndarray, recording: Recording) -> np.ndarray:
        """Simulated less measured channels of one recording, in multiples of the noise, as one vector."""
        measured = np.column_stack([recording.channels[c] for c in CHANNELS])
        return ((seen[: len(measured)] - measured) / self.noise).ravel()


def limits(campaign: Campaign) -> tuple[np.ndarray, np.ndarray]:
    """Declared values of the five parameters, and their standard deviations."""
    declared = np.array([campaign.rig[name] for name in NAMES])
    return declared, declared * [UNCERTAINTY[name] for name in NAMES]


def by_twin(campaign: Campaign) -> Answer:
    """twin's calibration."""
    with ResidualPool(THREADS) as pool:
        fit = calibrate(campaign, pool).base
    found = {u.name: float(x) for u, x in zip(fit.unknowns, fit.values, strict=True) if u.kind == "rig"}
    return Answer(np.array([found[name] for name in NAMES]), None)


def by_scipy(campaign: Campaign) -> Answer:
    """scipy's trust-region least squares, the Jacobian's columns rolled out together."""
    rollouts, (declared, deviation) = Rollouts(campaign), limits(campaign)
    change = 1e-3  # standard deviations

    def residual(z: np.ndarray) -> np.ndarray:
        return rollouts.residuals([declared + deviation * z])[0]

    def jacobian(z: np.ndarray) -> np.ndarray:
        moved = [declared + deviation * (z + change * row) for row in np.eye(len(z))]
        here, *there = rollouts.residuals([declared + deviation * z, *moved])
        return np.column_stack([(column - here) / change for column in there])

    bounds = (-RANGE * np.ones(len(NAMES)), RANGE * np.ones(len(NAMES)))
    result = least_squares(
        residual, np.zeros(len(NAMES)), jacobian, bounds, ftol=TOLERANCE, xtol=None, gtol=None
    )
    return Answer(declared + deviation * result.x, rollouts.simulated)


def by_sysid(campaign: Campaign) -> Answer:
    """MuJoCo's system identification toolbox."""
    sysid = machine.peer("mujoco.sysid", "'mujoco[sysid]'")
    rollouts, (declared, deviation) = Rollouts(campaign), limits(campaign)
    parameters = sysid.ParameterDict()
    for name, value, sigma in zip(NAMES, declared, deviation, strict=True):
        parameters.add(sysid.Parameter(name, value, value - RANGE * sigma, value + RANGE * sigma))
    spec = rollouts.spec(declared)
    model = spec.compile()
    control, seen, starts = [], [], []
    for r in rollouts.recordings:
        control.append(sysid.TimeSeries(r.time, r.channels["torque_command"][:, None]))
        seen.append(
            sysid.TimeSeries.from_names(r.time, np.column_stack([r.channels[c] for c in CHANNELS]), model)
        )
        starts.append(rollouts.start(model, r))
    sequences = sysid.ModelSequences(
        "rig", spec, [r.name for r in rollouts.recordings], starts, control, seen
    )

    def compiled(values: Any, _spec: mujoco.MjSpec) -> mujoco.MjModel:
        return rollouts.spec(values.as_vector()).compile()

    def errors(_p: Any, predicted: Any, measured: Any, *_a: Any, **_k: Any) -> tuple[np.ndarray, Any, Any]:
        rollouts.simulated += 1
        rows = min(len(predicted.data), len(measured.data))
        return ((predicted.data[:rows] - measured.data[:rows]) / rollouts.noise).ravel(), predicted, measured

    residual = sysid.build_residual_fn(
        models_sequences=[sequences], build_model=compiled, modify_residual=errors, n_threads=THREADS
    )
    answer, _ = sysid.optimize(
        parameters, residual, verbose=False, x_scale=deviation, eps=1e-3, xtol=1e-4, output=io.StringIO()
    )
    return Answer(answer.as_vector(), rollouts.simulated)


class Timed(NamedTuple):
    """A result with its processor time on all threads [s]."""

    result: Any
    cpu: float


def timed(run: Callable[[], Any]) -> Timed:
    """Runs once."""
    cpu = machine.processor_time()
    result = run()
    return Timed(result, machine.processor_time() - cpu)


def print_fits(campaign: Campaign, truth: np.ndarray, rounds: int) -> float:
    """Prints the table of the fits; returns the processor time of the quickest fit to rollouts [s]."""
    fits = {"twin": by_twin, "least_squares": by_scipy, "mujoco.sysid": by_sysid}
    declared, deviation = limits(campaign)
    by_twin(campaign)  # compiles
    turns = [{name: timed(lambda f=fit: f(campaign)) for name, fit in fits.items()} for _ in range(rounds)]
    judge = Rollouts(campaign)

    def accuracy(values: np.ndarray) -> str:
        errors = " | ".join(f"{e:+.3f}" for e in (values - truth) / deviation)
        return f"{errors} | {np.sqrt(np.mean(judge.residuals([values])[0] ** 2)):.3f} |"

    print("| fit | CPU s | CPU over twin's | recordings simulated | " + " | ".join(NAMES), end="")
    print(" | output error, RMS |\n| --- " + "| ---: " * (len(NAMES) + 4) + "|")
    for name in fits:
        answer = turns[0][name].result
        cpu = np.median([turn[name].cpu for turn in turns])
        ratio = np.median([turn[name].cpu / turn["twin"].cpu for turn in turns])
        print(f"| {name} | {cpu:.2f} | {ratio:.2f} | {answer.simulated or ''} | {accuracy(answer.values)}")
    for name, values in (("declared", declared), ("truth", truth)):
        print(f"| {name} | | | | {accuracy(values)}")
    print(flush=True)
    return min(float(np.median([turn[name].cpu for turn in turns])) for name in fits if name != "twin")


def print_diagnoses(campaigns: dict[str, Campaign], fit: float) -> None:
    """Prints the table of the diagnoses beside fits that each take some processor time [s]."""
    print(
        "| missing | found | diagnosis, CPU s | in fits of the quickest other | a fit for each effect, CPU s |"
    )
    print("| --- | --- | ---: | ---: | ---: |")
    for name, campaign in campaigns.items():
        answer = timed(lambda c=campaign: diagnose(c, workers=THREADS))
        found = ", ".join(a.name for a in answer.result.effects) or "nothing"
        cells = f"{answer.cpu:.1f} | {answer.cpu / fit:.1f} | {len(REGISTRY) * fit:.1f}"
        print(f"| {name} | {found} | {cells} |", flush=True)


def main() -> None:
    """Prints both tables."""
    parser = argparse.ArgumentParser(
        description="Fits and diagnoses beside least squares over MuJoCo rollouts."
    )
    parser.add_argument("--rounds", type=int, default=3, help="of the fits, which take turns")
    rounds = parser.parse_args().rounds
    machine.peer("mujoco.sysid._src.optimize", "'mujoco[sysid]'")
    print(f"`{machine.command()}` on {machine.describe()}\n", flush=True)
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1):
        made = {name: make(Path(folder) / name.replace(" ", "-"), e) for name, e in EFFECTS.items()}
        fit = print_fits(*made["nothing"], rounds)
        print_diagnoses({name: campaign for name, (campaign, _) in made.items()}, fit)


if __name__ == "__main__":
    main()

"""Which effects explain Table III of Bossi et al. 2009, where measured open-loop turns are smaller than simulated ones?

The paper gives for each of five bang-bang torques the turn of its design without friction, that of its full simulation
and the measured one, but not the torques. These are reconstructed first: families of profiles whose turns, by the
paper's own model or by this twin, are the paper's simulated ones. Then every effect of the library, the friction levels
and some pairs are fitted to the five measured turns, from several starts, with each of these families.

The error of a turn is its measured standard deviation and the RMS by which the family misses the simulated column.
Accepted candidates are checked on what was not fitted: each turn by a fit to the other four, the scatter of the turns
if friction changes by 2 % from run to run, and the LQ step of the paper's Fig. 9.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial

import machine
import numpy as np
from open_loop import DURATION, Family, Profile
from turns import (
    FreeParameter,
    MeasuredTurns,
    Search,
    TurnFit,
    changes_turns,
    declared_parameters,
    final_turns,
    fit,
    free_parameters,
    with_parameters,
)

from twin.control.plants.paper import PaperPlant
from twin.effects import REGISTRY
from twin.mechanics import chain
from twin.rigs import preset
from twin.rigs.model import Model

DESIGNED = np.radians([20.0, 45.0, 60.0, 90.0, 120.0])
SIMULATED = np.radians([18.84, 42.70, 58.25, 85.00, 112.00])
MEASURED = np.radians([10.49, 29.15, 51.60, 69.00, 67.62])
SPREAD = np.radians([0.25, 0.45, 0.44, 0.46, 2.01])
"""Table III of Bossi et al. 2009: designed, simulated and measured turns, and their standard deviations [rad]."""

SEGMENTS, STEP = 4, 2e-3  # s
FINE_SEGMENTS, FINE_STEP = 8, 1e-3  # s; for a check of the discretisation
GROWTHS = (0.0, 0.25, 0.5, 0.75, 1.0)
PAUSES = (0.0, 0.1, 0.2, 0.3)  # s
TORQUES = {True: np.geomspace(0.12, 0.214, 24), False: np.geomspace(0.22, 0.45, 48)}
"""Amplitudes that are tried [N m]: up to the torque limit where the simulation has one, else beyond it."""
PAPER_FAMILIES = {
    limited: tuple(
        Family(float(u), growth, pause)
        for growth in (0.0, 0.25, 0.5)
        for pause in (0.0, 0.1, 0.2)
        for u in np.geomspace(*ends, 10)
    )
    for limited, ends in ((True, (0.15, 0.214)), (False, (0.22, 0.35)))
}
"""Families that are tried on the paper's own model, with the torque limit and without it."""
PAPER_PERIOD = 1e-3  # s, sample period of the paper's model
DECLARED = {
    "static friction": ("static_friction",),
    "coulomb friction": ("coulomb_friction",),
    "both friction levels": ("static_friction", "coulomb_friction"),
    "torque limit": ("torque_limit",),
}
"""Declared parameters that are candidates."""
MAX_START_MISFIT = 150.0
"""Chi-squared of a random point up to which it is improved: five runs are accepted below about 10."""
PROMISING_MISFIT, LONG_SEARCH = 40.0, Search(draws=40, steps=40, seed=2, max_start_misfit=MAX_START_MISFIT)
"""Chi-squared up to which a candidate is searched again from other points, and the extent of that search."""
SHORT_SEARCH = Search(draws=6, follow=1, steps=8, max_start_misfit=MAX_START_MISFIT)
"""Search for effects with a twenty times shorter time step (contacts of a backlash): less extensive."""
MAX_RMS = math.radians(1.5)  # RMS to the simulated column up to which a family is used
MAX_PAIR_PARAMETERS = 4  # at most, so that one turn is left to test a pair
PAIRED_CANDIDATES = 4  # number of the best candidates that are combined in pairs
MIN_CHECKED_PROBABILITY = 0.01  # p-value from which a candidate is checked: accepted ones and near misses


@cache
def rig_model(segments: int = SEGMENTS, step: float = STEP) -> Model:
    """The declared rig as a coarse chain."""
    rig = preset("bossi2009")
    return Model(rig, {}, chain.build(rig, segments).shape, step=step)


@dataclass(frozen=True)
class Reconstruction:
    """A family of profiles, and its misfit to the simulated column.

    Attributes:
      family: of profiles.
      limited: whether the simulation had the torque limit, as the rig had.
      turns: (5) simulated [rad].
      rms: of their misfit to the simulated column [rad].
      by_paper: whether the paper's own model was simulated, not the twin.
    """

    family: Family
    limited: bool
    turns: np.ndarray
    rms: float
    by_paper: bool = False

    def outcomes(self) -> MeasuredTurns:
        """Returns the measured turns, with the error of the reconstruction added."""
        profiles = self.family.profiles(preset("bossi2009"), DESIGNED)
        return MeasuredTurns(profiles, MEASURED, np.hypot(SPREAD, self.rms))


def reconstruct(family: Family, limited: bool = True) -> Reconstruction:
    """Simulates a family on the declared rig with the twin."""
    model = rig_model()
    if not limited:
        model = model.replace(declared=model.declared.replace(torque_limit=math.inf))
    found = final_turns(model, family.profiles(model.declared, DESIGNED))
    return Reconstruction(family, limited, found, _rms(found))


def reconstruct_by_paper(family: Family, limited: bool = True) -> Reconstruction:
    """Simulates a family on the paper's own model of the declared rig."""
    profiles = family.profiles(preset("bossi2009"), DESIGNED)
    found = np.array([turn_by_paper(profile, limited) for profile in profiles])
    return Reconstruction(family, limited, found, _rms(found), by_paper=True)


def turn_by_paper(profile: Profile, limited: bool) -> float:
    """Returns the angle of rest by the paper's own model [rad]; the mean torque of each period is held."""
    model = rig_model()
    if not limited:
        model = model.replace(declared=model.declared.replace(torque_limit=math.inf))
    plant = PaperPlant(model, PAPER_PERIOD)
    pulse = profile.torque * profile.half
    at = np.cumsum([0.0, profile.half, profile.pause, profile.half])
    impulse = np.interp(np.arange(0.0, DURATION, PAPER_PERIOD), at, [0.0, pulse, pulse, 0.0])
    for torque in np.diff(impulse) / PAPER_PERIOD:
        plant.advance(float(torque))
    return plant.read()["hub_angle"]


def _rms(found: np.ndarray) -> float:
    """Misfit of turns (5) [rad] to the simulated column."""
    return float(np.sqrt(np.mean((found - SIMULATED) ** 2)))


def best_by_pause(pool: ProcessPoolExecutor, growth: float, limited: bool) -> list[Reconstruction]:
    """Returns the best torque for each pause, best first."""
    families = [Family(float(u), growth, pause) for pause in PAUSES for u in TORQUES[limited]]
    tried = list(pool.map(partial(reconstruct, limited=limited), families, chunksize=20))
    by_pause = [[r for r in tried if r.family.pause == pause] for pause in PAUSES]
    return sorted((min(group, key=lambda r: r.rms) for group in by_pause), key=lambda r: r.rms)


@dataclass(frozen=True)
class Task:
    """A fit to run.

    Attributes:
      candidate: names of effects, of `DECLARED`, or "none".
      reconstruction: family of profiles.
      search: its extent.
      kept: indices of the fitted runs.
    """

    candidate: tuple[str, ...]
    reconstruction: Reconstruction
    search: Search
    kept: tuple[int, ...] = (0, 1, 2, 3, 4)

    @property
    def free(self) -> tuple[FreeParameter, ...]:
        """Parameters that are fitted."""
        return tuple(f for name in self.candidate for f in _parameters(name))

    def run(self) -> TurnFit:
        """Returns the fit with the turns of all five runs and the misfit of the fitted ones."""
        outcomes = self.reconstruction.outcomes()
        search = SHORT_SEARCH if _needs_short_steps(self.free) else self.search
        found = fit(rig_model(), self.free, outcomes.only(self.kept), search)
        if len(self.kept) == len(outcomes.mean):
            return found
        return TurnFit(found.effects, final_turns(fitted(found), outcomes.profiles), found.misfit, found.free)


def _needs_short_steps(free: tuple[FreeParameter, ...]) -> bool:
    """Whether parameters belong to an effect that limits the time step."""
    rng = np.random.default_rng(0)
    plant = with_parameters(rig_model(), free, [f.draw(rng) for f in free]).plant
    return plant.largest_step < STEP


def _parameters(name: str) -> tuple[FreeParameter, ...]:
    """Fit parameters of a candidate by name: an effect, declared parameters, or none."""
    if name == "none":
        return ()
    if name in REGISTRY:
        return free_parameters(rig_model(), name)
    return declared_parameters(rig_model(), *DECLARED[name])


def fitted(found: TurnFit, model: Model | None = None) -> Model:
    """Returns a model, by default the coarse one, with the parameters of a fit."""
    model = model or rig_model()
    effects = {name: p for name, p in found.effects.items() if name != "rig"}
    own = found.effects.get("rig", {})
    return model.replace(declared=model.declared.replace(**own), effects=effects)


def is_active(name: str, profiles) -> bool:
    """Whether an effect changes the angle at which the hub comes to rest."""
    return changes_turns(rig_model(), _parameters(name), profiles)


def run_all(pool: ProcessPoolExecutor, tasks: Iterable[Task]) -> list[tuple[Task, TurnFit]]:
    """Runs tasks and returns their fits in order; promising candidates are searched twice."""
    first = _run_tasks(pool, list(tasks))
    again = [
        replace(task, search=LONG_SEARCH)
        for task, found in first
        if found.free and found.misfit < PROMISING_MISFIT
    ]
    second = {
        (task.candidate, family_key(task.reconstruction)): found for task, found in _run_tasks(pool, again)
    }
    both = [
        (task, found, second.get((task.candidate, family_key(task.reconstruction)))) for task, found in first
    ]
    return [(task, min(a, b or a, key=lambda f: f.misfit)) for task, a, b in both]


def _run_tasks(pool: ProcessPoolExecutor, todo: list[Task]) -> list[tuple[Task, TurnFit]]:
    done = []
    for task, found in zip(todo, pool.map(Task.run, todo), strict=True):
        done.append((task, found))
        print(
            f"{len(done)}/{len(todo)} {' + '.join(task.candidate)} {found.misfit:.1f}",
            file=sys.stderr,
            flush=True,
        )
    return done


def turn_scatter(found: TurnFit, profiles, draws: int = 24, relative: float = 0.02) -> np.ndarray:
    """Standard deviation of each turn (5) [rad] if both friction levels change at random from run to run.

    The levels of both directions change by the same factor.
    """
    rng, model = np.random.default_rng(2), fitted(found)
    rows = [
        final_turns(_with_scaled_friction(model, *(1 + relative * rng.standard_normal(2))), profiles)
        for _ in range(draws)
    ]
    return np.std(rows, axis=0)


def _with_scaled_friction(model: Model, static: float, coulomb: float) -> Model:
    hub = model.plant.friction
    return model.with_friction(
        static_positive=hub.static_positive * static,
        static_negative=hub.static_negative * static,
        coulomb_positive=hub.coulomb_positive * coulomb,
        coulomb_negative=hub.coulomb_negative * coulomb,
    )


def step_end(found: TurnFit) -> float:
    """Hub angle 5 s after a step of 120 degrees under the paper's LQ regulator, designed for the declared rig [deg].

    The regulator reads the hub's true angle: NaN for a candidate that changes the sensor alone.
    """
    from twin.control import closed_loop, plants, scenarios

    if found.effects and all(name.startswith("hub-sensor") for name in found.effects):
        return math.nan
    rig = preset("bossi2009")
    own = rig.replace(**found.effects.get("rig", {}))
    effects = {name: p for name, p in found.effects.items() if name != "rig"}
    plant, chosen = (
        plants.make_plant("compiled", own, effects, segments=SEGMENTS),
        scenarios.scenario("lq-step-120"),
    )
    law = chosen.own_controller(rig, plant.period)
    return float(
        np.degrees(closed_loop.run(plant, law, chosen.reference, chosen.duration).true["hub_angle"][-1])
    )


def degrees(values: np.ndarray, digits: int = 1) -> str:
    """Angles [rad] as text, in degrees."""
    return ", ".join(f"{v:.{digits}f}" for v in np.degrees(values))


def parameter_text(found: TurnFit) -> str:
    """Names and values of the fitted parameters as text."""
    moved = [f"{name} {value:.3g}" for p in found.effects.values() for name, value in p.items()]
    return ", ".join(moved) or "-"


HEADS = "| growth | pause s | largest torque N·m | shortest, longest run s | turns deg | rms deg |"
RULES = "| ---: | ---: | ---: | ---: | --- | ---: |"


def print_by_paper(pool: ProcessPoolExecutor, limited: bool) -> Reconstruction:
    """Prints the best torque of each growth and pause by the paper's own model; returns the best of all."""
    print(
        f"\n### By the paper's own model, {'with' if limited else 'without'} the torque limit\n\n{HEADS}\n{RULES}"
    )
    reconstructed = pool.map(
        partial(reconstruct_by_paper, limited=limited), PAPER_FAMILIES[limited], chunksize=4
    )
    tried = sorted(reconstructed, key=lambda r: r.rms)
    kinds = {(r.family.growth, r.family.pause): r for r in reversed(tried)}
    for r in sorted(kinds.values(), key=lambda r: r.rms):
        print("| " + " | ".join(cells_of(r)) + " |", flush=True)
    return tried[0]


def cells_of(r: Reconstruction) -> list[str]:
    """Cells of a family in a table."""
    ends = [2 * p.half + p.pause for p in r.outcomes().profiles]
    cells = [f"{r.family.growth:g}", f"{r.family.pause:g}", f"{r.family.torque:.3f}"]
    return [*cells, f"{min(ends):.2f}, {max(ends):.2f}", degrees(r.turns), f"{math.degrees(r.rms):.2f}"]


def print_families(pool: ProcessPoolExecutor, limited: bool) -> list[Reconstruction]:
    """Prints the best families of each growth; returns those within `MAX_RMS`, best first."""
    print(f"\n### {'With' if limited else 'Without'} the torque limit in the simulation\n")
    print(f"{HEADS} at the limit |\n{RULES} --- |")
    likely = []
    for growth in GROWTHS:
        best = best_by_pause(pool, growth, limited)
        likely += [r for r in best if r.rms < MAX_RMS]
        for r in best[:2]:
            held = "the same" if limited else degrees(final_turns(rig_model(), r.outcomes().profiles))
            print("| " + " | ".join([*cells_of(r), held]) + " |", flush=True)
    return sorted(likely, key=lambda r: r.rms)


def selected_families(limited: list[Reconstruction], free: list[Reconstruction]) -> list[Reconstruction]:
    """Returns the best family with the limit, the best of another growth and pause, and one without the limit.

    The last one is the family whose turns with the limit are nearest to the measured ones.
    """
    best = limited[0].family
    others = [r for r in limited if r.family.growth != best.growth and r.family.pause != best.pause]
    return [limited[0], *others[:1], *sorted(free, key=_misfit_at_limit)[:1]]


def _misfit_at_limit(r: Reconstruction) -> float:
    outcomes = r.outcomes()
    return outcomes.misfit(final_turns(rig_model(), outcomes.profiles))


def print_finer(families: list[Reconstruction]) -> None:
    """Prints the turns of the selected families on the declared rig, on both chains."""
    print("\n### The families that are used, on the declared rig with its torque limit\n")
    coarse, fine = f"{SEGMENTS} segments, {STEP:g} s", f"{FINE_SEGMENTS} segments, {FINE_STEP:g} s"
    print(f"| family | {coarse} | {fine} |\n| --- | --- | --- |")
    for k, r in enumerate(families):
        profiles = r.outcomes().profiles
        both = [final_turns(rig_model(*size), profiles) for size in ((), (FINE_SEGMENTS, FINE_STEP))]
        print(f"| {k + 1} | {degrees(both[0])} | {degrees(both[1])} |", flush=True)


@dataclass(frozen=True)
class Row:
    """Fits of a candidate with every family, best first."""

    candidate: tuple[str, ...]
    fits: tuple[tuple[Task, TurnFit], ...]

    @property
    def best(self) -> TurnFit:
        """The fit with the least misfit."""
        return self.fits[0][1]

    @property
    def passed(self) -> int:
        """Number of families with which the candidate is accepted."""
        return sum(found.passes for _, found in self.fits)


def rows(results: list[tuple[Task, TurnFit]]) -> list[Row]:
    """Returns the results by candidate, least misfit first."""
    names = dict.fromkeys(task.candidate for task, _ in results)
    grouped = {name: [r for r in results if r[0].candidate == name] for name in names}
    table = [Row(name, tuple(sorted(group, key=lambda r: r[1].misfit))) for name, group in grouped.items()]
    return sorted(table, key=lambda row: row.best.misfit)


def print_fits(title: str, table: list[Row], families: list[Reconstruction]) -> None:
    """Prints one table of candidates."""
    print(f"\n## {title}\n")
    print(
        f"Measured: {degrees(MEASURED, 2)} degrees. Misfit (chi-squared) by family, {family_list(families)}.\n"
    )
    heads = ["candidate", "free", *(f"family {k + 1}" for k in range(len(families))), "passes"]
    print("| " + " | ".join([*heads, "best: turns deg", "rms deg", "parameters (SI)"]) + " |")
    print("| --- | ---: | " + "---: | " * len(families) + "---: | --- | ---: | --- |")
    for row in table:
        by_family = {family_key(task.reconstruction): found for task, found in row.fits}
        misfits = [f"{by_family[family_key(r)].misfit:.1f}" for r in families]
        rms = math.degrees(np.sqrt(np.mean((row.best.turns - MEASURED) ** 2)))
        cells = [" + ".join(row.candidate), str(row.best.free), *misfits, f"{row.passed} of {len(families)}"]
        print(
            "| "
            + " | ".join([*cells, degrees(row.best.turns), f"{rms:.1f}", parameter_text(row.best)])
            + " |"
        )


def family_key(r: Reconstruction) -> tuple[Family, bool, bool]:
    """Key that identifies a family."""
    return r.family, r.limited, r.by_paper


def family_list(families: list[Reconstruction]) -> str:
    """Families as text."""
    each = [
        f"{r.family.torque:.3f} N·m, growth {r.family.growth:g}, pause {r.family.pause:g} s"
        + (", by the paper's model" if r.by_paper else "" if r.limited else ", simulated without the limit")
        for r in families
    ]
    return "; ".join(f"{k + 1}: {text}" for k, text in enumerate(each))


def print_checks(pool: ProcessPoolExecutor, table: list[Row]) -> None:
    """Prints predictions of the best candidates for runs and experiments that they were not fitted to."""
    print("\n## Checked on what was not fitted\n")
    print(f"Measured spread: {degrees(SPREAD, 2)} degrees; LQ step, Fig. 9: 121.1 +- 0.3 degrees.\n")
    heads = ["candidate", "parameters (SI)", "each turn from the other four, deg", "on the finer chain, deg"]
    print("| " + " | ".join([*heads, "spread at 2 % friction, deg", "LQ step ends at deg"]) + " |")
    print("| --- | --- | --- | --- | --- | ---: |")
    for row in [
        declared_row(table),
        *[r for r in table if r.best.free and r.best.probability > MIN_CHECKED_PROBABILITY],
    ]:
        task, best = row.fits[0]
        predicted = np.array([found.turns[k] for k, found in enumerate(leave_one_out(pool, task))])
        profiles = task.reconstruction.outcomes().profiles
        finer = final_turns(fitted(best, rig_model(FINE_SEGMENTS, FINE_STEP)), profiles)
        cells = [" + ".join(row.candidate), parameter_text(best), degrees(predicted), degrees(finer)]
        cells += [degrees(turn_scatter(best, profiles), 2), f"{step_end(best):.1f}"]
        print("| " + " | ".join(cells) + " |", flush=True)


def leave_one_out(pool: ProcessPoolExecutor, task: Task) -> list[TurnFit]:
    """Returns the fits without each run in turn."""
    runs = range(len(MEASURED))
    kept = [tuple(k for k in runs if k != out) for out in runs]
    return list(pool.map(Task.run, [replace(task, kept=k) for k in kept]))


def declared_row(table: list[Row]) -> Row:
    """Returns the row of the declared rig."""
    return next(row for row in table if row.candidate == ("none",))


def pairs(table: list[Row]) -> list[tuple[str, ...]]:
    """Pairs of the best candidates with few enough parameters for a degree of freedom to test them."""
    single = [row for row in table if 0 < row.best.free <= MAX_PAIR_PARAMETERS // 2][:PAIRED_CANDIDATES]
    both = itertools.combinations(single, 2)
    small = [(a, b) for a, b in both if a.best.free + b.best.free <= MAX_PAIR_PARAMETERS]
    named = [(*a.candidate, *b.candidate) for a, b in small]
    return [
        names for names in named if len(_replaced_parameters(names)) == len({*_replaced_parameters(names)})
    ]


def _replaced_parameters(names: tuple[str, ...]) -> list[str]:
    """Declared parameters that candidates replace, one of them twice where two candidates do."""
    taken = [REGISTRY[n].replaces if n in REGISTRY else DECLARED[n] for n in names]
    return [parameter for each in taken for parameter in each]


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--draws", type=int, default=24, help="points drawn per free parameter")
    options = parser.parse_args()
    search = Search(draws=options.draws, steps=20, max_start_misfit=MAX_START_MISFIT)
    print(f"# Table III\n\n`{machine.command()}` on {machine.describe()}\n")
    with ProcessPoolExecutor(options.jobs) as pool:
        print("## Profiles that give the simulated column\n")
        print(f"Simulated in the paper: {degrees(SIMULATED, 2)} degrees.")
        papers = print_by_paper(pool, True)
        print_by_paper(pool, False)
        families = [papers, *selected_families(print_families(pool, True), print_families(pool, False))]
        print_finer(families)
        profiles = families[0].outcomes().profiles
        active = [name for name in REGISTRY if is_active(name, profiles)]
        candidates = [("none",), *[(name,) for name in (*DECLARED, *active)]]
        singles = rows(run_all(pool, [Task(c, f, search) for c in candidates for f in families]))
        print_fits("One effect at a time", singles, families)
        idle = [name for name in REGISTRY if name not in active]
        print(f"\nWithout influence on where the hub comes to rest: {', '.join(idle)}.", flush=True)
        double = rows(run_all(pool, [Task(c, f, search) for c in pairs(singles) for f in families]))
        print_fits("Pairs", double, families)
        print_checks(pool, sorted([*singles, *double], key=lambda row: row.best.misfit))


if __name__ == "__main__":
    main()

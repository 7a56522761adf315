"""The identification of a rig: the procedures of the paper on a campaign, and one joint estimate started by them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from scipy.ndimage import label
from threadpoolctl import threadpool_limits

from twin.campaigns.campaign import Campaign
from twin.effects import REGISTRY
from twin.identification import (
    as_json,
    backbone,
    balance,
    break_away,
    compare_campaigns,
    decay,
    findings,
    friction_map,
    held_out,
    joint,
    near_modes,
    spectra,
    static_test,
    total_inertia,
)
from twin.identification.backbone import Backbone
from twin.identification.balance import Balance
from twin.identification.break_away import StaticFriction
from twin.identification.compare_campaigns import Comparison
from twin.identification.decay import Decay
from twin.identification.estimates import (
    TWO_SIDED_95,
    Estimate,
    Finding,
    Identified,
    IntervalBy,
    Kind,
    Mode,
    mode_json,
    parameter_json,
    pooled,
)
from twin.identification.friction_map import FrictionMap
from twin.identification.held_out import HeldOutError
from twin.identification.joint import Joint, with_link
from twin.identification.spectra import Response
from twin.identification.static_test import StaticTest
from twin.identification.total_inertia import Momentum
from twin.mechanics import beam, modal
from twin.mechanics.planar import STUCK
from twin.parameters import Rig, declared_range
from twin.progress import Progress, silent
from twin.residuals.prepared import Prepared, sensor_corrected_start
from twin.rigs.model import Model, fine
from twin.rigs.simulate import simulate

_Read = TypeVar("_Read")
_CLEAR = 0.02  # relative error of a frequency up to which a decay at rest is one
_FREE, _TOTAL = "a first frequency, hub free", "a total inertia"
_KNOWN_BEFORE = 0.7  # of the declared uncertainty: an error above it is hardly news
_TOO_SURE = 1e-5  # of the declared uncertainty: an error below it is one of slopes that are none


@dataclass(frozen=True)
class Identification:
    """The answer; `to_json` gives its interface.

    Attributes:
      campaign: its name.
      rig: as declared.
      parameters: of the rig, by name.
      effects: the same of the effects that it is known to have, by effect.parameter.
      modes: seen in the recordings.
      not_determined: parameter -> why the recordings do not say it.
      findings: what each procedure found, or what it lacks.
      decays: ring-downs of the clamped link.
      static_friction: break-aways.
      hub: its torque balance; None where the recordings say too little.
      whole: balance of the rig's angular momentum; None likewise.
      released: map of the friction from a release of the unclamped link; None without one.
      load: the static test; None where there is none that can be used.
      spectrum: response of the link to the torque; None where no torque excites a broad band.
      moved: how the first resonance moves with amplitude; None where too few recordings tell.
      joint: the joint estimate.
      figures: what it makes of the whole rig: name -> figure, unit.
      held_out: errors on held-out recordings, which are simulated once, at the end.
      notes: what is odd in the recordings, or was assumed of them.
      compared: its peaks beside those of another campaign of the rig; None where none was named.
      wall_s: how long it took [s].
    """

    campaign: str
    rig: Rig
    parameters: Mapping[str, Identified]
    modes: tuple[Mode, ...]
    not_determined: Mapping[str, str]
    findings: tuple[Finding, ...]
    decays: tuple[Decay, ...]
    static_friction: StaticFriction
    hub: Balance | None
    whole: Momentum | None
    released: FrictionMap | None
    load: StaticTest | None
    spectrum: Response | None
    moved: Backbone | None
    joint: Joint
    figures: Mapping[str, tuple[Estimate, str]]
    held_out: tuple[HeldOutError, ...] = ()
    notes: tuple[str, ...] = ()
    compared: Comparison | None = None
    effects: Mapping[str, Identified] = field(default_factory=dict)
    wall_s: float = 0.0

    @property
    def numbers(self) -> dict[str, Identified]:
        """All parameters, of the rig and of its effects."""
        return {**self.parameters, **self.effects}

    def to_json(self) -> dict[str, Any]:
        """Returns the answer as a dictionary of plain values."""
        return {
            "campaign": self.campaign,
            "parameters": {name: parameter_json(p) for name, p in self.parameters.items()},
            "effects": {name: parameter_json(p) for name, p in self.effects.items()},
            "modes": [mode_json(mode) for mode in self.modes],
            "not_determined": dict(self.not_determined),
            "findings": [
                {"procedure": f.procedure, "sentences": list(f.sentences), "missing": f.missing}
                for f in self.findings
            ],
            **({} if self.compared is None else {"against": self.compared.to_json()}),
            "total_inertia": as_json.total_inertia(self.whole, self.figures[_TOTAL][0]),
            "backbone": None if self.moved is None else as_json.backbone(self.moved),
            "friction_map": None if self.released is None else as_json.friction_map(self.released),
            "loss_laws": [as_json.loss_law(d) for d in self.decays],
            "levels": as_json.levels(self.static_friction, self.hub),
            "correlations": as_json.correlations(self.joint),
            "held_out": [asdict(error) for error in self.held_out],
            "notes": list(self.notes),
            "wall_s": self.wall_s,
        }


def identify(
    campaign: Campaign, progress: Progress = silent, workers: int = 1, other: Campaign | None = None
) -> Identification:
    """Identifies a rig from the fit recordings of a campaign.

    Args:
      campaign: the recordings; held-out ones are predicted, at the end.
      progress: told of every stage.
      workers: number of threads.
      other: of the same rig with another payload or with an air-pad, for the kind of each peak.
    """
    began = time.perf_counter()
    with threadpool_limits(1), ThreadPoolExecutor(workers) as pool:
        load = static_test.read(campaign)
        found = joint.estimate(campaign, pool, progress, _told_before(campaign, load))
        progress("reading decays and break-aways")
        sound = replace(campaign, fit=found.readings)
        decays = ring_downs(sound) or decays_at_rest(found.prepared)
        model, starts = found.fit.model, found.fit.starts
        friction = break_away.read(found.data, model, starts)
        progress("balancing torques")
        hub = _hub_balance(found)
        whole = _momentum(found)
        as_read = _with_static(fine(model), friction)
        released = _friction_map(found, as_read)
    seen = spectra.response(sound.fit)
    free_modes = _free_modes(found.fit.model.declared, seen)
    moved = _backbone(sound, found, as_read)
    compared = (
        compare_campaigns.compare(campaign, other, found.fit.model.declared) if other is not None else None
    )
    figures = _figures(campaign.rig, found)
    (total, _), (small, _) = figures[_TOTAL], figures[_FREE]
    tip_mass = _payload(campaign.rig, found, hub, whole)
    methods = _methods(campaign.rig, found, decays, friction, hub, load, released, tip_mass)
    identified = {name: _identified(campaign, name, found, methods[name]) for name in found.names}
    parameters = {name: p for name, p in identified.items() if name in campaign.rig}
    rig = campaign.rig.replace("identified", **{name: p.value for name, p in parameters.items()})
    progress("predicting the held-out recordings")
    with threadpool_limits(1), ThreadPoolExecutor(workers) as pool:
        predicted, left_out = held_out.errors(campaign, found, rig, pool)
    return Identification(
        campaign=campaign.name,
        rig=campaign.rig,
        parameters=parameters,
        modes=(*(_clamped_mode(d) for d in decays), *free_modes),
        effects={name: p for name, p in identified.items() if name not in campaign.rig},
        not_determined=_not_determined(identified, found),
        findings=(
            findings.static(load, _declared(campaign.rig, "bending_stiffness")),
            findings.decays(decays),
            findings.break_aways(friction),
            findings.coulomb(hub, released, found, friction.level),
            findings.inertia(hub, whole, total, tip_mass, found),
            findings.spectra(seen, free_modes, moved, small),
            *([findings.compared(compared)] if compared is not None else []),
            findings.joint(found, figures, predicted),
        ),
        notes=(*campaign.warnings, *found.notes, *left_out),
        compared=compared,
        decays=decays,
        static_friction=friction,
        hub=hub,
        released=released,
        whole=whole,
        load=load,
        spectrum=seen,
        moved=moved,
        joint=found,
        figures=figures,
        held_out=predicted,
        wall_s=time.perf_counter() - began,
    )


def _told_before(campaign: Campaign, load: StaticTest | None) -> dict[str, float]:
    """Stiffness and damping ratio by the procedures that need no simulation, where they tell more than is declared."""
    rig, decays = campaign.rig, ring_downs(campaign)
    said = [
        ("bending_stiffness", load.stiffness if load else None),
        ("bending_stiffness", _stiffness_by_frequency(rig, decays) if decays else None),
        ("damping_ratio", _damping(rig, decays) if decays else None),
    ]
    told: dict[str, Estimate] = {}
    for name, value in said:
        known = told.get(name, _declared(rig, name))
        if value is not None and value.standard_error < known.standard_error:
            told[name] = value
    return {name: value.value for name, value in told.items()}


def _hub_balance(found: Joint) -> Balance | None:
    model, starts = found.fit.model, found.fit.starts
    others = _off_by_an_error(found, model)
    return _with_errors(lambda m: balance.of_hub(found.data, m, starts), balance.with_error_of, model, others)


def _momentum(found: Joint) -> Momentum | None:
    model = found.fit.model
    # The link's damping takes nothing from the momentum of the whole.
    others = _off_by_an_error(found, model, losses=False)
    return _with_errors(
        lambda m: total_inertia.of_rig(found.data, m), total_inertia.with_error_of, model, others
    )


def _friction_map(found: Joint, model: Model) -> FrictionMap | None:
    others = _off_by_an_error(found, model)

    def read(tried: Model) -> FrictionMap | None:
        return friction_map.read(tried, found.prepared, found.fit.starts)

    return _with_errors(read, friction_map.with_error_of, model, others)


def _with_errors(
    read: Callable[[Model], _Read | None],
    grown: Callable[[_Read, _Read], _Read],
    model: Model,
    others: Sequence[Model],
) -> _Read | None:
    """What is read with a model, its errors grown by what is read with others, where they tell something."""
    found = read(model)
    if found is None:
        return None
    for other in others:
        if (moved := read(other)) is not None:
            found = grown(found, moved)
    return found


def _off_by_an_error(found: Joint, model: Model, losses: bool = True) -> list[Model]:
    """The model with what balances take as known one standard error larger, each in turn.

    That are the parameters of its effects and, with `losses`, the link's damping, where they are not exact.
    """
    models = []
    for name, value, error in zip(found.names, found.values, found.errors, strict=True):
        effect, _, parameter = name.partition(".")
        if parameter:
            more = {**model.effects[effect], parameter: float(value + error)}
            models.append(model.replace(effects={**model.effects, effect: more}))
        elif losses and name == "damping_ratio":
            damping = min(float(value + error), model.declared.parameters[name].bounds[1])
            models.append(model.replace(declared=model.declared.replace("lossier", damping_ratio=damping)))
    return models


def _backbone(campaign: Campaign, found: Joint, model: Model) -> Backbone | None:
    """How the first resonance moves, and how that of the identified model does in the same sweeps."""
    expected = _first(beam.modes(model.declared, 1))
    moved = backbone.backbone(campaign.fit, expected)
    if moved is None:
        return None
    pairs = [
        (p.recording, simulate(model, p.recording, sensor_corrected_start(model, p, start)))
        for p, start in zip(found.prepared, found.fit.starts, strict=True)
        if p.recording.name in moved.recordings
    ]
    return backbone.beside(moved, pairs, expected)


def _with_static(model: Model, friction: StaticFriction) -> Model:
    """The model with the static friction that was read at break-aways."""
    if friction.level is None:
        return model
    return model.replace(declared=model.declared.replace("read", static_friction=friction.level.value))


def _declared(rig: Rig, name: str) -> Estimate:
    return Estimate(rig[name], joint.prior_deviation(rig, name))


def ring_downs(campaign: Campaign) -> tuple[Decay, ...]:
    """Decays of the clamped link in the fit recordings."""
    found = []
    for recording in campaign.fit:
        channel = decay.link_channel(recording)
        if recording.clamped and channel is not None:
            found.append(decay.ring_down(recording, channel, recording.time[0], recording.time[-1]))
    return tuple(d for d in found if d is not None)


def decays_at_rest(prepared: Sequence[Prepared]) -> tuple[Decay, ...]:
    """Decays of the link while a free hub rests: its friction is the clamp. The longest of each recording."""
    found = []
    for p in prepared:
        channel = decay.link_channel(p.recording)
        if p.hub is None or channel is None:
            continue
        runs, count = label(p.hub.observed == STUCK)
        spans = [p.recording.time[runs == k][[0, -1]] for k in range(1, count + 1)]
        rings = [decay.ring_down(p.recording, channel, first, last) for first, last in spans]
        sure = [d for d in rings if d is not None and d.frequency.standard_error < _CLEAR * d.frequency.value]
        if sure:
            found.append(max(sure, key=lambda d: len(d.middle)))
    return tuple(found)


def _clamped_mode(found: Decay) -> Mode:
    source = f"{found.recording}, {found.channel}"
    return Mode("clamped", found.frequency, found.damping_ratio, "bending", source)


def _methods(
    rig: Rig,
    found: Joint,
    decays: tuple[Decay, ...],
    friction: StaticFriction,
    hub: Balance | None,
    load: StaticTest | None,
    released: FrictionMap | None,
    tip_mass: Estimate | None,
) -> dict[str, dict[str, Estimate]]:
    """Parameter -> procedure -> what it says by itself."""
    if hub is not None and not hub.believed:
        hub = None
    inertia = with_link(hub.inertia, found) if hub else None
    own: dict[str, dict[str, Estimate]] = {name: {} for name in found.names}
    said = {
        ("bending_stiffness", "static"): load.stiffness if load else None,
        ("bending_stiffness", "clamped-frequency"): _stiffness_by_frequency(rig, decays) if decays else None,
        ("damping_ratio", "decay"): _damping(rig, decays) if decays else None,
        ("static_friction", "break-away"): friction.level,
        ("coulomb_friction", "hub-balance"): hub.both if hub else None,
        ("coulomb_friction", "decay-map"): released.level if released else None,
        ("hub_inertia", "hub-balance"): inertia if inertia and inertia.told else None,
        ("tip_mass", "slews"): tip_mass,
    }
    for (name, method), value in said.items():
        if value is not None and name in own:
            own[name][method] = value
    for name in found.names:
        if name != "static_friction":
            own[name]["joint"] = found.estimate(name)
    return own


def _payload(rig: Rig, found: Joint, hub: Balance | None, whole: Momentum | None) -> Estimate | None:
    """The tip mass by the two balances, the link as declared; None where one of them is not believed."""
    if hub is None or whole is None or not (hub.believed and whole.believed and hub.inertia.told):
        return None
    link = {name: _declared(rig, name) for name in ("length", "linear_density", "tip_inertia")}
    return balance.payload(whole.inertia, with_link(hub.inertia, found), link)


def _damping(rig: Rig, decays: tuple[Decay, ...]) -> Estimate:
    """The damping ratio of the free modes that gives the clamped decay its own, all losses in the link's bending.

    How much of it a clamped link shows depends on the declared masses, which are as uncertain as the campaign says.
    """
    clamped = pooled([d.damping_ratio for d in decays])
    share = _clamped_share(rig)
    value = clamped.value / share
    by_rig = value * float(np.linalg.norm(_shares(rig, _clamped_share)))
    return Estimate(value, math.hypot(clamped.standard_error / share, by_rig))


def _shares(rig: Rig, figure: Callable[[Rig], float]) -> list[float]:
    """Relative change of a figure by one standard deviation of each declared mass and length."""
    found = []
    for name in ("linear_density", "length", "tip_mass", "tip_inertia", "hub_inertia"):
        sigma = joint.prior_deviation(rig, name)
        if sigma > 0:
            moved = figure(rig.replace("moved", **{name: rig[name] + 0.1 * sigma}))
            found.append((moved / figure(rig) - 1) / 0.1)
    return found


def _clamped_share(rig: Rig) -> float:
    """Damping ratio of the first clamped mode over that of the free modes [1]; their ratio needs no losses."""
    return float(modal.clamped_damping_ratios(rig.replace(damping_ratio=0.01), 1)[0]) / 0.01


def _stiffness_by_frequency(rig: Rig, decays: tuple[Decay, ...]) -> Estimate:
    """EI = EI' (f/f')^2 with f' of the declared rig, whose masses are as uncertain as it says."""
    seen = pooled([d.frequency for d in decays])
    value = rig["bending_stiffness"] * (seen.value / _first_clamped(rig)) ** 2
    relative = [2 * seen.standard_error / seen.value, *(2 * v for v in _shares(rig, _first_clamped))]
    return Estimate(value, value * float(np.linalg.norm(relative)))


def _first_clamped(rig: Rig) -> float:
    return _first(beam.modes(rig, 1, "clamped"))


def _identified(campaign: Campaign, name: str, found: Joint, methods: dict[str, Estimate]) -> Identified:
    """What was found of a parameter of the rig, or of effect.parameter of an effect that it is known to have."""
    # The static level is in no motion: what is read at break-aways is all that there is beside the declaration.
    best = methods.get("break-away" if name == "static_friction" else "joint")
    unit, declared, prior, reach = _known_before(campaign, name)
    if best is None:
        return Identified(declared, prior or 0.0, unit, declared, prior, methods, reach, "declaration")
    by: IntervalBy = (
        "profile" if name in found.intervals else "covariance" if best.profile is None else "range"
    )
    return Identified(best.value, best.standard_error, unit, declared, prior, methods, best.profile, by)


def _known_before(
    campaign: Campaign, name: str
) -> tuple[str, float, float | None, tuple[float, float] | None]:
    """Unit, declared value, its standard deviation and 95 % interval, if they are known."""
    if name in campaign.rig:
        known = campaign.rig.parameters[name]
        reach = declared_range(known, TWO_SIDED_95)
        return known.unit, known.value, joint.prior_deviation(campaign.rig, name), reach
    effect, _, parameter = name.partition(".")
    declared = campaign.effects[effect]
    error = campaign.effect_errors.get(effect, {}).get(parameter)
    return REGISTRY[effect].units(declared)[parameter], declared[parameter], error, None


def _not_determined(parameters: Mapping[str, Identified], found: Joint) -> dict[str, str]:
    """Parameters whose error is hardly smaller than what was known of them before, and why."""
    said = {name: "stands at the end of its range" for name in found.at_an_end()}
    for name, p in parameters.items():
        if p.declared_error and p.standard_error > _KNOWN_BEFORE * p.declared_error:
            partners = [b if a == name else a for a, b, _ in found.tied() if name in (a, b)]
            said[name] = (
                f"moves together with {partners[0]}"
                if partners
                else "the recordings say no more of it than the campaign does"
            )
        elif p.declared_error and p.standard_error < _TOO_SURE * p.declared_error:
            said[name] = "the likelihood jumps about it, and so small an error is none"
    return said


def _free_modes(rig: Rig, found: Response | None) -> tuple[Mode, ...]:
    """Resonances with a free hub; a bending mode is near one that the identified rig has, and softer at large bends."""
    if found is None:
        return ()
    first_bending = float(near_modes.bending_frequencies(rig, 1)[0])
    source = f"{', '.join(found.recordings)}, {found.channel}"
    modes = []
    for peak in spectra.peaks(found):
        kind: Kind = "bending" if near_modes.near_bending(peak.frequency.value, rig) else "not bending"
        modes.append(Mode("free", peak.frequency, peak.damping_ratio, kind, source))
    first = backbone.resonance(found, first_bending)
    if first is not None and all(
        abs(m.frequency.value / first_bending - 1) > near_modes.SOFTER for m in modes
    ):
        # The top of a peak that friction and large bends have made no mode's.
        modes.insert(0, Mode("free", first, None, "bending", source))
    return tuple(modes)


def _first(found: beam.Modes) -> float:
    return float(found.frequencies[0]) / (2 * np.pi)


def _figures(rig: Rig, found: Joint) -> dict[str, tuple[Estimate, str]]:
    """What the joint estimate makes of the whole rig: name -> figure, unit."""
    return {
        "a first frequency, hub clamped": (
            found.figure(lambda p: _first(beam.modes(p, 1, "clamped")), rig),
            "Hz",
        ),
        _FREE: (found.figure(lambda p: _first(beam.modes(p, 1)), rig), "Hz"),
        _TOTAL: (found.figure(beam.rigid_inertia, rig), "kg m^2"),
        "a tip stiffness 3 EI/l^3": (
            found.figure(lambda p: 3 * p["bending_stiffness"] / p["length"] ** 3, rig),
            "N/m",
        ),
    }

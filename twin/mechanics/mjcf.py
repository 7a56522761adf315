"""The rig as MJCF: segments, hinges, losses, motor, sensors, and what it looks like.

The link bends in the horizontal plane; every joint turns about the vertical, z. At zero angle the link lies
along x. What the numbers of a `Chain` become:

    segment     body `link_i`, a rod with explicit inertia; hub and payload are bodies welded to the end ones
    hinge       joint `bend_i` with stiffness; the hub's is called `hub`
    damping     D = sum_i d_i p_i p_i^T: fixed tendon `loss_i` of length p_i . q with damping d_i, each a mode
    strain      fixed tendon `strain_base` of length half_thickness * w''(x), a row times the hinge angles
    torsion     body `torsion` on a spring on the hub's axis
    backlash    body `rotor` with a joint of its own that the motor turns; the fixed tendon `play`, rotor less hub,
                is limited to the gap
    friction    frictionloss at the Coulomb level, for plain viewers. MuJoCo knows one level only: the
                break-away level stands in `custom/numeric` and is applied by `twin.mechanics.mujoco_chain`. Coulomb
                levels that differ by the direction are their mean and a constant torque, actuator `friction_difference`
    lag         a filter in the motor's actuator
    air drag    geom `drag`, a sphere in a thin fluid, at the tip
    disturbance of one frequency on the hub: the cogging of a body `clock` that turns at a constant rate
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import mujoco
import numpy as np

from twin.mechanics import planar
from twin.mechanics.chain import Chain, curvature_row
from twin.mechanics.planar import Plant
from twin.recording import GAUGES, Sensor

TIMESTEP = 5e-4  # s; below the stability limit 2.8 / omega_max of RK4 for up to 8 segments
_HALF_THICKNESS, _HALF_HEIGHT = 0.001, 0.022  # m; I = 2.95e-11 m^4 (Table II) and a density near 1000 kg/m^3
_FLOOR = -0.045  # m, the glass below the link's axis

_SHORTEST_LAG = 1e-5  # s
_FLUID = 1e-9  # kg/m^3; of the fluid that only the sphere of a quadratic drag feels
_CLOCK_RATE = 1e5  # rad/s; so fast that a turn of the hub is nothing beside it
_CLOCK_INERTIA = 1e-6  # kg m^2

_HUB_MASS = 0.6  # kg; on the axis, so that no motion depends on it


def build_spec(
    rig: Mapping[str, float],
    chain: Chain,
    plant: Plant | None = None,
    scene: bool = False,
    gauges: Sequence[Sensor] = GAUGES,
) -> mujoco.MjSpec:
    """Returns the rig as an editable MuJoCo specification.

    Args:
      rig: parameters, SI; torque_limit may be infinite or missing.
      chain: the chain of this rig.
      plant: mechanisms to write as well as stiffness, damping and friction levels; `not_native` lists what
        MJCF cannot say. By default the friction of the rig and nothing else.
      scene: add table, light and camera.
      gauges: strain bridges off the link's end are left out.
    """
    plant = planar.declared_plant(rig, chain) if plant is None else plant
    spec = dynamics_spec(chain, plant, rig)
    _add_friction_difference(spec, plant)
    if plant.tip_drag_quadratic != 0:
        _add_air_drag(spec, plant.tip_drag_quadratic)
    if plant.disturbance_amplitude != 0:
        _add_disturbance(spec, plant)
    _add_motor(spec, rig, driven_joint(plant))
    if plant.lag > 0:
        _add_lag(spec, plant.lag)
    _add_sensors(spec, rig, chain, gauges)
    _add_looks(spec, rig, chain, gauges)
    return _in_scene(spec) if scene else spec


def not_native(plant: Plant) -> tuple[str, ...]:
    """Returns the mechanisms of a plant that its MJCF leaves out; the runner applies them step by step."""
    static = (plant.static_positive, plant.static_negative)
    present = {
        "break-away friction above Coulomb": static != (plant.coulomb_positive, plant.coulomb_negative),
        "stribeck friction": plant.stribeck_velocity != 0,
        "position-dependent friction": plant.friction_amplitude != 0,
        "periodic disturbance of the base": plant.is_shaken,
        "softening stiffness": plant.softening != 0,
    }
    return tuple(name for name, there in present.items() if there)


def dynamics_spec(
    chain: Chain, plant: Plant, rig: Mapping[str, float], locked: bool = False, compact: bool = False
) -> mujoco.MjSpec:
    """Returns the moving parts alone: bodies, joints, losses and native mechanisms, no sensors, no geometry.

    Args:
      chain: lengths, masses, inertias.
      plant: stiffness, damping, hub mechanisms.
      rig: hub_inertia, tip_mass, tip_inertia.
      locked: the hub is part of the world, at zero angle.
      compact: the same motion in fewer operations: bodies without a joint merged into their parents, losses
        as a triangular factor instead of one tendon per mode.
    """
    links = len(chain.lengths)
    inertia = plant.inertia[:links, :links].copy()
    inertia[0, 0] += plant.inertia[links:, links:].sum()
    if not np.allclose(inertia, chain.inertia, rtol=1e-9, atol=0):
        raise ValueError("plant and chain have different inertias; build the plant from this chain")
    spec = mujoco.MjSpec()
    spec.modelname = "flexible link"
    spec.compiler.degree = False
    spec.option.timestep = _timestep(chain, plant)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.noslip_iterations = 3  # without it frictionloss creeps
    # Nothing in the plane depends on the vertical component.
    spec.option.gravity = [plant.gravity_x, plant.gravity_y, -9.81]
    _add_bodies(spec, chain, plant, rig, locked)
    spec.compiler.fusestatic = compact
    _add_losses(spec, _triangle(plant.damping) if compact else _dyads(chain, plant.damping))
    if plant.torsion_stiffness > 0:
        _add_torsion(spec, plant, float(plant.inertia[links, links]))
    if plant.gap > 0:
        _add_rotor(spec, plant)
        if not locked:
            _add_play(spec, plant)
    if plant.cogging_amplitude != 0 and (plant.gap > 0 or not locked):
        wave = (plant.cogging_amplitude, plant.cogging_order, plant.cogging_phase)
        _add_wave(spec, driven_joint(plant), "cogging", *wave)
    if not locked:
        _add_hub_mechanisms(spec, plant)
    if plant.tip_drag_linear != 0:
        add_tip_drag(spec, plant.tip_drag_linear)
    return spec


def _timestep(chain: Chain, plant: Plant) -> float:
    """A round time step [s] with which the chain is stable and a contact in a play is followed."""
    limit = min(chain.largest_step(), planar.largest_step(plant))
    return TIMESTEP if limit >= TIMESTEP else 1e-5 * math.floor(limit / 1e-5 + 1e-6)


# Moving parts


def _add_bodies(
    spec: mujoco.MjSpec, chain: Chain, plant: Plant, rig: Mapping[str, float], locked: bool
) -> None:
    body = spec.worldbody.add_body(name="hub")
    if not locked:
        body.add_joint(name="hub", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    links = len(chain.lengths)
    on_hub = float(np.trace(plant.inertia[links:, links:]))
    _set_inertia(body, _HUB_MASS, 0.0, rig["hub_inertia"] - on_hub)
    for i, (length, mass) in enumerate(zip(chain.lengths, chain.masses, strict=True)):
        start = chain.lengths[i - 1] if i > 1 else chain.lengths[0] if i == 1 else 0.0
        body = body.add_body(name=f"link_{i}", pos=[start, 0, 0])
        if i > 0:
            joint = body.add_joint(name=f"bend_{i}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
            joint.stiffness[0] = plant.stiffness[i - 1]
        _set_inertia(body, mass, length / 2, mass * length**2 / 12)
    tip = body.add_body(name="payload", pos=[chain.lengths[-1], 0, 0])
    tip.add_site(name="tip", size=[0.003, 0.003, 0.003], group=4)
    _set_inertia(tip, rig["tip_mass"], 0.0, rig["tip_inertia"])


def _add_torsion(spec: mujoco.MjSpec, plant: Plant, inertia: float) -> None:
    """A disc on a spring on the hub, on its axis: behind the link, so that its joint is the last one."""
    disc = spec.body("hub").add_body(name="torsion")
    joint = disc.add_joint(name="torsion", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    joint.stiffness[0], joint.damping[0] = plant.torsion_stiffness, plant.torsion_damping
    _set_inertia(disc, 1e-3, 0.0, inertia)


def _add_rotor(spec: mujoco.MjSpec, plant: Plant) -> None:
    """The motor of a backlash, on the hub's axis: behind all others, so that its joint is the last one."""
    rotor = spec.worldbody.add_body(name="rotor")
    rotor.add_joint(name="rotor", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    _set_inertia(rotor, 1e-3, 0.0, plant.motor_inertia)


def _add_play(spec: mujoco.MjSpec, plant: Plant) -> None:
    """Flanks as limits of a tendon: stiffness and damping of a constraint are per unit of the inertia it moves."""
    play = spec.add_tendon(name="play", group=5)
    play.wrap_joint("rotor", 1.0)
    play.wrap_joint("hub", -1.0)
    play.limited = mujoco.mjtLimited.mjLIMITED_TRUE
    play.range = [-plant.gap / 2, plant.gap / 2]
    together = 1 / (1 / plant.motor_inertia + 1 / plant.inertia[0, 0])
    play.solref_limit = [-planar.CONTACT_STIFFNESS / together, -planar.contact_damping(plant) / together]


def driven_joint(plant: Plant) -> str:
    """Name of the joint that the motor turns: the hub's, or its own where there is a play between them."""
    return "rotor" if plant.gap > 0 else "hub"


def _set_inertia(body: mujoco.MjsBody, mass: float, centre: float, about_z: float) -> None:
    """Mass [kg] at `centre` [m] along x with the inertia [kg m^2] about the vertical through it.

    The other two never act in the plane; they are such that a body with them can exist.
    """
    body.explicitinertial = True
    body.mass, body.ipos = mass, [centre, 0, 0]
    body.inertia = [0.6 * about_z, 0.6 * about_z, about_z]


_Dyads = list[tuple[np.ndarray, float]]


def _add_losses(spec: mujoco.MjSpec, dyads: _Dyads) -> None:
    """D = sum_i d_i p_i p_i^T as tendons of length p_i . q with damping d_i."""
    for i, (coefficients, value) in enumerate(dyads, start=1):
        tendon = spec.add_tendon(name=f"loss_{i}", group=5)
        tendon.damping[0] = value
        for hinge in np.flatnonzero(coefficients):
            tendon.wrap_joint(f"bend_{hinge + 1}", coefficients[hinge])


def _triangle(damping: np.ndarray) -> _Dyads:
    """D = L L^T, from the root outwards."""
    if not np.any(damping):
        return []
    lossy = np.flatnonzero(np.diag(damping))
    factor = np.zeros((len(damping), len(lossy)))
    factor[lossy] = np.linalg.cholesky(damping[np.ix_(lossy, lossy)])
    return [(column, 1.0) for column in factor.T]


def _dyads(chain: Chain, damping: np.ndarray) -> _Dyads:
    """One p_i = M phi_i for each free mode, scaled to a largest part of 1."""
    if not np.any(damping):
        return []
    frequencies, shapes = chain.modes("free")
    momenta = (chain.mass_matrix() @ shapes)[1:]
    # The share of each free mode, if it is these that the losses are declared for.
    shares = np.linalg.solve(momenta, np.linalg.solve(momenta, damping).T)
    values = np.diag(shares).copy()
    if not np.allclose(shares, np.diag(values), rtol=0, atol=1e-9 * values.max()):
        values, momenta = np.linalg.eigh(damping)
    scale = np.abs(momenta).max(axis=0)
    return [
        (momenta[:, i] / scale[i], values[i] * scale[i] ** 2)
        for i in range(len(values))
        if values[i] > 1e-12 * values.max()
    ]


def _add_hub_mechanisms(spec: mujoco.MjSpec, plant: Plant) -> None:
    hub = spec.joint("hub")
    hub.frictionloss = (plant.coulomb_positive + plant.coulomb_negative) / 2
    hub.damping[0] = plant.viscous
    hub.stiffness[0] = plant.cable_stiffness
    hub.springref = plant.cable_rest_angle
    static = (plant.static_positive + plant.static_negative) / 2
    spec.add_numeric(name="static_friction", data=[static], size=1)
    spec.add_numeric(name="coulomb_friction", data=[hub.frictionloss], size=1)
    if plant.bias != 0:
        _add_constant(spec, "bias", plant.bias)


def _add_constant(spec: mujoco.MjSpec, name: str, torque: float, joint: str = "hub") -> None:
    """A torque [N m] on a joint that no command changes."""
    constant = _actuator(spec, joint, name)
    constant.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    constant.gainprm[0], constant.biasprm[0] = 0.0, torque


def _add_friction_difference(spec: mujoco.MjSpec, plant: Plant) -> None:
    """Half of what friction is stronger forwards: with it, a symmetric one has both levels, at rest as well."""
    if plant.coulomb_positive != plant.coulomb_negative:
        half = (plant.coulomb_positive - plant.coulomb_negative) / 2
        _add_constant(spec, "friction_difference", -half)


def add_hub_wave(spec: mujoco.MjSpec, name: str, amplitude: float, order: float, phase: float) -> None:
    """Torque amplitude * sin(order * theta + phase) [N m] on the hub."""
    _add_wave(spec, "hub", name, amplitude, order, phase)


def _add_wave(
    spec: mujoco.MjSpec, joint: str, name: str, amplitude: float, order: float, phase: float
) -> None:
    """A torque that repeats with a joint's angle: the cogging of MuJoCo's motor."""
    set_wave(_actuator(spec, joint, name), amplitude, order, phase)


def set_wave(actuator: mujoco.MjsActuator, amplitude: float, order: float, phase: float) -> None:
    """Makes an actuator pull with amplitude * sin(order * length + phase)."""
    # A motor without a winding to speak of: its torque constant may not be 0.
    actuator.set_to_dcmotor(motorconst=[1e-9, 1e-9], resistance=1.0, cogging=[amplitude, order, phase])


def add_tip_drag(spec: mujoco.MjSpec, drag: float) -> None:
    """Force ctrl - drag * velocity [N] on the payload, along two fixed axes in the plane."""
    spec.worldbody.add_site(name="axis", group=4)
    for name, direction in (("drag_x", [1, 0, 0, 0, 0, 0]), ("drag_y", [0, 1, 0, 0, 0, 0])):
        actuator = spec.add_actuator(name=name, target="tip", trntype=mujoco.mjtTrn.mjTRN_SITE)
        actuator.refsite, actuator.gear = "axis", direction
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        actuator.biasprm[2] = -drag


def _add_air_drag(spec: mujoco.MjSpec, drag: float) -> None:
    """Force -drag |v| v [N] on the payload, v its tip's velocity.

    MuJoCo's blunt drag of a sphere is density * coefficient * area * |v| v. Of so thin a fluid no other body feels
    anything.
    """
    spec.option.density = _FLUID
    ball = spec.body("payload").add_geom(name="drag", type=mujoco.mjtGeom.mjGEOM_SPHERE, mass=0, group=4)
    ball.size[0] = _HALF_THICKNESS
    ball.contype = ball.conaffinity = 0
    ball.fluid_ellipsoid = 1
    ball.fluid_coefs = [drag / (_FLUID * math.pi * _HALF_THICKNESS**2), 0, 0, 0, 0]


def _add_disturbance(spec: mujoco.MjSpec, plant: Plant) -> None:
    """Torque amplitude sin(2 pi frequency t + phase) on the hub.

    Half of it is a wave over the angles clock + hub, half over clock - hub: the hub's own angle is left in the sum
    by the square of its tiny share, and their pulls at the clock cancel. Once started, the clock is one time constant
    late.
    """
    late = spec.option.timestep
    clock = spec.worldbody.add_body(name="clock")
    joint = clock.add_joint(name="clock", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    joint.damping[0] = _CLOCK_INERTIA / late
    _set_inertia(clock, 1e-3, 0.0, _CLOCK_INERTIA)
    _add_constant(spec, "clock", joint.damping[0] * _CLOCK_RATE, "clock")
    omega = 2 * math.pi * plant.disturbance_frequency
    for name, sign in (("disturbance_ahead", 1.0), ("disturbance_behind", -1.0)):
        tendon = spec.add_tendon(name=name, group=5)
        tendon.wrap_joint("clock", 1.0)
        tendon.wrap_joint("hub", sign)
        half = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_TENDON)
        amplitude, phase = sign * plant.disturbance_amplitude / 2, plant.disturbance_phase + omega * late
        set_wave(half, amplitude, omega / _CLOCK_RATE, phase)


def _actuator(spec: mujoco.MjSpec, joint: str, name: str) -> mujoco.MjsActuator:
    return spec.add_actuator(name=name, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)


# Motor and sensors


def _add_motor(spec: mujoco.MjSpec, rig: Mapping[str, float], joint: str) -> None:
    motor = _actuator(spec, joint, "motor")
    limit = rig.get("torque_limit", math.inf)
    if math.isfinite(limit):
        motor.ctrllimited = motor.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        motor.ctrlrange = motor.forcerange = [-limit, limit]


def _add_lag(spec: mujoco.MjSpec, lag: float) -> None:
    """The motor's torque follows its command with a time constant [s] that the time step, halved if need be, resolves.

    MuJoCo's "filterexact" is not exact between the stages of RK4; its "filter" is of the fourth order there.
    """
    motor = spec.actuator("motor")
    motor.dyntype, motor.dynprm[0] = mujoco.mjtDyn.mjDYN_FILTER, max(lag, _SHORTEST_LAG)
    while spec.option.timestep > motor.dynprm[0]:
        spec.option.timestep /= 2


def _add_sensors(
    spec: mujoco.MjSpec, rig: Mapping[str, float], chain: Chain, gauges: Sequence[Sensor]
) -> None:
    kind, joint, site = mujoco.mjtSensor, mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_SITE
    spec.add_sensor(name="hub_angle", type=kind.mjSENS_JOINTPOS, objtype=joint, objname="hub")
    spec.add_sensor(name="hub_rate", type=kind.mjSENS_JOINTVEL, objtype=joint, objname="hub")
    for gauge in gauges:
        _add_strain(spec, gauge, curvature_row(chain, rig, gauge.position))
    spec.add_sensor(name="tip", type=kind.mjSENS_FRAMEPOS, objtype=site, objname="tip")
    # Seen from the hub: its second component is the tip deflection w_c(l, t).
    hub = {"reftype": mujoco.mjtObj.mjOBJ_XBODY, "refname": "hub"}
    spec.add_sensor(name="tip_from_hub", type=kind.mjSENS_FRAMEPOS, objtype=site, objname="tip", **hub)
    spec.add_sensor(name="tip_acceleration", type=kind.mjSENS_ACCELEROMETER, objtype=site, objname="tip")
    motor = mujoco.mjtObj.mjOBJ_ACTUATOR
    spec.add_sensor(name="motor_torque", type=kind.mjSENS_ACTUATORFRC, objtype=motor, objname="motor")


def _add_strain(spec: mujoco.MjSpec, gauge: Sensor, row: np.ndarray) -> None:
    """A tendon as long as the strain half_thickness * w''(x); the sensor reads its length."""
    tendon = spec.add_tendon(name=gauge.channel, group=5)
    for hinge, coefficient in enumerate(gauge.half_thickness * row, start=1):
        tendon.wrap_joint(f"bend_{hinge}", coefficient)
    kind, tendons = mujoco.mjtSensor.mjSENS_TENDONPOS, mujoco.mjtObj.mjOBJ_TENDON
    spec.add_sensor(name=gauge.channel, type=kind, objtype=tendons, objname=gauge.channel)


# Looks: box sections as on the rig; nothing collides, and no mass comes from here

_BOX, _CYLINDER = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
_COLOURS = {
    "aluminium": (0.66, 0.68, 0.71, 1.0),
    "steel": (0.30, 0.32, 0.35, 1.0),
    "kevlar": (0.83, 0.66, 0.24, 1.0),
    "gauge": (0.72, 0.22, 0.16, 1.0),
    "hose": (0.16, 0.33, 0.55, 1.0),
}


def _add_looks(spec: mujoco.MjSpec, rig: Mapping[str, float], chain: Chain, gauges: Sequence[Sensor]) -> None:
    for name, rgba in _COLOURS.items():
        shine = {"specular": 0.6, "shininess": 0.7} if name in ("aluminium", "steel") else {"specular": 0.2}
        spec.add_material(name=name, rgba=rgba, **shine)
    _add_motor_and_fork(spec)
    for i, length in enumerate(chain.lengths):
        link = spec.body(f"link_{i}")
        if length == 0:  # the hub's own, where the clamp gives
            continue
        _box(link, "kevlar", (length / 2, 0, 0), (length / 2, _HALF_THICKNESS, _HALF_HEIGHT))
        if i > 0:  # closes the gap that opens where two segments meet at an angle
            _cylinder(link, "kevlar", (0, 0, 0), _HALF_THICKNESS, _HALF_HEIGHT)
    starts = np.concatenate([[0.0], chain.hinges])
    for gauge in gauges:
        if gauge.position > rig["length"]:
            continue
        i = int(np.searchsorted(starts, gauge.position, side="right")) - 1
        x = gauge.position - starts[i]
        _box(spec.body(f"link_{i}"), "gauge", (x, 0, 0), (0.006, _HALF_THICKNESS + 4e-4, 0.007))
    _add_payload(spec.body("payload"), rig)


def _add_motor_and_fork(spec: mujoco.MjSpec) -> None:
    base, hub = spec.worldbody, spec.body("hub")
    _box(base, "steel", (0, 0, _FLOOR + 0.004), (0.034, 0.034, 0.004))
    _cylinder(base, "steel", (0, 0, _FLOOR + 0.012), 0.024, 0.004)
    _cylinder(hub, "aluminium", (0, 0, -0.0265), 0.020, 0.0025)
    # A fork: a bridge behind the axis and two prongs that hold the link between them.
    _box(hub, "aluminium", (-0.008, 0, -0.002), (0.005, 0.0075, 0.022))
    for side in (1, -1):
        y = side * (_HALF_THICKNESS + 0.0032)
        _box(hub, "aluminium", (0.003, y, -0.002), (0.011, 0.003, 0.022))
        _cylinder(hub, "steel", (0.008, 0, -0.002 + side * 0.012), 0.0022, 0.0085, across=True)


def _add_payload(body: mujoco.MjsBody, rig: Mapping[str, float]) -> None:
    """A disc with the payload's mass and inertia, 1/2 m r^2, on its air-pad, below a clamp."""
    mass = rig["tip_mass"]
    if mass <= 0:
        return
    radius = float(np.clip(math.sqrt(2 * rig["tip_inertia"] / mass), 0.014, 0.06))
    half = mass / (2700 * math.pi * radius**2) / 2
    half = float(np.clip(half, 0.003, 0.012))
    gap = 0.0006
    pad = 0.0025
    _cylinder(body, "hose", (0, 0, _FLOOR + gap + pad), 0.9 * radius, pad)
    disc = _FLOOR + gap + 2 * pad + half
    _cylinder(body, "aluminium", (0, 0, disc), radius, half)
    low, high = disc + half, _HALF_HEIGHT
    for side in (1, -1):
        y = side * (_HALF_THICKNESS + 0.0026)
        centre, size = (-0.002, y, (low + high) / 2), (0.008, 0.0025, (high - low) / 2)
        _box(body, "aluminium", centre, size)
        _cylinder(body, "steel", (-0.003, 0, side * 0.010), 0.002, 0.0072, across=True)


def _box(body: mujoco.MjsBody, material: str, pos: Sequence[float], size: Sequence[float]) -> None:
    body.add_geom(type=_BOX, pos=pos, size=size, material=material, contype=0, conaffinity=0)


def _cylinder(
    body: mujoco.MjsBody,
    material: str,
    pos: Sequence[float],
    radius: float,
    half: float,
    across: bool = False,
) -> None:
    """Upright, or across the link like a bolt."""
    geom = body.add_geom(type=_CYLINDER, pos=pos, size=[radius, half, 0], material=material)
    geom.contype = geom.conaffinity = 0
    if across:
        geom.quat = [math.sqrt(0.5), math.sqrt(0.5), 0, 0]


_SCENE = """<mujoco model="bossi2009 scene">
  <include file="{file}"/>

  <statistic center="0.2 0 -0.02" extent="0.45"/>

  <visual>
    <headlight ambient="0.35 0.35 0.35" diffuse="0.35 0.35 0.35" specular="0.1 0.1 0.1"/>
    <global azimuth="-120" elevation="-28" offwidth="1280" offheight="960"/>
    <quality shadowsize="4096" offsamples="8"/>
    <rgba haze="0.85 0.89 0.93 1"/>
  </visual>

  <asset>
    <texture type="skybox" builtin="gradient" rgb1="0.93 0.95 0.97" rgb2="0.55 0.63 0.72"
      width="256" height="256"/>
    <texture name="floor" type="2d" builtin="checker" rgb1="0.62 0.63 0.65" rgb2="0.58 0.59 0.61"
      width="256" height="256"/>
    <material name="floor" texture="floor" texrepeat="10 10" reflectance="0"/>
    <material name="glass" rgba="0.62 0.78 0.80 0.4" specular="0.6" shininess="0.9" reflectance="0.3"/>
    <material name="frame" rgba="0.24 0.25 0.27 1" specular="0.3"/>
  </asset>

  <worldbody>
    <light name="key" pos="0.15 -0.3 1.7" dir="-0.05 0.16 -1" diffuse="0.5 0.5 0.48" castshadow="true"/>
    <light name="fill" pos="-0.8 -0.8 1.2" dir="0.5 0.5 -0.7" diffuse="0.2 0.22 0.25" castshadow="false"/>
    <camera name="front" pos="0.2 -0.62 0.36" xyaxes="1 0 0 0 0.5 0.866" fovy="42"/>
    <camera name="top" pos="0 0 1.35" fovy="45"/>
    <geom name="floor" type="plane" pos="0 0 -0.75" size="3 3 0.1" material="floor"
      contype="0" conaffinity="0"/>
    <geom name="table" type="box" pos="0 0 {table}" size="0.55 0.55 0.005" material="glass"
      contype="0" conaffinity="0"/>
{frame}
  </worldbody>
</mujoco>
"""


def _in_scene(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    name = "rig.xml"
    return mujoco.MjSpec.from_string(scene_xml(name), include={name: spec.to_xml().encode()})


def scene_xml(file: str) -> str:
    # The table's upper face is the glass that the air-pad floats on.
    return _SCENE.format(file=file, table=round(_FLOOR - 0.005, 6), frame="\n".join(_frame()))


def _frame() -> Iterator[str]:
    """Four rails below the edges of the glass, and four legs down to the floor."""
    z, half = _FLOOR - 0.025, 0.55
    bar = '    <geom type="box" pos="{} {} {:g}" size="{:g} {:g} {:g}" material="frame" '
    bar += 'contype="0" conaffinity="0"/>'
    for side in (half - 0.015, 0.015 - half):
        yield bar.format(side, 0, z, 0.015, half, 0.015)
        yield bar.format(0, side, z, half, 0.015, 0.015)
        for other in (half - 0.015, 0.015 - half):
            yield bar.format(side, other, (z - 0.75) / 2, 0.015, 0.015, (z + 0.75) / 2)

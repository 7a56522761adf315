"""The rig as MJCF: segments, hinges, damping, motor, sensors, and visual geometry.

The link bends in the horizontal plane; every joint turns about the vertical axis z. At zero angle the link lies
along x. How the parts of a `Chain` and a `Plant` are written:

    segment     body `link_i`, a rod with explicit inertia; hub and payload are bodies fixed to the first and last one
    hinge       joint `bend_i` with stiffness; the hub's joint is called `hub`
    damping     D = sum_i d_i p_i p_i^T, a term per mode: fixed tendon `loss_i` of length p_i . q with damping d_i
    strain      fixed tendon `strain_base` of length half_thickness * w''(x), a linear function of the hinge angles
    torsion     body `torsion` on a spring on the hub's axis
    backlash    body `rotor` with its own joint, which the motor drives; the fixed tendon `play`, rotor less hub angle,
                is limited to the gap
    friction    frictionloss at the Coulomb level. MuJoCo has a single level: the break-away level is stored in
                `custom/numeric` and applied by `twin.mechanics.mujoco_chain`. Coulomb levels that differ by direction
                are written as their mean and a constant torque, actuator `friction_difference`
    lag         a filter in the motor's actuator
    air drag    geom `drag`, a sphere in a thin fluid, at the tip
    sinusoidal torque of time: the cogging of a body `clock` that turns at a constant rate
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import mujoco
import numpy as np

from twin.mechanics import mjcf_visuals
from twin.mechanics.chain import Chain, curvature_row
from twin.mechanics.hub_law import HubTorque
from twin.mechanics.plant import Plant, declared_plant
from twin.recording import GAUGES, Sensor

TIMESTEP = 5e-4  # s; below the stability limit 2.8 / omega_max of RK4 for up to 8 segments

_SHORTEST_LAG = 1e-5  # s, shortest time constant written; the time step has to resolve it
_FLUID = 1e-9  # kg/m^3, density: so low that only the sphere of the quadratic drag is affected
_CLOCK_RATE = 1e5  # rad/s, so high that the hub's angle is negligible beside the clock's
_CLOCK_INERTIA = 1e-6  # kg m^2; arbitrary: the damping and the drive of the clock are scaled with it

_HUB_MASS = 0.6  # kg, assumed; its centre is on the axis, so that no motion depends on it


def build_spec(
    rig: Mapping[str, float],
    chain: Chain,
    plant: Plant | None = None,
    torques: Sequence[HubTorque] = (),
    scene: bool = False,
    gauges: Sequence[Sensor] = GAUGES,
) -> mujoco.MjSpec:
    """Returns the rig as an editable MuJoCo specification.

    Args:
      rig: parameters, SI; torque_limit may be infinite or missing.
      chain: the chain of this rig.
      plant: mechanisms to write, with stiffness, damping and friction levels; `unsupported_mechanisms` lists those
        that MJCF has no element for. By default the rig's declared friction and nothing else.
      torques: the hub torques of the plant.
      scene: add table, light and camera.
      gauges: strain gauges on the link.
    """
    plant = declared_plant(rig, chain) if plant is None else plant
    spec = dynamics_spec(chain, plant, rig, torques)
    _add_friction_difference(spec, plant)
    if plant.link.drag_quadratic != 0:
        _add_air_drag(spec, plant.link.drag_quadratic)
    for torque in torques:
        if torque.linear is None and torque.write is not None and not torque.exact:
            torque.write(spec, torque_joint(torque, plant))
    _add_motor(spec, rig, motor_joint(plant))
    if plant.motor.lag > 0:
        _add_lag(spec, plant.motor.lag)
    _add_sensors(spec, rig, chain, gauges)
    mjcf_visuals.add_visuals(spec, rig, chain, gauges)
    return mjcf_visuals.with_scene(spec) if scene else spec


def unsupported_mechanisms(plant: Plant, torques: Sequence[HubTorque] = ()) -> tuple[str, ...]:
    """Returns the names of a plant's mechanisms that its MJCF lacks; `mujoco_chain` applies them at every step."""
    hub = plant.friction
    present = {
        "break-away friction above Coulomb": hub[:2] != hub[2:4],
        "Stribeck friction": hub.stribeck_velocity != 0,
        "position-dependent friction": hub.amplitude != 0,
        "periodic disturbance of the base": plant.link.is_shaken,
        "softening stiffness": plant.link.softening != 0,
    }
    present |= {t.name: t.linear is None and t.write is None for t in torques}
    return tuple(name for name, there in present.items() if there)


def dynamics_spec(
    chain: Chain,
    plant: Plant,
    rig: Mapping[str, float],
    torques: Sequence[HubTorque] = (),
    locked: Literal["", "hub", "rotor"] = "",
    compact: bool = False,
) -> mujoco.MjSpec:
    """Returns the dynamics alone: bodies, joints, damping and mechanisms that MuJoCo has; no sensors, no geometry.

    Args:
      chain: lengths, masses, inertias.
      plant: stiffness, damping, mechanisms.
      rig: hub_inertia, tip_mass, tip_inertia.
      torques: the hub torques of the plant.
      locked: what is fixed to the world: the hub, at zero angle, or the motor behind a backlash.
      compact: same dynamics, faster: bodies without a joint are merged into their parents, and damping is written
        as its Cholesky factor instead of one tendon per mode.

    Raises:
      ValueError: plant and chain, or plant and torques, do not belong together.
    """
    links = len(chain.lengths)
    inertia = plant.link.inertia[:links, :links].copy()
    inertia[0, 0] += plant.link.inertia[links:, links:].sum()
    if not np.allclose(inertia, chain.inertia, rtol=1e-9, atol=0):
        raise ValueError("plant and chain have different inertias; build the plant from this chain")
    if len(torques) != len(plant.torques.addresses):
        raise ValueError(
            f"the plant has {len(plant.torques.addresses)} torques on the hub, {len(torques)} were given; "
            "expected the same"
        )
    spec = mujoco.MjSpec()
    spec.modelname = "flexible link"
    spec.compiler.degree = False
    spec.option.timestep = _timestep(chain, plant)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.noslip_iterations = 3  # without it frictionloss creeps
    # Motion in the plane does not depend on the vertical component.
    spec.option.gravity = [plant.link.gravity_x, plant.link.gravity_y, -9.81]
    _add_bodies(spec, chain, plant, rig, locked == "hub")
    spec.compiler.fusestatic = compact
    _add_losses(
        spec, _cholesky_dyads(plant.link.damping) if compact else _modal_dyads(chain, plant.link.damping)
    )
    if plant.link.torsion_stiffness > 0:
        _add_torsion(spec, plant, float(plant.link.inertia[links, links]))
    if plant.motor.gap > 0 and locked != "rotor":
        _add_rotor(spec, plant)
        if not locked:
            _add_play(spec, plant)
    if not locked:
        _add_friction(spec, plant)
    for torque in torques:
        joint = torque_joint(torque, plant)
        if joint != locked:
            _add_torque(spec, joint, torque)
    if plant.link.drag_linear != 0:
        add_tip_drag(spec, plant.link.drag_linear)
    return spec


def _timestep(chain: Chain, plant: Plant) -> float:
    """A round time step [s] with which the chain is stable and contacts in a backlash are resolved."""
    limit = min(chain.largest_step(), plant.largest_step)
    digit = 10.0 ** min(math.floor(math.log10(limit)), -5)
    return TIMESTEP if limit >= TIMESTEP else digit * math.floor(limit / digit + 1e-6)


# Moving parts


def _add_bodies(
    spec: mujoco.MjSpec, chain: Chain, plant: Plant, rig: Mapping[str, float], locked: bool
) -> None:
    body = spec.worldbody.add_body(name="hub")
    if not locked:
        body.add_joint(name="hub", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    links = len(chain.lengths)
    on_hub = float(np.trace(plant.link.inertia[links:, links:]))
    _set_inertia(body, _HUB_MASS, 0.0, rig["hub_inertia"] - on_hub)
    for i, (length, mass) in enumerate(zip(chain.lengths, chain.masses, strict=True)):
        start = chain.lengths[i - 1] if i > 1 else chain.lengths[0] if i == 1 else 0.0
        body = body.add_body(name=f"link_{i}", pos=[start, 0, 0])
        if i > 0:
            joint = body.add_joint(name=f"bend_{i}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
            joint.stiffness[0] = plant.link.stiffness[i - 1]
        _set_inertia(body, mass, length / 2, mass * length**2 / 12)
    tip = body.add_body(name="payload", pos=[chain.lengths[-1], 0, 0])
    tip.add_site(name="tip", size=[0.003, 0.003, 0.003], group=4)
    _set_inertia(tip, rig["tip_mass"], 0.0, rig["tip_inertia"])


def _add_torsion(spec: mujoco.MjSpec, plant: Plant, inertia: float) -> None:
    """Adds a disc on a spring on the hub's axis; after the link, so that its joint comes after the hinges."""
    disc = spec.body("hub").add_body(name="torsion")
    joint = disc.add_joint(name="torsion", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    joint.stiffness[0], joint.damping[0] = plant.link.torsion_stiffness, plant.link.torsion_damping
    _set_inertia(disc, 1e-3, 0.0, inertia)


def _add_rotor(spec: mujoco.MjSpec, plant: Plant) -> None:
    """Adds the motor of a backlash on the hub's axis; after all other bodies, so that its joint is the last one."""
    rotor = spec.worldbody.add_body(name="rotor")
    rotor.add_joint(name="rotor", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    _set_inertia(rotor, 1e-3, 0.0, plant.motor.inertia)


def _add_play(spec: mujoco.MjSpec, plant: Plant) -> None:
    """Adds the flanks of a backlash as limits of a tendon.

    Stiffness and damping of a MuJoCo constraint are per effective inertia, here that of motor and hub in series.
    """
    play = spec.add_tendon(name="play", group=5)
    play.wrap_joint("rotor", 1.0)
    play.wrap_joint("hub", -1.0)
    play.limited = mujoco.mjtLimited.mjLIMITED_TRUE
    play.range = [-plant.motor.gap / 2, plant.motor.gap / 2]
    together = 1 / (1 / plant.motor.inertia + 1 / plant.link.inertia[0, 0])
    play.solref_limit = [-plant.motor.contact_stiffness / together, -plant.motor.contact_damping / together]


def torque_joint(torque: HubTorque, plant: Plant) -> str:
    """Returns the joint on which a torque acts: the hub's, or the motor's if there is backlash and it acts there."""
    return motor_joint(plant) if torque.on_motor else "hub"


def motor_joint(plant: Plant) -> str:
    """Returns the joint that the motor drives: the hub's, or its own if there is backlash."""
    return "rotor" if plant.motor.gap > 0 else "hub"


def _set_inertia(body: mujoco.MjsBody, mass: float, centre: float, about_z: float) -> None:
    """Sets mass [kg], its centre along x [m], and the moment of inertia about the vertical through it [kg m^2].

    The other two moments do not affect motion in the plane; they satisfy the triangle inequality.
    """
    body.explicitinertial = True
    body.mass, body.ipos = mass, [centre, 0, 0]
    body.inertia = [0.6 * about_z, 0.6 * about_z, about_z]


_Dyads = list[tuple[np.ndarray, float]]


def _add_losses(spec: mujoco.MjSpec, dyads: _Dyads) -> None:
    """Adds D = sum_i d_i p_i p_i^T as tendons of length p_i . q with damping d_i; dyads are (p_i, d_i)."""
    for i, (coefficients, value) in enumerate(dyads, start=1):
        tendon = spec.add_tendon(name=f"loss_{i}", group=5)
        tendon.damping[0] = value
        for hinge in np.flatnonzero(coefficients):
            tendon.wrap_joint(f"bend_{hinge + 1}", coefficients[hinge])


def _cholesky_dyads(damping: np.ndarray) -> _Dyads:
    """Dyads of the Cholesky factor, D = L L^T; hinges without damping are omitted."""
    if not np.any(damping):
        return []
    lossy = np.flatnonzero(np.diag(damping))
    factor = np.zeros((len(damping), len(lossy)))
    factor[lossy] = np.linalg.cholesky(damping[np.ix_(lossy, lossy)])
    return [(column, 1.0) for column in factor.T]


def _modal_dyads(chain: Chain, damping: np.ndarray) -> _Dyads:
    """Dyads (p_i, d_i) with p_i = M phi_i of the free modes, largest element 1; eigenvectors if D is not modal."""
    if not np.any(damping):
        return []
    frequencies, shapes = chain.modes("free")
    momenta = (chain.mass_matrix() @ shapes)[1:]
    # D in the basis of the free modes' momenta: diagonal if damping is modal in the free modes.
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


def friction_joint(plant: Plant) -> str:
    """Returns the joint on which dry friction acts: the hub's, or that of a motor behind a backlash."""
    return "rotor" if plant.rubs_on_motor else "hub"


def _add_friction(spec: mujoco.MjSpec, plant: Plant) -> None:
    joint = spec.joint(friction_joint(plant))
    joint.frictionloss = (plant.friction.coulomb_positive + plant.friction.coulomb_negative) / 2
    static = (plant.friction.static_positive + plant.friction.static_negative) / 2
    spec.add_numeric(name="static_friction", data=[static], size=1)
    spec.add_numeric(name="coulomb_friction", data=[joint.frictionloss], size=1)


def _add_torque(spec: mujoco.MjSpec, name: str, torque: HubTorque) -> None:
    """Adds a linear torque as stiffness and damping of its joint, another one as its exact MuJoCo element, if any."""
    if torque.linear is None:
        if torque.write is not None and torque.exact:
            torque.write(spec, name)
        return
    constant, stiffness, damping = torque.linear
    joint = spec.joint(name)
    # Springs k_i (theta - r_i) add up to one of stiffness sum k_i about the mean of r_i weighted by k_i.
    pull = joint.stiffness[0] * joint.springref
    joint.damping[0] += damping
    joint.stiffness[0] += stiffness
    if joint.stiffness[0] > 0:
        joint.springref = (pull + constant) / joint.stiffness[0]
    elif constant != 0:
        _add_constant(spec, torque.name, constant, name)


def _add_constant(spec: mujoco.MjSpec, name: str, torque: float, joint: str = "hub") -> None:
    """Adds a constant torque [N m] on a joint."""
    constant = _actuator(spec, joint, name)
    constant.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    constant.gainprm[0], constant.biasprm[0] = 0.0, torque


def _add_friction_difference(spec: mujoco.MjSpec, plant: Plant) -> None:
    """Adds half of the difference of the Coulomb levels as a constant torque: frictionloss has their mean."""
    if plant.friction.coulomb_positive != plant.friction.coulomb_negative:
        half = (plant.friction.coulomb_positive - plant.friction.coulomb_negative) / 2
        _add_constant(spec, "friction_difference", -half, friction_joint(plant))


def add_sinusoid(
    spec: mujoco.MjSpec, joint: str, name: str, amplitude: float, order: float, phase: float
) -> None:
    """Adds the torque amplitude * sin(order * theta + phase) [N m] on a joint: the cogging of MuJoCo's motor."""
    set_sinusoid(_actuator(spec, joint, name), amplitude, order, phase)


def set_sinusoid(actuator: mujoco.MjsActuator, amplitude: float, order: float, phase: float) -> None:
    """Makes an actuator exert amplitude * sin(order * length + phase), the cogging of MuJoCo's motor."""
    # MuJoCo rejects a torque constant of 0.
    actuator.set_to_dcmotor(motorconst=[1e-9, 1e-9], resistance=1.0, cogging=[amplitude, order, phase])


def add_tip_drag(spec: mujoco.MjSpec, drag: float) -> None:
    """Adds the force ctrl - drag * velocity [N] on the payload, along two fixed axes in the plane."""
    spec.worldbody.add_site(name="axis", group=4)
    for name, direction in (("drag_x", [1, 0, 0, 0, 0, 0]), ("drag_y", [0, 1, 0, 0, 0, 0])):
        actuator = spec.add_actuator(name=name, target="tip", trntype=mujoco.mjtTrn.mjTRN_SITE)
        actuator.refsite, actuator.gear = "axis", direction
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        actuator.biasprm[2] = -drag


def _add_air_drag(spec: mujoco.MjSpec, drag: float) -> None:
    """Adds the force -drag |v| v [N] on the payload, v being the velocity of the tip.

    MuJoCo's blunt drag of a sphere is density * coefficient * area * |v| v. The density is so low, and the coefficient
    so high, that no other body is affected.
    """
    spec.option.density = _FLUID
    ball = spec.body("payload").add_geom(name="drag", type=mujoco.mjtGeom.mjGEOM_SPHERE, mass=0, group=4)
    ball.size[0] = mjcf_visuals.HALF_THICKNESS
    ball.contype = ball.conaffinity = 0
    ball.fluid_ellipsoid = 1
    ball.fluid_coefs = [drag / (_FLUID * math.pi * mjcf_visuals.HALF_THICKNESS**2), 0, 0, 0, 0]


def add_time_sinusoid(spec: mujoco.MjSpec, frequency: float, amplitude: float, phase: float) -> None:
    """Adds the torque amplitude sin(2 pi frequency t + phase) on the hub.

    A body `clock` turns at a constant rate. Half of the torque is a sinusoid of the angle clock + hub, the other half
    of clock - hub: the hub's angle enters their sum by the square of its small share only, and their reactions on the
    clock cancel. After its start, the clock lags by one time constant, which the phase corrects.
    """
    late = spec.option.timestep
    clock = spec.worldbody.add_body(name="clock")
    joint = clock.add_joint(name="clock", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    joint.damping[0] = _CLOCK_INERTIA / late
    _set_inertia(clock, 1e-3, 0.0, _CLOCK_INERTIA)
    _add_constant(spec, "clock", joint.damping[0] * _CLOCK_RATE, "clock")
    omega = 2 * math.pi * frequency
    for name, sign in (("disturbance_ahead", 1.0), ("disturbance_behind", -1.0)):
        tendon = spec.add_tendon(name=name, group=5)
        tendon.wrap_joint("clock", 1.0)
        tendon.wrap_joint("hub", sign)
        half = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_TENDON)
        set_sinusoid(half, sign * amplitude / 2, omega / _CLOCK_RATE, phase + omega * late)


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
    """Adds a first-order lag [s] of the motor's torque; halves the time step until it resolves the lag.

    MuJoCo's "filterexact" is not exact between the stages of RK4; its "filter" is integrated to fourth order.
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
    # In the hub's frame: the second component is the tip deflection w_c(l, t).
    hub = {"reftype": mujoco.mjtObj.mjOBJ_XBODY, "refname": "hub"}
    spec.add_sensor(name="tip_from_hub", type=kind.mjSENS_FRAMEPOS, objtype=site, objname="tip", **hub)
    spec.add_sensor(name="tip_acceleration", type=kind.mjSENS_ACCELEROMETER, objtype=site, objname="tip")
    motor = mujoco.mjtObj.mjOBJ_ACTUATOR
    spec.add_sensor(name="motor_torque", type=kind.mjSENS_ACTUATORFRC, objtype=motor, objname="motor")


def _add_strain(spec: mujoco.MjSpec, gauge: Sensor, row: np.ndarray) -> None:
    """Adds a tendon whose length is the strain half_thickness * w''(x), and the sensor of its length."""
    tendon = spec.add_tendon(name=gauge.channel, group=5)
    for hinge, coefficient in enumerate(gauge.half_thickness * row, start=1):
        tendon.wrap_joint(f"bend_{hinge}", coefficient)
    kind, tendons = mujoco.mjtSensor.mjSENS_TENDONPOS, mujoco.mjtObj.mjOBJ_TENDON
    spec.add_sensor(name=gauge.channel, type=kind, objtype=tendons, objname=gauge.channel)

"""The rig as a model of Exudyn: an ANCF cable clamped to a hub, a payload at its tip.

    J. Gerstmayr, H. Irschik, "On the correct representation of bending and axial deformation in the absolute nodal
    coordinate formulation with an elastic line approach", J. Sound and Vibration 318 (2008): the cable element.

Nodes have positions and slopes in fixed axes, so that no rotating frame, no mode and no small angle enters. The gauges
lie on points of Gauss of two elements, where the curvature of a cubic element is one order more exact (J. Barlow, Int.
J. Numer. Meth. Eng. 10 (1976)). The cable's axial stiffness is that of the strip of the gauges' thickness.

Damping: the declared ratio of every free mode belongs to no material law. Moments in the link, proportional to the
rates of curvature at all points of Gauss, give it to as many modes as there are elements and to no other. (Dampers
between the nodes would give the same ratios; but their moments are constant within an element and bend the modes above,
so that a gauge at the second free mode lags by one per cent.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from scipy.linalg import eigh
from scipy.optimize import newton

from twin.errors import InputError
from twin.virtual_rig.beam import Array
from twin.virtual_rig.plant import CONTACT_STIFFNESS, contact
from twin.virtual_rig.rig import Rig
from twin.virtual_rig.sensors import Sensors

try:
    import exudyn
    from exudyn import itemInterface as items
except ImportError as error:
    raise InputError(
        "The second engine of the benchmarks is the package exudyn, which is not installed;"
        " expected: pip install -e '.[benchmarks]'"
    ) from error

GAUSS = 0.5 - 0.5 / math.sqrt(3.0)
"""Place of the first of two points of Gauss on an element of length 1."""
ELEMENT = 0.125
"""Length of an element over that of the link: with eight, the fifth mode is exact to 0.03 %."""
MIXED = 2
"""Exudyn's mixed integration of Lobatto and Gauss: with others, bending stretches the axis of an element, which makes
the link stiffer the more it is bent (membrane locking), by a noise level of the middle gauge."""
HUB_MASS = 1.0  # kg, at rest on the axis: of no effect


@dataclass(frozen=True)
class Mesh:
    """Places of the nodes, and the elements of the gauges.

    Attributes:
      nodes: from root to tip (elements + 1,) [m].
      gauges: element of each gauge and place along it [m].
    """

    nodes: Array
    gauges: tuple[tuple[int, float], ...]


def mesh_of(length: float, base: float, middle: float) -> Mesh:
    """Returns a mesh on whose points of Gauss the two gauges [m] lie.

    The gauge at the base is the second point of the first element, that in the middle the first of its own.
    """
    usual = ELEMENT * length
    first = base / (1.0 - GAUSS)
    left = middle - GAUSS * usual
    before = max(round((left - first) / usual), 1)
    after = max(round((length - left - usual) / usual), 1)
    nodes = np.concatenate(
        [[0.0], np.linspace(first, left, before + 1), np.linspace(left + usual, length, after + 1)]
    )
    return Mesh(nodes, ((0, base), (before + 1, middle - left)))


@dataclass
class Model:
    """The assembled system, and where things are in it.

    Attributes:
      system: Exudyn's MainSystem.
      mesh: places of the nodes.
      cables: objects of the elements.
      hub: coordinate of the hub angle.
      tip: coordinate of the tip's x, before those of y and of the angle.
      lock: constraint that holds the hub.
      lock_row: its Lagrange multiplier.
      motor: coordinate of a motor behind a backlash, None without one.
      motor_lock: constraint that holds this motor, which nothing else does within the play, for the static shape.
      torsion: coordinate of the torsional oscillator, None without one.
      torque: load on the hub, on the motor if there is one.
      friction: load on the hub beside that on a motor; the same load without one.
      weights: loads proportional to mass.
      drag: loads at the tip along x and y.
    """

    system: Any
    mesh: Mesh
    cables: list[Any]
    hub: int
    tip: int
    lock: Any
    lock_row: int
    motor: int | None
    motor_lock: Any
    torsion: int | None
    torque: Any
    friction: Any
    weights: list[Any]
    drag: list[Any]


class Builder:
    """Adds items to an empty system; angles and places are those of the hub at `angle` [rad]."""

    def __init__(self, rig: Rig, sensors: Sensors, angle: float):
        self.rig, self.angle = rig, angle
        self.along = np.array([math.cos(angle), math.sin(angle)])
        self.mesh = mesh_of(rig.length, sensors.position_base, sensors.position_mid)
        self.axial_stiffness = 3.0 * rig.bending_stiffness / sensors.half_thickness**2
        self.system = exudyn.SystemContainer().AddSystem()
        ground = self.system.AddNode(items.NodePointGround())
        self.ground = self.coordinate(ground, 0)

    def coordinate(self, node: Any, number: int) -> Any:
        """Returns a marker of a coordinate of a node."""
        return self.system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=number))

    def body(self, place: float, mass: float, inertia: float) -> tuple[Any, Any]:
        """Adds a rigid body at a place on the link [m]; returns node and body."""
        reference = [*(place * self.along), self.angle]
        node = self.system.AddNode(items.NodeRigidBody2D(referenceCoordinates=reference))
        body = items.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=node)
        return node, self.system.AddObject(body)

    def cable(self) -> tuple[list[Any], list[Any]]:
        """Adds the elements of the link; returns nodes and elements."""
        add = self.system
        nodes = [
            add.AddNode(items.NodePoint2DSlope1(referenceCoordinates=[*(s * self.along), *self.along]))
            for s in self.mesh.nodes
        ]
        elements = [
            add.AddObject(
                items.ObjectANCFCable2D(
                    length=float(right - left),
                    massPerLength=self.rig.linear_density,
                    bendingStiffness=self.rig.bending_stiffness,
                    axialStiffness=self.axial_stiffness,
                    nodeNumbers=[first, second],
                    useReducedOrderIntegration=MIXED,
                )
            )
            for left, right, first, second in zip(
                self.mesh.nodes[:-1], self.mesh.nodes[1:], nodes[:-1], nodes[1:], strict=True
            )
        ]
        return nodes, elements

    def rotor(self, inertia: float) -> tuple[Any, Any]:
        """Adds a body that turns about the hub's axis; returns node and marker of its angle from the start."""
        node = self.system.AddNode(items.Node1D(referenceCoordinates=[0.0]))
        self.system.AddObject(items.ObjectMass1D(mass=inertia, nodeNumber=node))
        return node, self.coordinate(node, 0)

    def joint(self, first: Any, second: Any, rigid: bool = True) -> None:
        """Joins two markers, free to turn unless rigid."""
        axes = [1, 1, 0, 0, 0, int(rigid)]
        self.system.AddObject(items.ObjectJointGeneric(markerNumbers=[first, second], constrainedAxes=axes))

    def weight(self, body: Any) -> Any:
        """Adds a load proportional to the mass of a body [m/s^2], now zero."""
        marker = self.system.AddMarker(items.MarkerBodyMass(bodyNumber=body))
        return self.system.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=[0, 0, 0]))

    def load(self, marker: Any) -> Any:
        """Adds a load on a coordinate, now zero."""
        return self.system.AddLoad(items.LoadCoordinate(markerNumber=marker, load=0.0))


def build(rig: Rig, sensors: Sensors, angle: float) -> Model:
    """Returns the model of a rig, straight and at rest at a hub angle [rad]."""
    b = Builder(rig, sensors, angle)
    share_out = rig.torsional_inertia_share
    has_play = rig.backlash_gap > 0.0 and rig.backlash_motor_share > 0.0
    if has_play:
        share_out += rig.backlash_motor_share
    nodes, cables = b.cable()
    hub, _ = b.body(0.0, HUB_MASS, (1.0 - share_out) * rig.hub_inertia)
    tip, payload = b.body(rig.length, rig.tip_mass, rig.tip_inertia)
    root_rigid, end_rigid, hub_rigid, tip_rigid = (
        b.system.AddMarker(items.MarkerNodeRigid(nodeNumber=n)) for n in (nodes[0], nodes[-1], hub, tip)
    )
    turn = b.coordinate(hub, 2)
    for number in (0, 1):
        b.system.AddObject(
            items.ObjectConnectorCoordinate(markerNumbers=[b.ground, b.coordinate(hub, number)])
        )
    lock = b.system.AddObject(items.ObjectConnectorCoordinate(markerNumbers=[b.ground, turn]))
    _clamp(b, rig, hub_rigid, root_rigid)
    b.joint(end_rigid, tip_rigid)
    torsion = _torsion(b, rig, turn) if rig.torsional_inertia_share > 0.0 else None
    motor, driven, motor_lock = _motor(b, rig, turn) if has_play else (None, turn, None)
    hub_load = b.load(turn)
    model = Model(
        system=b.system,
        mesh=b.mesh,
        cables=cables,
        hub=0,
        tip=0,
        lock=lock,
        lock_row=0,
        motor=motor,
        motor_lock=motor_lock,
        torsion=torsion,
        torque=hub_load if motor is None else b.load(driven),
        friction=hub_load,
        weights=[b.weight(body) for body in (*cables, payload)],
        drag=[b.load(b.coordinate(tip, number)) for number in (0, 1)],
    )
    b.system.Assemble()
    rotors = [n for n in (motor, torsion) if n is not None]
    _damp(b, rig, nodes, transverse(b.system, angle, nodes, hub, tip, rotors))
    b.system.Assemble()
    place = b.system.GetNodeODE2Index
    model.hub, model.tip = place(hub) + 2, place(tip)
    model.lock_row = b.system.systemData.GetObjectLTGAE(lock)[0]
    model.motor = None if motor is None else place(motor)
    model.torsion = None if torsion is None else place(torsion)
    return model


def _clamp(b: Builder, rig: Rig, hub: Any, root: Any) -> None:
    """Clamps the root to the hub, by a torsion spring if the clamp gives."""
    gives = math.isfinite(rig.root_stiffness)
    b.joint(hub, root, rigid=not gives)
    if gives:
        b.system.AddObject(
            items.ObjectConnectorTorsionalSpringDamper(
                markerNumbers=[hub, root], stiffness=rig.root_stiffness, damping=0.0
            )
        )


def _torsion(b: Builder, rig: Rig, turn: Any) -> Any:
    """Adds the torsional oscillator; returns its node."""
    inertia = rig.torsional_inertia_share * rig.hub_inertia
    omega = 2.0 * math.pi * rig.torsional_frequency
    node, marker = b.rotor(inertia)
    b.system.AddObject(
        items.ObjectConnectorCoordinateSpringDamper(
            markerNumbers=[turn, marker],
            stiffness=inertia * omega**2,
            damping=2.0 * rig.torsional_damping * omega * inertia,
        )
    )
    return node


def _motor(b: Builder, rig: Rig, turn: Any) -> tuple[Any, Any, Any]:
    """Adds a motor behind a backlash; returns its node, the marker of its angle, and the constraint that holds it."""
    inertia = rig.backlash_motor_share * rig.hub_inertia

    def push(_system, _t, _item, play, rate, _stiffness, _damping, _offset) -> float:
        return contact.py_func(play, rate, rig.backlash_gap, CONTACT_STIFFNESS, inertia)

    node, marker = b.rotor(inertia)
    b.system.AddObject(
        items.ObjectConnectorCoordinateSpringDamper(
            markerNumbers=[turn, marker], springForceUserFunction=push
        )
    )
    lock = b.system.AddObject(items.ObjectConnectorCoordinate(markerNumbers=[b.ground, marker]))
    return node, marker, lock


def transverse(system: Any, angle: float, nodes: list[Any], hub: Any, tip: Any, rotors: list[Any]) -> Array:
    """Returns the coordinates of the system per transverse ones of a straight inextensible link on a rigid clamp.

    The transverse coordinates are the slopes of the nodes, then the deflections of all but the first
    (coordinates x (2 nodes - 1)); the hub, and all that turns with it, has the slope of the first node, the payload
    slope and deflection of the last.
    """
    count, place = len(nodes), system.GetNodeODE2Index
    across = np.array([-math.sin(angle), math.cos(angle)])
    matrix = np.zeros((len(system.systemData.GetODE2Coordinates()), 2 * count - 1))
    for k, node in enumerate(nodes):
        at = place(node)
        matrix[at + 2 : at + 4, k] = across
        if k:
            matrix[at : at + 2, count + k - 1] = across
    matrix[place(hub) + 2, 0] = 1.0
    for rotor in rotors:
        matrix[place(rotor), 0] = 1.0
    matrix[place(tip) : place(tip) + 2, -1] = across
    matrix[place(tip) + 2, count - 1] = 1.0
    return matrix


def free_modes(system: Any, coordinates: Array) -> tuple[Array, Array]:
    """Returns angular frequencies [rad/s] and mass-normalised shapes (columns) with the hub free to turn.

    They are in the columns of `transverse`, rising; the first is the rigid rotation.
    """
    mass, stiffness, _ = system.ComputeLinearizedSystem()
    squares, shapes = eigh(coordinates.T @ stiffness @ coordinates, coordinates.T @ mass @ coordinates)
    return np.sqrt(np.maximum(squares, 0.0)), shapes


def _damp(b: Builder, rig: Rig, nodes: list[Any], coordinates: Array) -> None:
    """Adds the moments that give as many free modes as there are elements the declared ratio.

    They are -C kappa' with the rates kappa' of curvature, kappa = X eta, of modes eta: their losses kappa' C kappa'
    are those of the damped modes, sum 2 zeta omega eta'^2.

    Args:
      coordinates: those of the system per transverse ones, as from `transverse`.
    """
    omega, shapes = free_modes(b.system, coordinates)
    count = len(nodes)
    straight = np.concatenate([[*(s * b.along), *b.along] for s in b.mesh.nodes])
    lengths = np.diff(b.mesh.nodes)
    rows = np.concatenate([b.system.GetNodeODE2Index(node) + np.arange(4) for node in nodes])
    modes = np.linalg.inv(curvature_rates(straight, lengths) @ (coordinates @ shapes[:, 1:])[rows])
    matrix = modes[: count - 1].T * (2.0 * rig.damping_ratio * omega[1:count]) @ modes[: count - 1]

    def force(_system: Any, _t: float, _item: int, q: Any, rates: Any) -> Array:
        by_rate = curvature_rates(straight + np.asarray(q), lengths)
        return -(matrix @ (by_rate @ np.asarray(rates))) @ by_rate

    def jacobian(_system: Any, _t: float, _item: int, q: Any, _rates: Any, _: float, share: float) -> Array:
        by_rate = curvature_rates(straight + np.asarray(q), lengths)
        return share * by_rate.T @ matrix @ by_rate

    b.system.AddObject(
        items.ObjectGenericODE2(
            nodeNumbers=nodes,
            massMatrix=np.zeros((4 * count, 4 * count)),
            forceUserFunction=force,
            jacobianUserFunction=jacobian,
        )
    )


@numba.njit
def curvature_rates(place: Array, lengths: Array) -> Array:
    """Returns the rates of curvature per rate of the nodes' coordinates, kappa = r' x r''/|r'|^2 of cubic elements.

    Args:
      place: x, y and their derivatives along the link, of each node (4 nodes,).
      lengths: of the elements (nodes - 1,) [m].

    Returns:
      at both points of Gauss of each element (2 (nodes - 1), 4 nodes).
    """
    count = len(lengths)
    rates = np.zeros((2 * count, 4 * count + 4))
    for k in range(count):
        h, first = lengths[k], 4 * k
        for point, u in enumerate((GAUSS, 1.0 - GAUSS)):
            once = (6 * u * (u - 1) / h, 1 - 4 * u + 3 * u * u, 6 * u * (1 - u) / h, 3 * u * u - 2 * u)
            twice = ((12 * u - 6) / h**2, (6 * u - 4) / h, (6 - 12 * u) / h**2, (6 * u - 2) / h)
            dx, dy, ddx, ddy = 0.0, 0.0, 0.0, 0.0
            for i in range(4):
                x, y = place[first + 2 * i], place[first + 2 * i + 1]
                dx, dy = dx + once[i] * x, dy + once[i] * y
                ddx, ddy = ddx + twice[i] * x, ddy + twice[i] * y
            square = dx * dx + dy * dy
            twist = 2.0 * (dx * ddy - dy * ddx) / square
            row = rates[2 * k + point]
            for i in range(4):
                row[first + 2 * i] = (once[i] * (ddy - twist * dx) - twice[i] * dy) / square
                row[first + 2 * i + 1] = (twice[i] * dx - once[i] * (ddx + twist * dy)) / square
    return rates


def gauge_curvatures(model: Model) -> list[float]:
    """Returns the curvature of the link at base and middle [1/m]."""
    output = model.system.GetObjectOutputBody
    variable = exudyn.OutputVariableType.CurvatureLocal
    return [float(output(model.cables[k], variable, [place, 0.0, 0.0])) for k, place in model.mesh.gauges]


def hold_tip(model: Model, rig: Rig, deflection: float) -> None:
    """Sets the initial state to that of a link at hub angle 0 whose tip a force across it holds aside [m]."""
    system, across = model.system, model.drag[1]

    def short_of(force: float) -> float:
        system.SetLoadParameter(across, "load", force)
        solve_static(system)
        return deflection - float(system.systemData.GetODE2Coordinates()[model.tip + 1])

    linear = 3.0 * rig.bending_stiffness * deflection / rig.length**3
    newton(short_of, linear, x1=1.001 * linear, tol=1e-9 * abs(linear))
    system.SetLoadParameter(across, "load", 0.0)


def solve_static(system: Any) -> None:
    """Sets the initial state to the static one under the present loads and constraints."""
    settings = exudyn.SimulationSettings()
    settings.staticSolver.numberOfLoadSteps = 10
    settings.staticSolver.newton.useModifiedNewton = False
    settings.staticSolver.newton.relativeTolerance = 1e-7
    settings.staticSolver.newton.absoluteTolerance = 1e-7  # N; rounding leaves 1e-8
    settings.staticSolver.verboseMode = 0
    settings.solution.file.write = False
    system.SolveStatic(settings, updateInitialValues=True)


def integration_settings() -> Any:
    """Returns the settings of the implicit trapezoidal rule with constraints on velocities."""
    settings = exudyn.SimulationSettings()
    settings.solution.file.write = False
    integration = settings.timeIntegration
    # Steps are given one by one.
    integration.endTime, integration.numberOfSteps, integration.adaptiveStep = 1e6, 1, True
    integration.verboseMode = 0
    # A modified Newton method would begin with the Jacobian of the last restart, and repeat its failures from a start
    # that only Exudyn's own loop over steps keeps.
    integration.newton.useModifiedNewton = False
    # N and N m; rounding of the axial forces leaves 1e-8, and the last iteration much less than this.
    integration.newton.relativeTolerance = integration.newton.absoluteTolerance = 1e-6
    alpha = integration.generalizedAlpha
    alpha.useNewmark = alpha.useIndex2Constraints = True
    alpha.computeInitialAccelerations = alpha.storeInitialAlgebraicCoordinates = True
    return settings

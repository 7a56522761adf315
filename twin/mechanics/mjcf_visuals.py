"""Visual geometry of the rig in MJCF; geoms do not collide and have no influence on mass or inertia."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import mujoco
import numpy as np

from twin.mechanics.chain import Chain
from twin.recording import Sensor

HALF_THICKNESS, _HALF_HEIGHT = 0.001, 0.022  # m, from I = 2.95e-11 m^4 (Table II), density near 1000 kg/m^3
_FLOOR = -0.045  # m, height of the glass table relative to the link's axis; assumed

_BOX, _CYLINDER = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
_COLOURS = {
    "aluminium": (0.66, 0.68, 0.71, 1.0),
    "steel": (0.30, 0.32, 0.35, 1.0),
    "kevlar": (0.83, 0.66, 0.24, 1.0),
    "gauge": (0.72, 0.22, 0.16, 1.0),
    "hose": (0.16, 0.33, 0.55, 1.0),
}


def add_visuals(
    spec: mujoco.MjSpec, rig: Mapping[str, float], chain: Chain, gauges: Sequence[Sensor]
) -> None:
    """Adds geoms of motor, fork, segments, gauges and payload to the bodies of `mjcf.dynamics_spec`."""
    for name, rgba in _COLOURS.items():
        shine = {"specular": 0.6, "shininess": 0.7} if name in ("aluminium", "steel") else {"specular": 0.2}
        spec.add_material(name=name, rgba=rgba, **shine)
    _add_motor_and_fork(spec)
    for i, length in enumerate(chain.lengths):
        link = spec.body(f"link_{i}")
        if length == 0:  # the hub's segment where the clamp is compliant
            continue
        _box(link, "kevlar", (length / 2, 0, 0), (length / 2, HALF_THICKNESS, _HALF_HEIGHT))
        if i > 0:  # a cylinder on the hinge, so that no gap opens between segments at an angle
            _cylinder(link, "kevlar", (0, 0, 0), HALF_THICKNESS, _HALF_HEIGHT)
    starts = np.concatenate([[0.0], chain.hinges])
    for gauge in gauges:
        if gauge.position > rig["length"]:
            continue
        i = int(np.searchsorted(starts, gauge.position, side="right")) - 1
        x = gauge.position - starts[i]
        _box(spec.body(f"link_{i}"), "gauge", (x, 0, 0), (0.006, HALF_THICKNESS + 4e-4, 0.007))
    _add_payload(spec.body("payload"), rig)


def _add_motor_and_fork(spec: mujoco.MjSpec) -> None:
    base, hub = spec.worldbody, spec.body("hub")
    _box(base, "steel", (0, 0, _FLOOR + 0.004), (0.034, 0.034, 0.004))
    _cylinder(base, "steel", (0, 0, _FLOOR + 0.012), 0.024, 0.004)
    _cylinder(hub, "aluminium", (0, 0, -0.0265), 0.020, 0.0025)
    # The fork: a bridge behind the axis and two prongs that hold the link between them.
    _box(hub, "aluminium", (-0.008, 0, -0.002), (0.005, 0.0075, 0.022))
    for side in (1, -1):
        y = side * (HALF_THICKNESS + 0.0032)
        _box(hub, "aluminium", (0.003, y, -0.002), (0.011, 0.003, 0.022))
        _cylinder(hub, "steel", (0.008, 0, -0.002 + side * 0.012), 0.0022, 0.0085, across=True)


def _add_payload(body: mujoco.MjsBody, rig: Mapping[str, float]) -> None:
    """Adds a disc of the payload's mass and inertia, 1/2 m r^2 (aluminium), on an air-pad, below a clamp."""
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
        y = side * (HALF_THICKNESS + 0.0026)
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
    """Adds a cylinder, its axis vertical, or across the link like a bolt."""
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


def with_scene(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Returns the specification with table, light and camera added."""
    name = "rig.xml"
    return mujoco.MjSpec.from_string(scene_xml(name), include={name: spec.to_xml().encode()})


def scene_xml(file: str) -> str:
    """Returns a scene, table, light and camera, that includes the rig's MJCF `file`."""
    # The upper face of the table is the glass on which the air-pad floats.
    return _SCENE.format(file=file, table=round(_FLOOR - 0.005, 6), frame="\n".join(_frame()))


def _frame() -> Iterator[str]:
    """Yields geoms of four rails below the edges of the glass and four legs down to the floor."""
    z, half = _FLOOR - 0.025, 0.55
    bar = '    <geom type="box" pos="{} {} {:g}" size="{:g} {:g} {:g}" material="frame" '
    bar += 'contype="0" conaffinity="0"/>'
    for side in (half - 0.015, 0.015 - half):
        yield bar.format(side, 0, z, 0.015, half, 0.015)
        yield bar.format(0, side, z, half, 0.015, 0.015)
        for other in (half - 0.015, 0.015 - half):
            yield bar.format(side, other, (z - 0.75) / 2, 0.015, 0.015, (z + 0.75) / 2)

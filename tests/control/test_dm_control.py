"""The files of models/ in dm_control, for people who use the rig from there."""

import os

import numpy as np
from paths import MODELS

# Nothing is drawn here; without this dm_control looks for a screen when it is imported.
os.environ.setdefault("MUJOCO_GL", "disabled")


def test_the_scene_opens_and_the_motor_turns_the_hub():
    from dm_control import mujoco

    physics = mujoco.Physics.from_xml_path(str(MODELS / "scene.xml"))
    physics.set_control([0.15])
    for _ in range(200):
        physics.step()
    assert physics.named.data.qpos["hub"] > 0.05
    assert np.isfinite(physics.data.qpos).all()

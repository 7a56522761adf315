"""Equations of motion of the rig without effects.

The link is described twice: `beam` has the exact bending modes, from which `modal` makes a linear state-space model;
`chain` approximates it by rigid segments and spring hinges. `plant` holds every number of the chain's equations,
`planar` integrates them in compiled code, `mujoco_chain` in MuJoCo, which is the reference. `hub_law` is how an effect
adds a torque on the hub. `mjcf` writes the MuJoCo model, `accuracy` compares chain and beam.
"""

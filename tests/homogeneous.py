"""Parameters of a rig that may all grow alike, and what drives it with them, and nothing moves otherwise."""

HOMOGENEOUS = (
    "bending_stiffness",
    "linear_density",
    "hub_inertia",
    "tip_mass",
    "tip_inertia",
    "static_friction",
    "coulomb_friction",
)

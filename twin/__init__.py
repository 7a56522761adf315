"""A MuJoCo digital twin of a planar flexible manipulator that finds what its model lacks."""

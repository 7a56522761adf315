"""Numbers that all iterations and differences share."""

ROUNDING = 1e-9
"""Relative size, or of an instant in seconds, below which a difference is one of rounding."""
GAUSS_NEWTON_STEPS = 3
"""Steps near a minimum: each squares a relative error, 0.3 becomes less than 1e-4."""
FIXED_POINT_STEPS = 8
"""Iterations of an equation x = f(x) whose error each reduces to a third or less, by the low-pass: 1e-4 are left."""
MOST_EVALUATIONS = 10
"""Evaluations of a small search that only improves a first guess."""

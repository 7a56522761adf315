"""Numbers that all iterations and differences share."""

ROUNDING = 1e-9
"""Relative size, or of an instant in seconds, below which a difference is one of rounding."""
GAUSS_NEWTON_STEPS = 3
"""Steps near a minimum: each squares a relative error, 0.3 becomes less than 1e-4."""
FIXED_POINT_STEPS = 8
"""Iterations of an equation x = f(x): a friction that a filter has rounded off is right to 3 % behind them
(tests/residuals/test_creep.py)."""
MOST_EVALUATIONS = 10
"""Evaluations of a small search that only improves a first guess."""

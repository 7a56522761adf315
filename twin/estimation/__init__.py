"""Fits of a model to residuals: unknowns, cost, minimisation, and the uncertainty of the result."""

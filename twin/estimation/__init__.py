"""Fits of the model's parameters to residuals, and the uncertainty of what was fitted."""

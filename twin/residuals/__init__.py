"""Residuals of a model against recordings, local in time, and the noise by which they are scaled."""

"""Levels at which a deviation counts, used wherever a decision compares one with its standard deviation."""

SIGNIFICANT = 3.0
"""Standard deviations of a single deviation that counts: by chance once in 370."""
CERTAIN = 5.0
"""Standard deviations of the largest of many deviations that counts: by chance once in 1.7 million each."""
FOLLOWS = 2.0
"""Root mean square residual of a channel [noise levels] up to which a model follows its readings.

Measured on rigs with nothing missing, as the rule `worst-residual` of `twin.diagnosis.rules` says."""

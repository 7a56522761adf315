"""Validation before hardware: one controller on many rigs drawn from the parameters' uncertainty."""

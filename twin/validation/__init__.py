"""Validation before hardware: one controller on many rigs that the parameters' uncertainty allows."""

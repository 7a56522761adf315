"""Proposes missing effects, fits and judges them, and writes the answer: which effect the model lacks."""

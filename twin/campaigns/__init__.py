"""Recordings of one rig read from a folder, converted to SI units, and checked for bad input."""

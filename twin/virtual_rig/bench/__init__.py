"""Benches: campaigns as laboratories record them, of a ruler on a geared servo under a voltage command.

They are drawn by a seed: undeclared effects (`kinds`), rig and errors of its declaration (`ruler`), sensors
(`sensors`) and commands (`commands`). The plant is that of the virtual rig; `recording` runs it, and `writer` writes
the campaign.
"""

from twin.virtual_rig.bench.writer import BenchTruth, make_bench

__all__ = ["BenchTruth", "make_bench"]

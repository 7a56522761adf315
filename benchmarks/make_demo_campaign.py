"""Generates the bundled demo campaign, twin/data/demo-rig, on the virtual rig.

    python benchmarks/make_demo_campaign.py [--force]

The folder contains only what is declared. The truth is here: one undeclared effect, and parameters that differ from the
declared ones by a quarter of their uncertainty.
"""

import argparse
from pathlib import Path

from twin.virtual_rig import Truth, make_campaign

FOLDER = Path(__file__).resolve().parent.parent / "twin" / "data" / "demo-rig"
EFFECTS = {"cable-torsion": {"stiffness": 0.012, "rest_angle": 0.15}}
SEED = 2013


def make_demo(folder: Path = FOLDER, force: bool = False) -> Truth:
    """Writes the demo campaign and returns its truth."""
    return make_campaign(folder, EFFECTS, SEED, name="demo-rig", perturb=0.25, force=force)


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--force", action="store_true", help="write over the campaign that is there")
    print(make_demo(force=arguments.parse_args().force))

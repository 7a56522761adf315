"""Find what a model lacks, look at it, and hand the augmented rig on.

Run it with the folder of a campaign, or without one on the bundled demonstration:

    python docs/examples/diagnose.py [CAMPAIGN] [FOLDER FOR THE RESULTS]
"""

import sys
from importlib.resources import files

import numpy as np

import twin


def main(campaign: str, results: str) -> twin.Diagnosis:
    """Diagnoses a campaign, prints what was found, writes everything to a folder."""
    diagnosis = twin.diagnose(campaign, progress=print)
    print(diagnosis.summary)
    print(diagnosis.parameters())
    print(diagnosis.error_budget())

    # The augmented rig takes the place of the declared one everywhere.
    time = np.arange(0.0, 2.0, 2e-3)
    torque = np.where(time < 0.4, 0.15, np.where(time < 0.8, -0.15, 0.0))
    ends = {
        name: np.degrees(twin.model(rig).simulate(time, torque)["hub_angle"][-1])
        for name, rig in (("declared", diagnosis.answer.declared), ("augmented", diagnosis.rig))
    }
    print(f"A slew ends at {ends['declared']:.1f} degrees as declared, at {ends['augmented']:.1f} as found.")

    for what, path in diagnosis.save(results).items():
        print(f"{what:<8} {path}")
    return diagnosis


if __name__ == "__main__":
    given = sys.argv[1:]
    main(
        given[0] if given else str(files("twin") / "data" / "demo-rig"),
        (given + ["", "twin-out"])[1] or "twin-out",
    )

"""Bias, scatter and interval coverage of the stiffness by static tests with few rows, read to few decimals.

Loads at the tip of a clamped link: masses have normal errors of 0.2 g, the ruler of 0.3 mm, the length as declared; the
zero of the ruler is off by 2 mm. Readings are rounded. Each row of the table is of 2000 such tests, evaluated as
`twin identify` evaluates `static.csv`.

    python benchmarks/static_test.py
"""

from __future__ import annotations

from collections.abc import Iterator

import machine
import numpy as np
from scipy.constants import g

from twin.campaigns.campaign import Campaign, StaticTest
from twin.identification import static_test
from twin.identification.joint import prior_deviation
from twin.rigs import preset

TESTS = 2000  # simulated tests for each row of the table
STIFFNESS = 0.25  # N m^2
MASS_ERROR, RULER_ERROR, ZERO = 2e-4, 3e-4, 2e-3  # kg, m, m


def tests(rows: int, decimals: int, generator: np.random.Generator) -> Iterator[static_test.StaticTest]:
    """Yields the evaluation of each simulated test."""
    rig = preset("bossi2009")
    mass = np.linspace(0.02, 0.2, rows)
    for _ in range(TESTS):
        compliance = generator.normal(rig["length"], prior_deviation(rig, "length")) ** 3 / (3 * STIFFNESS)
        read = np.round(mass + generator.normal(0, MASS_ERROR, rows), 3)
        tip = compliance * g * mass + ZERO + generator.normal(0, RULER_ERROR, rows)
        table = StaticTest({"tip_load_mass": read, "tip_deflection": np.round(tip, decimals)})
        yield static_test.evaluate(Campaign("", rig, {}, (), table))


def main() -> None:
    """Prints the table."""
    print(f"`python benchmarks/static_test.py`, {machine.describe()}\n")
    print("| rows | ruler read to | bias of EI | scatter of EI | 95 % interval holds the truth |")
    print("| --- | --- | --- | --- | --- |")
    generator = np.random.default_rng(1)
    for rows in (4, 5, 6, 8, 12):
        for decimals in (3, 4):
            found = [test.stiffness for test in tests(rows, decimals, generator)]
            off = np.array([f.value for f in found]) / STIFFNESS - 1
            held = np.mean([f.interval[0] <= STIFFNESS <= f.interval[1] for f in found])
            step = f"{10.0 ** (3 - decimals):g} mm"
            print(
                f"| {rows} | {step} | {100 * off.mean():.2f} % | {100 * off.std():.2f} % | {100 * held:.1f} % |"
            )


if __name__ == "__main__":
    main()

"""Discretisation error of chains in the residuals of a diagnosis, in multiples of the noise.

    python benchmarks/discretisation.py CAMPAIGN ...

CAMPAIGN is a folder, the seed of a virtual bench (`twin.virtual_rig.bench`), or `demo`. At the calibrated model, the
link driven by the measured hub, the residuals of a chain are compared with the limit of fitted chains of 16, 24 and 32
segments: the root mean square over the stretches of all channels, and the worst stretch. Chains of equal segments stand
beside those whose proportions are fitted. The table is printed, and written to
benchmarks/results/discretisation.md.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path

import numpy as np
from machine import command, describe

from twin.campaigns.campaign import read_campaign
from twin.estimation import chain_limit
from twin.estimation.calibrate import SEARCH_SEGMENTS, calibrate
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.workbench import Workbench
from twin.mechanics.chain import uniform_shape
from twin.rigs.model import FINE_SEGMENTS, Model
from twin.virtual_rig.bench import make_bench

RESULTS = Path(__file__).parent / "results" / "discretisation.md"
LIMIT = (16, 24, 32)
ORDERS = (), (FINE_SEGMENTS,), chain_limit.ROUGH, (8, 12, 16), chain_limit.STANDARD, chain_limit.PRECISE
"""Numbers of segments from which a limit is extrapolated; none for the chain of the search."""


def equal_segments(model: Model, segments: int) -> Model:
    """The model on a chain of equal segments."""
    return chain_limit.with_segments(model, segments).replace(shape=uniform_shape(segments))


def errors(folder: Path) -> dict[str, list[tuple[float, float]]]:
    """Chains -> mean and largest error over the stretches, of fitted and of equal segments [noise levels]."""
    with ResidualPool(1) as pool:
        found = calibrate(read_campaign(folder), pool)
        bench, model, starts = Workbench(found.data, pool), found.base.model, found.base.starts

        def residual(of: Callable[[Model, int], Model], segments: Sequence[int]) -> np.ndarray:
            chains = [of(model, n) for n in segments] or [model]
            parts = bench.residuals([(chain, starts, None) for chain in chains])
            weights = chain_limit.richardson_weights(segments) if segments else np.ones(1)
            return weights @ np.array(parts)

        exact = residual(chain_limit.with_segments, LIMIT)
        return {
            _label(segments): [
                _size(bench.sizes(residual(of, segments) - exact))
                for of in (chain_limit.with_segments, equal_segments)
                if segments or of is not equal_segments
            ]
            for segments in ORDERS
        }


def _label(segments: Sequence[int]) -> str:
    if len(segments) > 1:
        return f"limit of {', '.join(map(str, segments))}"
    return f"{segments[0]} segments" if segments else f"search, {SEARCH_SEGMENTS} segments"


def _size(sizes: np.ndarray) -> tuple[float, float]:
    return float(np.sqrt(np.mean(sizes**2))), float(sizes.max())


def folder_of(name: str, made: Path) -> Path:
    """The folder of a campaign on the command line; a virtual bench is made in `made`."""
    if name == "demo":
        return Path(str(files("twin") / "data" / "demo-rig"))
    if not name.isdigit():
        return Path(name)
    make_bench(made / name, int(name))
    return made / name


def main() -> None:
    """Prints the table and writes it."""
    rows = ["| campaign | chains | fitted: mean, worst | equal: mean, worst |", "| --- | --- | ---: | ---: |"]
    with tempfile.TemporaryDirectory() as made:
        for name in sys.argv[1:]:
            label = f"bench {name}" if name.isdigit() else Path(name).name
            for chains, sizes in errors(folder_of(name, Path(made))).items():
                cells = [f"{mean:.2g}, {worst:.2g}" for mean, worst in sizes]
                rows.append(f"| {' | '.join([label, chains, *cells, *['-'] * (2 - len(cells))])} |")
                print(rows[-1], flush=True)
    head = f"# Discretisation error of chains\n\n`{command()}`, {describe()}. Errors in multiples of the noise.\n\n"
    RESULTS.write_text(head + "\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

"""Correlations of errors: their root, and what a parameter file keeps of them."""

import tomllib

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from twin.correlations import from_covariance, read

NAMES = tuple("abcdef")


@st.composite
def covariances(draw):
    """Covariances of up to six numbers of different sizes, of full rank or less."""
    count = draw(st.integers(2, len(NAMES)))
    rank = draw(st.integers(1, count))
    entry = st.floats(-1.0, 1.0)
    rows = st.lists(st.lists(entry, min_size=rank, max_size=rank), min_size=count, max_size=count)
    root = np.array(draw(rows))
    sizes = 10.0 ** np.array(draw(st.lists(st.integers(-6, 3), min_size=count, max_size=count)))
    # No number is known exactly.
    root[:, 0] += np.where(np.abs(root).max(axis=1) < 0.1, 1.0, 0.0)
    return (sizes[:, None] * root) @ (sizes[:, None] * root).T


@given(covariance=covariances(), asked=st.lists(st.sampled_from((*NAMES, "x", "y")), min_size=1, unique=True))
def test_the_root_has_the_correlations_of_the_numbers_asked_for(covariance, asked):
    names = NAMES[: len(covariance)]
    known = from_covariance(names, covariance)
    deviation = np.sqrt(np.diag(covariance))
    expected = np.eye(len(asked))
    for i, a in enumerate(asked):
        for j, b in enumerate(asked):
            if a in names and b in names and i != j:
                k, m = names.index(a), names.index(b)
                expected[i, j] = covariance[k, m] / (deviation[k] * deviation[m])
    root = known.root(asked)
    np.testing.assert_allclose(root @ root.T, expected, rtol=0, atol=1e-12)


@given(covariance=covariances())
def test_a_parameter_file_keeps_correlations_to_its_digits(covariance):
    known = from_covariance(NAMES[: len(covariance)], covariance)
    table = tomllib.loads("\n".join(known.lines()))["correlations"]
    found = read(table, NAMES)
    assert found.names == known.names
    np.testing.assert_allclose(found.matrix, known.matrix, rtol=0, atol=5.1e-5)

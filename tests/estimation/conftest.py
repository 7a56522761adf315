"""The pool in which the residuals of these tests are computed."""

import pytest

from twin.estimation.residual_pool import ResidualPool


@pytest.fixture
def pool():
    with ResidualPool(1) as threads:
        yield threads

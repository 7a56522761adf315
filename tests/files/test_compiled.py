"""Compiled functions need no folder to be kept in."""

import pytest

from twin.files import compiled


def test_a_function_that_cannot_be_kept_on_disk_is_compiled_all_the_same_and_that_is_said():
    names = {}
    exec(
        "def twice(x):\n    return 2 * x", names
    )  # a function without a file, beside which numba keeps others
    compiled._warn.cache_clear()
    with pytest.warns(RuntimeWarning, match="set NUMBA_CACHE_DIR"):
        twice = compiled.cached_njit(nogil=True)(names["twice"])
    assert twice(21) == 42
    exec("def thrice(x):\n    return 3 * x", names)
    assert (
        compiled.cached_njit()(names["thrice"])(2) == 6
    )  # without a second warning, which would be an error

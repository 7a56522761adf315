"""Large arrays that are freed do not stay with the process."""

import os
import platform
import subprocess
import sys

import pytest

CODE = """
import numpy as np
from twin.executors.memory import return_large_arrays

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1])

CALL
np.ones(2**21)  # of 16 MiB: when it is freed, glibc by itself takes arrays up to that from the heap
before = resident()
mixed = [(np.ones(2**19), np.ones(2**13)) for _ in range(50)]  # 4 MiB and 64 KiB
small = [pair[1] for pair in mixed]
del mixed
print(resident() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="needs glibc")
def test_holes_of_large_arrays_are_not_kept():
    pages = []
    for call in ("return_large_arrays()", ""):
        command = [sys.executable, "-c", CODE.replace("CALL", call)]
        pages.append(int(subprocess.run(command, capture_output=True, text=True, check=True).stdout))
    kept, by_itself = (count * os.sysconf("SC_PAGE_SIZE") / 2**20 for count in pages)
    assert kept < 20  # MiB: those of 64 KiB alone are 3
    assert by_itself > 150

"""Tests, in rooms as the code; what they share is in support.

Linear algebra has one thread here, as the command line has it: matrices are small, and threads would only wait.
"""

import os

# Before NumPy and SciPy load their libraries; commands started by tests inherit it.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

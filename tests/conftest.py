"""What every test process needs before a library is imported: no window, and no fight over the cores.

The workers of pytest-xdist and the programs that tests start inherit these settings.
"""

import os
import sys

os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("SDL_AUDIODRIVER", "dummy")
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")  # torch's own threads; numba's are set where a test is about them
os.environ.setdefault(
    "CROWD_ENV_QUIET", "1"
)  # no note that kernels are being compiled; tests/core/kernels/test_jit.py is about it

# Rewriting the assertions of all tests takes each process ten seconds: what it makes is kept, also where a container says that
# nothing is to be.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

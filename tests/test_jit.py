"""How kernels are compiled: the note on a cold start, and silence on a warm one."""

import os
import subprocess
import sys
from pathlib import Path

PROGRAM = """
import numpy as np
from crowd_env.population import closest_pair
position, radius = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0]]), np.array([0.1, 0.2, 0.3])
assert closest_pair(position, radius)[:2] == (1, 2)
"""


def run(cache, **environment):
    settings = {name: value for name, value in os.environ.items() if name != "CROWD_ENV_QUIET"}
    root = Path(__file__).resolve().parent.parent
    settings |= {"NUMBA_CACHE_DIR": str(cache), **environment}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=settings, cwd=root, capture_output=True, text=True, check=True
    )
    assert done.stdout == ""
    return done.stderr


def test_a_cold_start_says_once_that_it_compiles_and_a_warm_one_says_nothing(tmp_path):
    note = run(tmp_path)
    assert note.startswith("crowd_env: compiling kernels, once for this version") and note.count("\n") == 1
    assert run(tmp_path) == ""


def test_the_note_can_be_silenced(tmp_path):
    assert run(tmp_path, CROWD_ENV_QUIET="1") == ""

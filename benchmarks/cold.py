"""From nothing to the first step: import, then the first step with an empty and with a filled kernel cache.

Each is one new process; the cache is a temporary folder, so the user's own is neither used nor touched.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.measuring import Effort, Row

PROGRAM = """
import json, time
begin = time.perf_counter()
import crowd_env
imported = time.perf_counter()
env = crowd_env.CrowdEnv("room-v0", physics="nsm2")
env.reset(seed=0)
env.step(None)
stepped = time.perf_counter()
print(json.dumps({"import, s": imported - begin, "first step, s": stepped - imported, "CPU s": time.process_time()}))
"""


def rows(effort: Effort) -> list[Row]:
    """Return seconds on the clock, and CPU seconds of the whole process; a block is one warm start."""
    with tempfile.TemporaryDirectory() as cache:
        cold, *warm = (start(cache) for _ in range(1 + effort.blocks))
    best = {name: min(run[name] for run in warm) for name in cold}
    return [
        Row(f"nsm2, {who} cache", name, value)
        for who, figures in (("empty", cold), ("filled", best))
        for name, value in figures.items()
    ]


def start(cache: str) -> dict[str, float]:
    """Run a new process with its kernels in ``cache``; return what it printed."""
    result = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=Path(__file__).resolve().parent.parent,
        env={**os.environ, "NUMBA_CACHE_DIR": cache},
        capture_output=True,
        text=True,
        check=False,
    )
    if result.returncode != 0:
        raise ValueError(f"the program that is timed failed:\n{result.stderr}")
    return dict(json.loads(result.stdout.splitlines()[-1]))

"""From nothing to the first step: import, then the first step with an empty and with a filled kernel cache.

Each is one new process; the cache is a temporary folder, so the user's own is neither used nor touched.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.measuring import Effort, Row, significant

PROGRAM = """
import json, time
begin = time.perf_counter()
import crowd_env
imported = time.perf_counter()
env = crowd_env.CrowdEnv("room-v0", scheme={scheme!r})
env.reset(seed=0)
env.step(None)
print(json.dumps({{"import": imported - begin, "first step": time.perf_counter() - imported, "CPU": time.process_time()}}))
"""


def rows(effort: Effort, scheme: str = "nsm2") -> list[Row]:
    """Return seconds on the clock, and CPU seconds of the whole process; a block is one warm start."""
    with tempfile.TemporaryDirectory() as cache:
        cold = start(scheme, cache)
        warm = [start(scheme, cache) for _ in range(effort.blocks)]
    figures = {
        "import": min(run["import"] for run in warm),
        "first step, empty cache": cold["first step"],
        "first step, filled cache": min(run["first step"] for run in warm),
    }
    found = [Row(f"{scheme}: {what}", significant(value, 3), "s") for what, value in figures.items()]
    found.append(Row(f"{scheme}: whole process, empty cache", significant(cold["CPU"], 3), "CPU s"))
    found.append(Row(f"{scheme}: whole process, filled cache", significant(min(r["CPU"] for r in warm), 3), "CPU s"))
    return found


def start(scheme: str, cache: str) -> dict[str, float]:
    """Run a new process with its kernels in ``cache``; return what it printed."""
    result = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(scheme=scheme)],
        cwd=Path(__file__).resolve().parent.parent,
        env={**os.environ, "NUMBA_CACHE_DIR": cache},
        capture_output=True,
        text=True,
        check=False,
    )
    if result.returncode != 0:
        raise ValueError(f"the program that is timed failed:\n{result.stderr}")
    return dict(json.loads(result.stdout.splitlines()[-1]))

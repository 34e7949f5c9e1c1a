"""The wheel of kernels, built, installed and used."""

import os
import platform
import subprocess
import sys

import pytest
from repository import ROOT

from benchmarks import kernels_wheel
from crowd_env.core.kernels import jit
from crowd_env.physics import SCHEMES

FIRST_STEP = """
import crowd_env
env = crowd_env.CrowdEnv("room-v0", physics={!r}, walking="hurried")
env.reset(seed=0)
env.step(None)
"""


@pytest.mark.nightly
def test_with_the_wheel_no_first_step_compiles(tmp_path):
    able = jit.get_host_cpu_features()
    if (platform.system(), platform.machine()) != ("Linux", "x86_64") or not all(map(able.get, jit._ABILITIES)):
        pytest.skip("no kernels are made on such a machine")
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-index", "--no-deps", "--target", tmp_path / "site"]
    subprocess.run([*pip, kernels_wheel.build(tmp_path)], check=True)
    settings = {name: value for name, value in os.environ.items() if name != "CROWD_ENV_QUIET"}
    settings |= {"PYTHONPATH": str(tmp_path / "site"), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    for name in SCHEMES:
        program = [sys.executable, "-c", FIRST_STEP.format(name)]
        found = subprocess.run(program, cwd=ROOT, env=settings, capture_output=True, text=True, check=True)
        assert found.stderr == "", name
    assert not list(tmp_path.glob("cache/**/*.nbc"))


def test_other_systems_are_told(tmp_path, monkeypatch):
    monkeypatch.setattr(platform, "system", lambda: "Windows")
    with pytest.raises(ValueError, match="under Linux on x86-64"):
        kernels_wheel.build(tmp_path)

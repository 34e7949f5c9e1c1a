"""``make kernels-wheel``: kernels that need not be compiled, as a wheel of their own, dist/crowd_env_kernels-*.whl.

It holds what a first step under every scheme, with and without a manner, a first run and its report ask for.  Only the
same sources, numba and Python take it (`crowd_env.core.kernels.jit.installed_kernels`).  numba unpickles it: it has to come
from whoever signs crowd_env.
"""

import base64
import hashlib
import os
import platform
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numba

from crowd_env.core.kernels.jit import PORTABLE, STAMP, folder_of_installed
from crowd_env.core.version import __version__

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = """
import sys, crowd_env
from crowd_env.cli.main import app
from crowd_env.physics import SCHEMES
worlds = [("room-v0", name, walking, None) for name in SCHEMES for walking in (None, "calm")]
for scenario, physics, walking, routing in [*worlds, ("two-exit-hall-v0", "nsm2", None, "fastest")]:
    env = crowd_env.make_vec(scenario, 2, physics=physics, walking=walking, routing=routing)
    env.reset(seed=0)
    env.step(env.action_space.sample())
app(["run", "two-exit-hall-v0", "--runs", "1", "--out", sys.argv[1]], standalone_mode=False)
app(["report", sys.argv[1], "--out", sys.argv[1] + "/report.html"], standalone_mode=False)
"""


def build(out: Path) -> Path:
    """Compile for some minutes, and write the wheel into the folder ``out``; return where it is.

    Raises
    ------
    ValueError
        On other systems than Linux on x86-64: what is compiled elsewhere is of no use there.
    subprocess.CalledProcessError
        If that fails.
    """
    if (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        raise ValueError("kernels for x86-64-v3 are made under Linux on x86-64")
    name, about = f"crowd_env_kernels-{__version__}", f"crowd_env_kernels-{__version__}.dist-info"
    tag = f"cp{sys.version_info.major}{sys.version_info.minor}-none-manylinux_2_17_x86_64"
    metadata = (
        f"Metadata-Version: 2.1\nName: crowd-env-kernels\nVersion: {__version__}\nSummary: Compiled kernels of crowd-env\n"
        f"License: MIT\nRequires-Dist: crowd-env=={__version__}\nRequires-Dist: numba=={numba.__version__}\n"
    )
    wheel = f"Wheel-Version: 1.0\nGenerator: crowd-env\nRoot-Is-Purelib: true\nTag: {tag}\n"
    with tempfile.TemporaryDirectory() as cache:
        processor, features = PORTABLE
        settings = {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": features, "NUMBA_CACHE_DIR": cache}
        program = [sys.executable, "-c", PROGRAM, f"{cache}/hall"]
        subprocess.run(program, cwd=ROOT, env=os.environ | settings, check=True, capture_output=True)
        made = Path(cache) / f"kernels-{STAMP}"
        inside = f"crowd_env_kernels/{folder_of_installed(STAMP)}"
        kept = [path for path in sorted(made.rglob("*.nb[ci]")) if path.parent.name.startswith("crowd_env.")]
        files = {f"{inside}/{path.relative_to(made).as_posix()}": path.read_bytes() for path in kept}
    files |= {
        "crowd_env_kernels/__init__.py": b'"""Compiled kernels of crowd_env, which finds and reads them by itself."""\n',
        f"{about}/licenses/LICENSE": (ROOT / "LICENSE").read_bytes(),
        f"{about}/METADATA": metadata.encode(),
        f"{about}/WHEEL": wheel.encode(),
    }
    sums = {path: base64.urlsafe_b64encode(hashlib.sha256(data).digest()) for path, data in files.items()}
    record = [f"{path},sha256={sums[path].decode().rstrip('=')},{len(data)}\n" for path, data in files.items()]
    files[f"{about}/RECORD"] = "".join([*record, f"{about}/RECORD,,\n"]).encode()
    out.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(out / f"{name}-{tag}.whl", "w", zipfile.ZIP_DEFLATED) as archive:
        for path, data in files.items():
            archive.writestr(path, data)
    return out / f"{name}-{tag}.whl"


if __name__ == "__main__":
    print(build(ROOT / "dist"))

"""What a command ran: everything that decides its results, to be kept beside them."""

import hashlib
import json
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NotRequired, cast

from typing_extensions import TypedDict

from crowd_env.analysis.results.plain import plain
from crowd_env.core.behaviors import IN_WORDS
from crowd_env.core.checks import Plain, shown
from crowd_env.core.files.fingerprint import fingerprint
from crowd_env.core.files.json_file import read_json
from crowd_env.core.files.versions import versions_of
from crowd_env.core.kernels import jit
from crowd_env.core.version import __version__
from crowd_env.envs.settings import Routing, physics_step
from crowd_env.physics.scheme import DECISION_DT
from crowd_env.physics.settings import Physics
from crowd_env.scenarios.scenario import Scenario

# Parts of a config in which two commands may differ and still go on with each other's runs.
FREE = ("runs", "platform", "command", "arguments", "files", "notes")


class _Named(TypedDict):
    name: str


# What is read of a config again -> what it must be.
_READ: dict[str, Any] = {
    **dict.fromkeys(("scenario", "strategy", "fingerprint", "version", "sources"), str),
    **dict.fromkeys(IN_WORDS, Any),
    **{"rules": bool, "dt": float, "decision_dt": float, "seed": int, "runs": int},
    **{"arguments": dict[str, Any], "scheme": _Named, "versions": dict[str, str]},
    **{"policy": NotRequired[_Named], "files": NotRequired[dict[str, str]]},
    **{"command": NotRequired[list[str]], "platform": NotRequired[str]},
}


def read_config(path: Path) -> Plain:
    """Return the config in a file, checked.

    Raises
    ------
    ValueError
        If the file cannot be read, or is not the config of `crowd-env run`.
    """
    config = read_json(path)
    require_data(f"{path} is not the config of crowd-env run", cast(Any, TypedDict)("Config", _READ), config)
    return dict(config)


def require_data(where: str, kind: Any, content: Any) -> None:
    """Raise ValueError, which begins with ``where``, unless plain data is what the annotations of a class say."""
    from pydantic import TypeAdapter, ValidationError

    try:
        text = json.dumps(content, ensure_ascii=False).encode("utf-8", "replace")  # pydantic refuses lone surrogates
        TypeAdapter(kind).validate_json(text, strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(map(str, first["loc"])) or "it"
        must = first["msg"].replace("Input should be", "it must be")
        wrong = "is missing" if first["type"] == "missing" else f"is {shown(first['input'])}; {must}"
        raise ValueError(f"{where}: {field} {wrong}") from None


def run_config(
    scenario: Scenario,
    physics: Physics,
    routing: Routing,
    runs: int,
    *,
    seed: int,
    command: Sequence[str] = (),
    arguments: Plain | None = None,
    files: Sequence[Path] = (),
) -> dict[str, Any]:
    """Return all that decides the results of a command, ready for JSON.

    Parameters
    ----------
    scenario : with the behaviors of the run.
    command : the words of the command line.
    arguments : its options by their names, as it was given them.
    files : what it read.

    Raises
    ------
    ValueError
        If a file cannot be read.
    """
    scheme = physics.law
    return {
        "scenario": scenario.name,
        "population": plain(scenario.population.parts),
        "time_limit": scenario.time_limit,
        "blocked_after": plain(scenario.blocked_after),
        **scenario.plain_behaviors(),
        "strategy": str(routing.strategy),
        "rules": routing.signs,
        "max_drive": plain(scenario.max_drive if physics.max_drive is None else physics.max_drive),
        "scheme": {"name": scheme.info.name, **plain(scheme)},
        "dt": physics_step(physics, scenario),
        "decision_dt": DECISION_DT,
        "seed": seed,
        "fingerprint": fingerprint(scenario),  # of plan, people, routes and rules: equal for equal ones
        "version": __version__,
        "sources": jit.STAMP,
        "versions": versions_of(),
        "runs": runs,
        "platform": platform.platform(),
        "command": list(command),
        "arguments": plain(dict(arguments or {})),
        "files": {str(path.absolute()): file_digest(path) for path in files},
    }


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file; ValueError if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror or error}") from None

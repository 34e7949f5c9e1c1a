"""Write a trained network as ONNX, or runs of a policy as arrays: ``crowd-env export``."""

import json
from pathlib import Path
from typing import Annotated

import typer

from crowd_env.agents import make_policy
from crowd_env.agents.evaluation.entries import RULE
from crowd_env.agents.onnx_graph import metadata_of, to_onnx
from crowd_env.agents.pretrained import load
from crowd_env.agents.tasks import make_task
from crowd_env.agents.transitions import minari_for, write_minari, write_runs
from crowd_env.cli.options import new_app, plain
from crowd_env.core.checks import Plain
from crowd_env.core.console import check_folder, friendly_errors, say
from crowd_env.core.files.atomic import check_suffix, write_bytes

_NETWORK = "A shipped policy (TASK/NAME), or the path of a network (.safetensors); of runs any policy."
_RUNS = "File of runs to write (.npz): observations, actions, rewards and masks of draws that are not held out."
app = new_app()


@app.command()
def main(
    network: Annotated[str, typer.Argument(help=_NETWORK)],
    onnx: Annotated[Path | None, plain("File to write (.onnx).", metavar="FILE")] = None,
    transitions: Annotated[Path | None, plain(_RUNS, metavar="FILE")] = None,
    minari: Annotated[str | None, plain("Dataset of Minari to make of these runs too.", metavar="ID")] = None,
    task: Annotated[str, plain("Task of the runs.", metavar="NAME")] = "competitive-door",
    runs: Annotated[int, plain("Runs to write.")] = 10,
    as_json: Annotated[bool, plain("Print one JSON object about the file, not a line.", names=("--json",))] = False,
) -> None:
    """Write a trained network as ONNX, or runs of a policy as arrays; the file says what its numbers mean.

    Examples
    --------
    crowd-env export competitive-door/ppo --onnx ppo.onnx

    crowd-env export evolution --transitions runs.npz --task competitive-door --runs 10
    """
    with friendly_errors():
        if (onnx is None) == (transitions is None):
            raise ValueError("give one of --onnx FILE and --transitions FILE")
        if minari is not None and transitions is None:
            raise ValueError("--minari makes a dataset of the runs of --transitions FILE: give that too")
        if transitions is not None:
            check_folder("--transitions", transitions.parent)
            if minari is not None:
                minari_for(minari)  # before the runs, which take long
            policy = make_policy("shortest" if network == RULE else network)  # it leaves people to the rule of the task
            done = write_runs(transitions, policy, make_task(task), runs)
            content: dict[str, object] = {"file": str(transitions), "bytes": transitions.stat().st_size, "runs": done}
            line = f"{transitions}: {done} runs, {content['bytes']} bytes"
            if minari is not None:
                content |= {"dataset": minari, "episodes": write_minari(minari, transitions)}
                line += f"; {minari}: {content['episodes']} episodes"
            _say(content, line, as_json)
            return
        assert onnx is not None
        check_suffix(onnx, (".onnx",))
        check_folder("--onnx", onnx.parent)
        found = load(network)
        graph = to_onnx(found).SerializeToString()
        write_bytes(onnx, graph)
        inputs = {"observation": ["N", found.network.inputs]}
        about = {"file": str(onnx), "bytes": len(graph), "inputs": inputs, "metadata": metadata_of(found)}
        _say(about, f"{onnx}: {len(graph)} bytes", as_json)


def _say(about: Plain, line: str, as_json: bool) -> None:
    """Print what is in a file as JSON, or say it in a line."""
    if as_json:
        typer.echo(json.dumps(about))
    else:
        say(line)

"""Networks as ONNX graphs, for programs without Python.

The graph is put together from the numbers themselves; no learning library is needed.  It takes ``observation`` (N, D) float32
and returns ``action``, as acting here does, in single precision: of choices also ``logits``, whose largest is taken.
"""

import json
from collections.abc import Callable
from types import ModuleType
from typing import TYPE_CHECKING

import gymnasium
import numpy as np

from crowd_env.core.checks import known
from crowd_env.core.libraries import needed_for
from crowd_env.envs.action import make_action

from .networks import MLP, BetweenMLP, Network
from .plain import Plain
from .trained import LearnedController, LearnedPolicy

if TYPE_CHECKING:
    from onnx import ModelProto, NodeProto, TensorProto

# ONNX Runtime reads these since version 1.15, and every other runtime that is kept up.
_OPSET, _IR_VERSION = 17, 8


class Graph:
    """Nodes and constants, added one after the other.

    Attributes
    ----------
    nodes, constants : as `onnx.helper.make_graph` takes them.
    """

    def __init__(self, onnx: ModuleType) -> None:
        self.onnx = onnx
        self.nodes: list[NodeProto] = []
        self.constants: list[TensorProto] = []

    def constant(self, name: str, values: np.ndarray) -> str:
        """Add an array, and return its name."""
        self.constants.append(self.onnx.numpy_helper.from_array(np.array(values, order="C"), name))
        return name

    def node(self, kind: str, inputs: list[str], output: str, **attributes: int) -> str:
        """Add a node, and return the name of its output."""
        self.nodes.append(self.onnx.helper.make_node(kind, inputs, [output], name=output, **attributes))
        return output


_UNITS = {"tanh": "Tanh", "relu": "Relu"}  # activation -> node


def _mlp(graph: Graph, network: Network, output: str) -> None:
    """Add layers of units."""
    assert isinstance(network, MLP)
    last, values = len(network.weights) - 1, "observation"
    for k, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        arrays = [
            graph.constant(f"{name}{k}", one.astype(np.float32)) for name, one in (("weight", weight), ("bias", bias))
        ]
        values = graph.node("Gemm", [values, *arrays], output if k == last else f"layer{k}", transB=1)
        if k < last:
            values = graph.node(_UNITS[network.activation], [values], f"units{k}")


def _between(graph: Graph, network: Network, output: str) -> None:
    """Add layers of units, and the mean of the likeliest choice and the likelier one beside it."""
    assert isinstance(network, BetweenMLP)
    _mlp(graph, network, "scores")
    pads = graph.constant("pads", np.array([0, 0, 0, 1]))
    none = graph.constant("none", np.array(-np.inf, dtype=np.float32))
    scores = graph.node("Pad", ["scores", pads, none], "padded")
    best = graph.node("ArgMax", [scores], "best", axis=1, keepdims=1)
    commands = graph.constant("commands", network.commands.astype(np.float32))

    def of(name: str, choice: str) -> str:
        return graph.node("GatherElements", [scores, choice], f"score_{name}", axis=1)

    ends = ("slower", "faster")
    choices = [
        graph.node("Gather", [graph.constant(f"{end}_of", one), best], end)
        for end, one in zip(ends, network.beside, strict=True)
    ]
    slower, faster = (of(end, one) for end, one in zip(ends, choices, strict=True))
    beside = graph.node("Where", [graph.node("Greater", [faster, slower], "up"), *choices[::-1]], "beside")
    share = graph.node("Sigmoid", [graph.node("Sub", [of("beside", beside), of("best", best)], "less")], "share")
    mine, other = (graph.node("Gather", [commands, one], f"command_{one}") for one in (best, beside))
    last = graph.constant("last", np.array([2]))
    part = graph.node(
        "Mul", [graph.node("Unsqueeze", [share, last], "part"), graph.node("Sub", [other, mine], "way")], "add"
    )
    graph.node("Add", [mine, part], output)


# Kind of network -> adds its nodes, from "observation" to the name that is given.
GRAPHS: dict[str, Callable[[Graph, Network, str], None]] = {MLP.kind: _mlp, BetweenMLP.kind: _between}


def to_onnx(found: LearnedPolicy | LearnedController) -> "ModelProto":
    """Return the ``onnx.ModelProto`` of a policy or controller; its metadata says what goes in and what comes out.

    Raises
    ------
    ValueError
        If networks of this kind cannot be exported.
    ModuleNotFoundError
        If onnx is not installed.
    """
    onnx = _onnx()
    network = found.network
    add = GRAPHS[known("kind of network with an ONNX graph", network.kind, GRAPHS)]
    graph, floats, integers = Graph(onnx), onnx.TensorProto.FLOAT, onnx.TensorProto.INT64
    describe = onnx.helper.make_tensor_value_info
    logits = describe("logits", floats, ["N", network.outputs])
    if isinstance(found, LearnedController):
        add(graph, network, "logits")
        graph.constant("choices", found.choices)
        parts = [f"logits{k}" for k in range(len(found.choices))]
        graph.nodes.append(onnx.helper.make_node("Split", ["logits", "choices"], parts, name="split", axis=1))
        chosen = [graph.node("ArgMax", [part], f"choice{k}", axis=1, keepdims=1) for k, part in enumerate(parts)]
        graph.node("Concat", chosen, "action", axis=1)
        outputs = [describe("action", integers, ["N", len(parts)]), logits]
    elif isinstance(found.space, gymnasium.spaces.Discrete):
        add(graph, network, "logits")
        graph.node("ArgMax", ["logits"], "action", axis=1, keepdims=0)
        outputs = [describe("action", integers, ["N"]), logits]
    else:
        add(graph, network, "mean")
        box, shape = found.space, found.space.shape or ()
        target = graph.constant("shape", np.array([-1, *shape], dtype=np.int64))
        bounds = [graph.constant(name, getattr(box, name).astype(np.float32)) for name in ("low", "high")]
        shaped = graph.node("Reshape", ["mean", target], "shaped")
        graph.node("Min", [graph.node("Max", [shaped, bounds[0]], "raised"), bounds[1]], "action")
        outputs = [describe("action", floats, ["N", *shape])]
    body = onnx.helper.make_graph(
        graph.nodes,
        found.name.replace("/", "-"),
        [describe("observation", floats, ["N", network.inputs])],
        outputs,
        graph.constants,
    )
    model = onnx.helper.make_model(
        body, producer_name="crowd_env", ir_version=_IR_VERSION, opset_imports=[onnx.helper.make_opsetid("", _OPSET)]
    )
    onnx.helper.set_model_props(model, {key: json.dumps(value) for key, value in metadata_of(found).items()})
    onnx.checker.check_model(model, full_check=True)
    return model


def metadata_of(found: LearnedPolicy | LearnedController) -> Plain:
    """Return the facts of the network's own file, the columns of each observation term, and what each choice does."""
    facts = found.facts()
    if isinstance(found, LearnedController):
        return facts
    layout = found.env_options["observation"]
    columns = {name: [layout[name].start, layout[name].stop] for name in facts["observation"]["terms"]}
    more: dict[str, object] = {"columns": columns}
    if isinstance(found.space, gymnasium.spaces.Discrete):
        commands, ways = make_action(found.env_options["action"]).decoded(np.arange(found.space.n))
        more["commands"] = commands.tolist()
        if ways is not None:
            more["ways"] = ways.tolist()
    return {**facts, **more}


def _onnx() -> ModuleType:
    with needed_for("export to ONNX", "onnx"):
        import onnx
        import onnx.checker
        import onnx.helper
        import onnx.numpy_helper
    return onnx

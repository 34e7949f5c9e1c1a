"""Networks as ONNX graphs, for programs without Python.

The graph is built from the numbers of a network, without a learning library.  It takes ``observation`` (N, D) float32 and
returns ``action`` in single precision, as the policy does here.  For choices it also returns ``logits``.
"""

import json
from collections.abc import Callable
from types import ModuleType
from typing import TYPE_CHECKING

import gymnasium
import numpy as np

from crowd_env.core.checks import known
from crowd_env.core.libraries import needed_for

from .networks import MLP, BetweenMLP, Network
from .plain import Plain
from .trained import LearnedController, LearnedPolicy, columns_of

if TYPE_CHECKING:
    from onnx import ModelProto, NodeProto, TensorProto

# ONNX Runtime reads these since version 1.15, as does every other maintained runtime.
_OPSET, _IR_VERSION = 17, 8


class Graph:
    """The nodes and constants of a graph in the order of their addition.

    Attributes
    ----------
    nodes, constants : as `onnx.helper.make_graph` takes them.
    """

    def __init__(self, onnx: ModuleType) -> None:
        self.onnx = onnx
        self.nodes: list[NodeProto] = []
        self.constants: list[TensorProto] = []

    def constant(self, name: str, values: np.ndarray) -> str:
        """Add an array, one of floats in single precision, and return its name."""
        kept = np.array(values, dtype=np.float32 if values.dtype.kind == "f" else values.dtype, order="C")
        self.constants.append(self.onnx.numpy_helper.from_array(kept, name))
        return name

    def node(self, kind: str, inputs: list[str], output: str, **attributes: int) -> str:
        """Add a node, and return the name of its output."""
        self.nodes.append(self.onnx.helper.make_node(kind, inputs, [output], name=output, **attributes))
        return output


_UNITS = {"tanh": "Tanh", "relu": "Relu"}  # activation -> node


def _mlp(graph: Graph, network: Network, output: str) -> None:
    """Add the layers of an `MLP`."""
    assert isinstance(network, MLP)
    for name, one in network.tensors().items():
        graph.constant(name, one)
    last, values = len(network.weights) - 1, "observation"
    for k in range(last):
        sums = graph.node("Gemm", [values, f"weight{k}", f"bias{k}"], f"layer{k}", transB=1)
        values = graph.node(_UNITS[network.activation], [sums], f"units{k}")
    graph.node("Gemm", [values, f"weight{last}", f"bias{last}"], output, transB=1)


def _between(graph: Graph, network: Network, output: str) -> None:
    """Add the layers, and the mean of the most likely choice and of the more likely of its neighbors."""
    assert isinstance(network, BetweenMLP)
    _mlp(graph, network, "scores")
    pads = graph.constant("pads", np.array([0, 0, 0, 1]))
    none = graph.constant("none", np.array(-np.inf))
    scores = graph.node("Pad", ["scores", pads, none], "padded")
    best = graph.node("ArgMax", [scores], "best", axis=1, keepdims=1)
    commands = graph.constant("commands", network.commands)

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


# Kind of network -> function that adds its nodes, from "observation" to the name of the output.
GRAPHS: dict[str, Callable[[Graph, Network, str], None]] = {MLP.kind: _mlp, BetweenMLP.kind: _between}


def to_onnx(found: LearnedPolicy | LearnedController) -> "ModelProto":
    """Return the ``onnx.ModelProto`` of a policy or controller; its metadata describe inputs and outputs.

    Raises
    ------
    ValueError
        If the kind of network has no ONNX graph.
    ModuleNotFoundError
        If onnx is not installed.
    """
    with needed_for("export to ONNX", "onnx"):
        import onnx
        import onnx.checker
        import onnx.helper
        import onnx.numpy_helper
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
        low, high = (graph.constant(name, getattr(box, name)) for name in ("low", "high"))
        shaped = graph.node("Reshape", ["mean", target], "shaped")
        graph.node("Min", [graph.node("Max", [shaped, low], "raised"), high], "action")
        outputs = [describe("action", floats, ["N", *shape])]
    inputs = [describe("observation", floats, ["N", network.inputs])]
    body = onnx.helper.make_graph(graph.nodes, found.name.replace("/", "-"), inputs, outputs, graph.constants)
    versions = {"ir_version": _IR_VERSION, "opset_imports": [onnx.helper.make_opsetid("", _OPSET)]}
    model = onnx.helper.make_model(body, producer_name="crowd_env", **versions)
    onnx.helper.set_model_props(model, {key: json.dumps(value) for key, value in metadata_of(found).items()})
    onnx.checker.check_model(model, full_check=True)
    return model


def metadata_of(found: LearnedPolicy | LearnedController) -> Plain:
    """Return the facts of the network's file, the columns of each observation term, and the command of each choice."""
    facts: dict[str, object] = {**found.facts()}
    if isinstance(found, LearnedController):
        return facts
    facts["columns"] = columns_of(found.env_options["observation"])
    if isinstance(found.space, gymnasium.spaces.Discrete):
        commands, ways = found.action_kind.decoded(np.arange(found.space.n))
        facts["commands"] = commands.tolist()
        if ways is not None:
            facts["ways"] = ways.tolist()
    return facts

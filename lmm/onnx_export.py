"""The networks that run as ONNX models, with their normalisation inside, and what their numbers are."""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion import console, files

from .model import RUNTIME, Model
from .network import Network

PathLike = str | os.PathLike[str]
# Old enough for runtimes in use, and all that is needed.
OPSET, IR_VERSION = 17, 8
ENDS = {"decompressor": ("state", "pose"), "stepper": ("state", "rate"), "projector": ("query", "state")}

JOINTS = "every joint but the first, the ground root, in its parent's frame"
POSE = {
    "positions": f"{JOINTS}: x, y, z",
    "rotations": f"{JOINTS}: the rotation matrix's first two columns, row by row; make them orthonormal",
    "velocities": f"{JOINTS}: x, y, z",
    "angular_velocities": f"{JOINTS}: x, y, z",
    "root_velocity": "the root, in its own space: x, y, z",
    "root_angular_velocity": "the root, in its own space: x, y, z",
    "contacts": "on the ground where above 0.5",
}


def outputs(directory: PathLike) -> list[Path]:
    """The files that `export_directory` writes into a folder."""
    return [Path(directory, f"{name}.onnx") for name in RUNTIME]


@console.needs("export", "onnx")
def export_directory(model: Model, directory: PathLike) -> list[Path]:
    """Write the three networks into a folder; returns the files' paths. Where one cannot be written, none is.

    Their metadata says, as JSON, what the numbers are that go in and come out (`describe`).
    """
    paths, about = outputs(directory), describe(model)
    with contextlib.ExitStack() as together:
        for path in paths:
            stream = together.enter_context(files.atomic(path))
            made = to_onnx(getattr(model, path.stem), path.stem, *ENDS[path.stem], metadata=about)
            stream.write(made.SerializeToString(deterministic=True))
            stream.flush()
    return paths


@console.needs("export", "onnx")
def to_onnx(
    network: Network, name: str, inputs: str, outputs: str, *, metadata: dict[str, Any] | None = None
) -> Any:
    """A network as an ONNX model of float32 [batch, I] to float32 [batch, O].

    float16 and int8 weights stay what they are in the file, and are cast, or multiplied by their scales,
    where they are used: all sums are of float32, as `Network.evaluate` has them.
    """
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    nodes: list[Any] = []
    constants: list[Any] = []

    def constant(name: str, array: NDArray) -> str:
        constants.append(numpy_helper.from_array(np.ascontiguousarray(array), name))
        return name

    def node(kind: str, result: str, *arguments: str, **attributes: Any) -> str:
        nodes.append(helper.make_node(kind, arguments, [result], result, **attributes))
        return result

    def weight(layer: int) -> str:
        stored, scale = network.weights[layer], network.scales[layer]
        values = constant(f"weight_{layer}", stored)
        if stored.dtype != np.float32:
            values = node("Cast", f"cast_{layer}", values, to=TensorProto.FLOAT)
        if scale is not None:  # DequantizeLinear would let a runtime round the layer's inputs to int8 too
            values = node("Mul", f"scaled_{layer}", values, constant(f"scale_{layer}", scale))
        return values

    x = node("Sub", "centred", inputs, constant("input_mean", network.input_mean))
    x = node("Div", "normalised", x, constant("input_std", network.input_std))
    for layer, bias in enumerate(network.biases):
        if layer:
            x = node("Relu" if network.activation == "relu" else "Elu", f"activated_{layer}", x)
        x = node("Gemm", f"layer_{layer}", x, weight(layer), constant(f"bias_{layer}", bias))
    x = node("Mul", "spread", x, constant("output_std", network.output_std))
    node("Add", outputs, x, constant("output_mean", network.output_mean))

    ends = [
        helper.make_tensor_value_info(end, TensorProto.FLOAT, ["batch", width])
        for end, width in ((inputs, network.sizes[0]), (outputs, network.sizes[-1]))
    ]
    graph = helper.make_graph(nodes, name, ends[:1], ends[1:], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    texts = {key: json.dumps(value, ensure_ascii=False) for key, value in (metadata or {}).items()}
    helper.set_model_props(model, texts)
    onnx.checker.check_model(model, full_check=True)
    return model


def describe(model: Model) -> dict[str, Any]:
    """What a program needs to know to run the three networks, JSON-able."""
    mine, schema, layout = model.description, model.description.schema, model.layout
    state = [*schema.columns, *(f"latent_{i}" for i in range(model.L))]
    return {
        "about": "Learned Motion Matching. A query or a state holds features, (raw - offset) / scale each. "
        "The projector answers a query by a state; state + rate / fps is the next frame's; the decompressor "
        "makes a state a pose. Metres, seconds, radians, right-handed, y up, facing +z.",
        "fps": mine.fps,
        "joints": list(mine.skeleton.names),
        "parents": mine.skeleton.parents.tolist(),
        "contacts": list(mine.contact_roles),
        "schema": schema.to_dict(),
        "offset": mine.offset.tolist(),
        "scale": mine.scale.tolist(),
        "state": state,
        "query": state[: model.F] + ["crouch: 1 if asked for, else 0"] * bool(mine.crouch_tag),
        "pose": [
            {"what": name, "start": part.start, "stop": part.stop, "of": POSE[name]}
            for name, part in layout.slices.items()
        ],
        "fingerprint": model.fingerprint,
    }

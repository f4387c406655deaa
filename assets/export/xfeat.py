#!/usr/bin/env python3
"""Converts the official XFeat checkpoint to the ONNX file that OSTRA loads.

    pip install torch onnx
    python3 xfeat.py xfeat.pt OUT       # xfeat.onnx
    ostra models add xfeat OUT/xfeat.onnx

The checkpoint is `weights/xfeat.pt` of https://github.com/verlab/accelerated_features. The graph is written node by node,
because traced exports fix the size of the image, or bake it into the normalisation. Batch normalisation is folded into the
convolutions. The layers that refine matches (`fine_matcher`) are left out: OSTRA does not use them.

Potje, Cadar, Araujo, Martins, Nascimento: "XFeat: Accelerated Features for Lightweight Image Matching", CVPR 2024.

    --random SEED   use seeded random weights instead of a checkpoint, for tests
    --parameters    only print the name and shape of every parameter
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

# Channels, kernel and stride of the layers of each block. A layer is a convolution without bias, batch normalisation
# and ReLU.
BLOCKS = {
    "block1": (1, [(4, 3, 1), (8, 3, 2), (8, 3, 1), (24, 3, 2)]),
    "block2": (24, [(24, 3, 1), (24, 3, 1)]),
    "block3": (24, [(64, 3, 2), (64, 3, 1), (64, 1, 1)]),
    "block4": (64, [(64, 3, 2), (64, 3, 1), (64, 3, 1)]),
    "block5": (64, [(128, 3, 2), (128, 3, 1), (128, 3, 1), (64, 1, 1)]),
    "block_fusion": (64, [(64, 3, 1), (64, 3, 1)]),
    "heatmap_head": (64, [(64, 1, 1), (64, 1, 1)]),
    "keypoint_head": (64, [(64, 1, 1), (64, 1, 1), (64, 1, 1)]),
}
# Convolutions with bias, all of kernel 1: output and input channels.
LAST = {
    "skip1.1": (24, 1),
    "block_fusion.2": (64, 64),
    "heatmap_head.2": (1, 64),
    "keypoint_head.3": (65, 64),
}
# Of batch and instance normalisation in PyTorch.
EPSILON = 1e-5
# The keypoint head sees the image in cells of 8 × 8 pixels, one channel for each pixel.
CELL = 8


def parameters():
    """Returns the shape of every parameter that is used, by its name in the official checkpoint."""
    shapes = {}
    for block, (before, layers) in BLOCKS.items():
        for number, (channels, kernel, _) in enumerate(layers):
            name = f"{block}.{number}.layer"
            shapes[f"{name}.0.weight"] = (channels, before, kernel, kernel)
            shapes[f"{name}.1.running_mean"] = shapes[f"{name}.1.running_var"] = (channels,)
            before = channels
    for name, (channels, before) in LAST.items():
        shapes[f"{name}.weight"], shapes[f"{name}.bias"] = (channels, before, 1, 1), (channels,)
    return shapes


class Graph:
    """Collects the nodes and weights of the network."""

    def __init__(self, values):
        self.values, self.nodes, self.weights = values, [], []

    def weight(self, name, value):
        self.weights.append(numpy_helper.from_array(np.ascontiguousarray(value, np.float32), name))
        return name

    def add(self, kind, *inputs, to, **attributes):
        self.nodes.append(helper.make_node(kind, list(inputs), [to], name=to, **attributes))
        return to

    def convolve(self, before, name, weight, bias, stride=1, to=None):
        kernel = weight.shape[-1]
        inputs = before, self.weight(f"{name}.weight", weight), self.weight(f"{name}.bias", bias)
        return self.add("Conv", *inputs, to=to or name, kernel_shape=[kernel] * 2, strides=[stride] * 2, pads=[kernel // 2] * 4)

    def block(self, before, block):
        for number, (_, _, stride) in enumerate(BLOCKS[block][1]):
            name = f"{block}.{number}"
            weight, mean, variance = (
                self.values[f"{name}.layer.{of}"] for of in ("0.weight", "1.running_mean", "1.running_var")
            )
            scale = 1 / np.sqrt(variance + EPSILON)
            weight, bias = weight * scale[:, None, None, None], -mean * scale
            before = self.add("Relu", self.convolve(before, name, weight, bias, stride), to=f"{name}.relu")
        return before

    def last(self, before, name, to=None):
        return self.convolve(before, name, self.values[f"{name}.weight"], self.values[f"{name}.bias"], to=to)

    def enlarge(self, before, times, to):
        scales = self.weight(f"{to}.scales", [1, 1, times, times])
        return self.add("Resize", before, "", scales, to=to, mode="linear", coordinate_transformation_mode="half_pixel")


def network(values):
    """Builds the network for grey images whose sides are multiples of 32."""
    g = Graph(values)
    one, zero = g.weight("norm.scale", [1]), g.weight("norm.bias", [0])
    image = g.add("InstanceNormalization", "input", one, zero, to="norm", epsilon=EPSILON)
    shrunk = g.add("AveragePool", image, to="skip1.0", kernel_shape=[4, 4], strides=[4, 4])
    found = g.add("Add", g.block(image, "block1"), g.last(shrunk, "skip1.1"), to="skip1")
    third = g.block(g.block(found, "block2"), "block3")
    fourth = g.block(third, "block4")
    fifth = g.block(fourth, "block5")
    pyramid = g.add("Add", third, g.enlarge(fourth, 2, "fourth"), to="pyramid.0")
    pyramid = g.add("Add", pyramid, g.enlarge(fifth, 4, "fifth"), to="pyramid.1")
    features = g.last(g.block(pyramid, "block_fusion"), "block_fusion.2", to="output_feats")
    heat = g.last(g.block(features, "heatmap_head"), "heatmap_head.2")
    g.add("Sigmoid", heat, to="output_heatmap")
    cells = g.add("SpaceToDepth", image, to="cells", blocksize=CELL)
    g.last(g.block(cells, "keypoint_head"), "keypoint_head.3", to="output_keypoints")
    port = lambda name, channels, *size: helper.make_tensor_value_info(  # noqa: E731
        name, TensorProto.FLOAT, [1, channels, *size]
    )
    outputs = [("output_feats", 64), ("output_keypoints", CELL * CELL + 1), ("output_heatmap", 1)]
    graph = helper.make_graph(
        g.nodes,
        "xfeat",
        [port("input", 1, "height", "width")],
        [port(name, channels, "rows", "columns") for name, channels in outputs],
        g.weights,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model, full_check=True)
    return model


def random_values(seed):
    source = np.random.default_rng(seed)
    values = {}
    for name, shape in parameters().items():
        value = source.standard_normal(shape)
        if name.endswith("running_var"):
            value = 0.5 + np.abs(value)
        elif name.endswith("weight"):
            value *= np.sqrt(2 / np.prod(shape[1:]))
        values[name] = value
    return values


def checkpoint_values(path):
    import torch

    stored = torch.load(path, map_location="cpu", weights_only=True)
    values = {}
    for name, shape in parameters().items():
        if name not in stored or tuple(stored[name].shape) != shape:
            sys.exit(f"{path}: has no parameter `{name}` of shape {shape}")
        values[name] = stored[name].double().numpy()
    return values


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path, nargs="?")
    parser.add_argument("out", type=Path, nargs="?")
    parser.add_argument("--random", type=int, metavar="SEED")
    parser.add_argument("--parameters", action="store_true")
    asked = parser.parse_args()
    if asked.parameters:
        for name, shape in sorted(parameters().items()):
            print(name, *shape)
        return
    if asked.random is not None:
        # The only positional argument is the output folder.
        asked.checkpoint, asked.out = None, asked.out or asked.checkpoint
    if asked.out is None:
        parser.error("a checkpoint and an output folder are required")
    values = random_values(asked.random) if asked.checkpoint is None else checkpoint_values(asked.checkpoint)
    asked.out.mkdir(parents=True, exist_ok=True)
    path = asked.out / "xfeat.onnx"
    onnx.save(network(values), path)
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()

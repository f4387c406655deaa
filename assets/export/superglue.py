#!/usr/bin/env python3
"""Exports an official SuperPoint or SuperGlue checkpoint to the ONNX file that OSTRA loads.

    pip install torch onnx
    python3 superglue.py superpoint_v1.pth     OUT       # superpoint.onnx
    python3 superglue.py superglue_indoor.pth  OUT --network superglue-indoor
    python3 superglue.py superglue_outdoor.pth OUT --network superglue-outdoor
    ostra models add superpoint OUT/superpoint.onnx
    ostra models add superglue-outdoor OUT/superglue-outdoor.onnx

Parameters have the same names here as in the official checkpoints. A checkpoint must contain all of them. OSTRA itself
runs the steps without weights: keypoint selection, descriptor interpolation and optimal transport.

DeTone, Malisiewicz, Rabinovich: "SuperPoint: Self-Supervised Interest Point Detection and Description", CVPRW 2018.
Sarlin, DeTone, Malisiewicz, Rabinovich: "SuperGlue: Learning Feature Matching with Graph Neural Networks", CVPR 2020.
Both checkpoints may be used for non-commercial research only.

    --size tiny --random SEED   use a small network with seeded random weights instead of a checkpoint, for tests
    --parameters                only print the name and shape of every parameter
"""

import argparse
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import nn
from torch.nn import functional as F


@dataclass(frozen=True)
class Size:
    """Widths of the two networks."""

    # Channels of the four blocks of SuperPoint, and of its two heads.
    blocks: tuple
    head: int
    # Channels of a descriptor, and of SuperGlue.
    descriptor: int
    # Channels of the layers that encode the position and score of a keypoint.
    keypoint: tuple
    heads: int
    # Rounds of attention, first within each image and then between the two images.
    rounds: int


SIZES = {
    "official": Size((64, 64, 128, 128), 256, 256, (32, 64, 128, 256), 4, 9),
    "tiny": Size((8, 8, 12, 16), 24, 16, (8, 12), 2, 2),
}
# One score for each pixel of an 8 × 8 cell, and one for "no keypoint".
CHANNELS = 65


class SuperPoint(nn.Module):
    """Computes keypoint logits [1, 65, H/8, W/8] and descriptors [1, D, H/8, W/8].

    The input is a grey image [1, 1, H, W] with values from 0 to 1. H and W must be multiples of 8.
    """

    def __init__(self, size):
        super().__init__()
        before = 1
        for number, width in enumerate(size.blocks, 1):
            self.add_module(f"conv{number}a", nn.Conv2d(before, width, 3, padding=1))
            self.add_module(f"conv{number}b", nn.Conv2d(width, width, 3, padding=1))
            before = width
        self.blocks = len(size.blocks)
        self.convPa = nn.Conv2d(before, size.head, 3, padding=1)
        self.convPb = nn.Conv2d(size.head, CHANNELS, 1)
        self.convDa = nn.Conv2d(before, size.head, 3, padding=1)
        self.convDb = nn.Conv2d(size.head, size.descriptor, 1)

    def forward(self, image):
        found = image
        for number in range(1, self.blocks + 1):
            if number > 1:
                found = F.max_pool2d(found, 2)
            for part in "ab":
                found = F.relu(self.get_submodule(f"conv{number}{part}")(found))
        logits = self.convPb(F.relu(self.convPa(found)))
        return logits, self.convDb(F.relu(self.convDa(found)))


def perceptron(widths):
    """Returns layers that process every keypoint separately."""
    layers = []
    for before, after in zip(widths, widths[1:]):
        layers += [nn.Conv1d(before, after, 1), nn.BatchNorm1d(after), nn.ReLU()]
    return nn.Sequential(*layers[:-2])


class KeypointEncoder(nn.Module):
    def __init__(self, size):
        super().__init__()
        self.encoder = perceptron([3, *size.keypoint, size.descriptor])

    def forward(self, keypoints, scores):
        return self.encoder(torch.cat([keypoints.transpose(1, 2), scores[:, None]], 1))


class Attention(nn.Module):
    """Attention whose heads have interleaved channels."""

    def __init__(self, size):
        super().__init__()
        width = size.descriptor
        self.heads, self.each = size.heads, width // size.heads
        self.merge = nn.Conv1d(width, width, 1)
        self.proj = nn.ModuleList(nn.Conv1d(width, width, 1) for _ in range(3))

    def split(self, projected):
        return projected.view(1, self.each, self.heads, -1).permute(0, 2, 3, 1)

    def forward(self, asking, asked):
        query, key, value = (self.split(layer(given)) for layer, given in zip(self.proj, (asking, asked, asked)))
        weights = F.softmax(query @ key.transpose(2, 3) / self.each**0.5, -1)
        read = (weights @ value).permute(0, 3, 1, 2)
        return self.merge(read.reshape(1, self.each * self.heads, -1))


class Propagation(nn.Module):
    def __init__(self, size):
        super().__init__()
        self.attn = Attention(size)
        self.mlp = perceptron([2 * size.descriptor, 2 * size.descriptor, size.descriptor])

    def forward(self, asking, asked):
        return asking + self.mlp(torch.cat([asking, self.attn(asking, asked)], 1))


class Layers(nn.Module):
    def __init__(self, size):
        super().__init__()
        self.layers = nn.ModuleList(Propagation(size) for _ in range(2 * size.rounds))

    def forward(self, first, second):
        for within, between in zip(self.layers[::2], self.layers[1::2]):
            first, second = within(first, first), within(second, second)
            first, second = between(first, second), between(second, first)
        return first, second


class SuperGlue(nn.Module):
    """Computes the agreement [1, N, M] of the keypoints of two images.

    Inputs are keypoints [1, N, 2], scores [1, N] and descriptors [1, N, D] of both images. Keypoints are normalised:
    (pixel − size / 2) / (0.7 · longer side). The second output [1] is the least agreement of two partners.
    """

    def __init__(self, size):
        super().__init__()
        self.bin_score = nn.Parameter(torch.ones(()))
        self.kenc = KeypointEncoder(size)
        self.gnn = Layers(size)
        self.final_proj = nn.Conv1d(size.descriptor, size.descriptor, 1)
        self.scale = size.descriptor**-0.5

    def forward(self, keypoints0, scores0, descriptors0, keypoints1, scores1, descriptors1):
        first = descriptors0.transpose(1, 2) + self.kenc(keypoints0, scores0)
        second = descriptors1.transpose(1, 2) + self.kenc(keypoints1, scores1)
        first, second = (self.final_proj(given) for given in self.gnn(first, second))
        return first.transpose(1, 2) @ second * self.scale, self.bin_score[None]


def build(network, size):
    return SuperPoint(size) if network == "superpoint" else SuperGlue(size)


def randomise(model, seed):
    """Draws random weights under which the outputs vary across an image."""
    generator = torch.Generator().manual_seed(seed)
    for module in model.modules():
        if isinstance(module, (nn.Conv1d, nn.Conv2d)):
            inputs = module.weight[0].numel()
            module.weight.data.normal_(0, (2 / inputs) ** 0.5, generator=generator)
            module.bias.data.normal_(0, 0.1, generator=generator)
        elif isinstance(module, nn.BatchNorm1d):
            module.running_mean.normal_(0, 0.2, generator=generator)
            module.running_var.uniform_(0.5, 2, generator=generator)
            module.weight.data.uniform_(0.5, 1.5, generator=generator)
            module.bias.data.normal_(0, 0.1, generator=generator)


def export(model, network, size, path):
    if network == "superpoint":
        given = {"image": torch.rand(1, 1, 64, 96)}
        outputs = {"logits": {2: "rows", 3: "columns"}, "descriptors": {2: "rows", 3: "columns"}}
        free = {"image": {2: "height", 3: "width"}} | outputs
    else:
        given, outputs = {}, {"agreement": {1: "first", 2: "second"}, "alone": {}}
        for picture, count in ((0, 7), (1, 5)):
            given |= {
                f"keypoints{picture}": torch.rand(1, count, 2) - 0.5,
                f"scores{picture}": torch.rand(1, count),
                f"descriptors{picture}": torch.rand(1, count, size.descriptor),
            }
        free = {name: {1: "first" if name.endswith("0") else "second"} for name in given} | outputs
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # sizes that tracing treats as constants are constant
        torch.onnx.export(
            model.eval(),
            tuple(given.values()),
            path,
            input_names=list(given),
            output_names=list(outputs),
            dynamic_axes=free,
            opset_version=17,
            dynamo=False,
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path, nargs="?")
    parser.add_argument("out", type=Path, nargs="?")
    parser.add_argument(
        "--network", choices=["superpoint", "superglue-indoor", "superglue-outdoor"], default="superpoint"
    )
    parser.add_argument("--size", choices=SIZES, default="official")
    parser.add_argument("--random", type=int, metavar="SEED")
    parser.add_argument("--parameters", action="store_true")
    asked = parser.parse_args()
    size = SIZES[asked.size]
    model = build(asked.network, size)
    if asked.parameters:
        for name, value in model.state_dict().items():
            print(name, *value.shape)
        return
    if asked.random is not None:
        # The only positional argument is the output folder.
        asked.checkpoint, asked.out = None, asked.out or asked.checkpoint
        randomise(model, asked.random)
    if asked.out is None:
        parser.error("a checkpoint and an output folder are required")
    if asked.checkpoint is not None:
        try:
            model.load_state_dict(torch.load(asked.checkpoint, map_location="cpu", weights_only=True))
        except (RuntimeError, OSError) as error:
            sys.exit(f"{asked.checkpoint}: {error}")
    asked.out.mkdir(parents=True, exist_ok=True)
    path = asked.out / f"{asked.network}.onnx"
    with torch.no_grad():
        export(model, asked.network, size, path)
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()

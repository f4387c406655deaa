#!/usr/bin/env python3
"""Exports DeAOT-L with ResNet-50 to the four ONNX files that `ostra models add deaot` takes.

    pip install torch onnx
    python3 assets/export/deaot.py R50_DeAOTL_PRE_YTB_DAV.pth OUT
    ostra models add deaot ENCODER REMEMBER PROPAGATE IDENTIFY

The script writes four files to OUT:

    deaot-encoder.onnx     computes features from an image
    deaot-remember.onnx    computes a memory from the features and object mask of an image
    deaot-propagate.onnx   computes logits at a quarter of the image size from features and memories
    deaot-identify.onnx    computes the object identities to remember for a propagated image

Use the official checkpoint of https://github.com/yoxu515/aot-benchmark. Parameters have the same names here as in the
checkpoint. The checkpoint must contain all of them.

    --size l|tiny       network to export; tiny is for tests
    --random SEED       use random weights instead of a checkpoint, for timing
    --parameters        only print the name and shape of every parameter

Yang, Yang: "Decoupling Features in Hierarchical Propagation for Video Object Segmentation", NeurIPS 2022.
Yang, Wei, Yang: "Associating Objects with Transformers for Video Object Segmentation", NeurIPS 2021.
"""

import argparse
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import torch
import torch.nn.functional as F
from gated_propagation import Propagation, grid, tokens
from resnet import EXPANSION, ResNet
from torch import nn

OBJECTS = 10  # number of objects that one run can distinguish
STRIDE = 16
DRAWN = (80, 96)  # height and width of the image for tracing, less one pixel; multiples of STRIDE


@dataclass(frozen=True)
class Size:
    """Widths of a network."""

    name: str  # prefix of the file names
    width: int  # channels of the encoder's first convolution
    blocks: tuple[int, ...]  # number of blocks in each encoder stage
    channels: int  # channels of each branch
    layers: int  # number of propagation layers

    @property
    def key(self):
        return self.channels // 2

    @property
    def seen(self):
        """Returns the channels of the encoder's features, finest first."""
        return [EXPANSION * self.width * 2**at for at in range(3)]


SIZES = {
    "l": Size("deaot", 64, (3, 4, 6), 256, 3),
    "tiny": Size("deaot-tiny", 8, (1, 1, 1), 16, 3),
}


class ConvNorm(nn.Module):
    def __init__(self, channels, out, kernel):
        super().__init__()
        self.conv = nn.Conv2d(channels, out, kernel, padding=kernel // 2)
        self.gn = nn.GroupNorm(8, out)

    def forward(self, x):
        return F.relu(self.gn(self.conv(x)))


class Decoder(nn.Module):
    """Decodes tokens and encoder features into logits [1, 11, height / 4, width / 4]."""

    def __init__(self, size):
        super().__init__()
        channels, half = size.channels, size.channels // 2
        fine, middle, coarse = size.seen
        self.conv_in = ConvNorm(2 * channels, channels, 1)
        self.conv_16x = ConvNorm(channels, channels, 3)
        self.conv_8x = ConvNorm(channels, half, 3)
        self.conv_4x = ConvNorm(half, half, 3)
        self.adapter_16x = nn.Conv2d(coarse, channels, 1)
        self.adapter_8x = nn.Conv2d(middle, channels, 1)
        self.adapter_4x = nn.Conv2d(fine, half, 1)
        self.conv_out = nn.Conv2d(half, OBJECTS + 1, 1)

    def forward(self, x, fine, middle, coarse):
        x = self.conv_16x(self.adapter_16x(coarse) + self.conv_in(x))
        x = self.conv_8x(self.adapter_8x(middle) + enlarged(x, middle))
        x = self.conv_4x(self.adapter_4x(fine) + enlarged(x, fine))
        return self.conv_out(x)


def enlarged(x, like):
    return F.interpolate(x, like.shape[2:], mode="bilinear", align_corners=True)


class DeAot(nn.Module):
    def __init__(self, size):
        super().__init__()
        self.encoder = ResNet(size.width, size.blocks)
        self.encoder_projector = nn.Conv2d(size.seen[-1], size.channels, 1)
        self.LSTT = Propagation(size)
        self.decoder = Decoder(size)
        self.patch_wise_id_bank = nn.Conv2d(OBJECTS + 1, size.channels, STRIDE + 1, STRIDE, STRIDE // 2)
        self.id_norm = nn.LayerNorm(size.channels)

    def ids(self, mask):
        """Returns the embedding [cells, channels] of the objects that cover each cell."""
        return self.id_norm(tokens(self.patch_wise_id_bank(mask)))


class Encoder(nn.Module):
    """Computes features, finest first, from an image [1, 3, height, width].

    Height and width must be a multiple of 16 plus one.
    """

    def __init__(self, model):
        super().__init__()
        self.encoder, self.projector = model.encoder, model.encoder_projector

    def forward(self, image):
        fine, middle, coarse = self.encoder(image)
        return fine, middle, coarse, self.projector(coarse)


class Remember(nn.Module):
    """Computes the memory of an image from its embedding and object mask.

    The mask [1, 11, height, width] holds zeros and ones. Its first channel is the background.
    """

    def __init__(self, model):
        super().__init__()
        self.model = model

    def forward(self, embedding, mask):
        ids, kept = self.model.ids(mask), []

        def own(layer):
            def memory(key, value, trace):
                kept.append((key, value, layer.identity(trace, ids)))
                return kept[-1], kept[-1]

            return memory

        self.model.LSTT(embedding, [own(layer) for layer in self.model.LSTT.layers])
        return [part for of_layer in kept for part in of_layer]


class Propagate(nn.Module):
    """Computes the object logits of an image, and its keys, values and traces.

    `Identify` completes the memory from the traces.
    """

    def __init__(self, model):
        super().__init__()
        self.model = model

    def forward(self, fine, middle, coarse, embedding, *memories):
        layers = len(self.model.LSTT.layers)
        long, short = (memories[start : start + 3 * layers] for start in (0, 3 * layers))

        def given(at):
            pair = long[3 * at : 3 * at + 3], short[3 * at : 3 * at + 3]
            return lambda key, value, trace: pair

        x, kept = self.model.LSTT(embedding, [given(at) for at in range(layers)])
        logits = self.model.decoder(grid(x, embedding.shape[2:]), fine, middle, coarse)
        return logits, *(part for of_layer in kept for part in of_layer if part is not None)


class Identify(nn.Module):
    """Computes the identities to remember from the mask of an image and the traces of its propagation."""

    def __init__(self, model):
        super().__init__()
        self.model = model

    def forward(self, mask, *traces):
        ids = self.model.ids(mask)
        return [layer.identity(trace, ids) for layer, trace in zip(self.model.LSTT.layers, (None, *traces), strict=True)]


def randomise(model, seed):
    """Draws random weights under which every part affects the output."""
    draw = torch.Generator().manual_seed(seed)
    for name, value in model.state_dict().items():
        drawn = torch.randn(value.shape, generator=draw)
        if value.ndim == 1:
            # Norm weights and variances lie around one, biases around zero.
            drawn = drawn.clamp(-3, 3) * 0.1 + name.endswith(("weight", "running_var"))
        else:
            drawn = drawn * value[0].numel() ** -0.5
        value.copy_(drawn)


def layered(layers, *parts):
    return [f"{part}_{at}" for at in range(layers) for part in parts]


def export(model, size, folder):
    """Writes the files and returns their paths."""
    height, width = (side + 1 for side in DRAWN)
    cells = (height // STRIDE + 1, width // STRIDE + 1)
    paths = [folder / f"{size.name}-{part}.onnx" for part in ("encoder", "remember", "propagate", "identify")]
    seen = ["fine", "middle", "coarse", "embedding"]
    free = {name: {2: f"{name}_rows", 3: f"{name}_columns"} for name in ("image", "mask", "logits", *seen)}
    image = torch.randn(1, 3, height, width)
    features = Encoder(model)(image)
    write(Encoder(model), (image,), paths[0], ["image"], seen, free)
    mask = F.one_hot(torch.randint(0, OBJECTS + 1, (1, height, width)), OBJECTS + 1).permute(0, 3, 1, 2).float()
    memory = layered(size.layers, "key", "value", "identity")
    tokens_free = {name: {0: "cells"} for name in memory}
    write(Remember(model), (features[-1], mask), paths[1], ["embedding", "mask"], memory, free | tokens_free)
    kept = Remember(model)(features[-1], mask)
    long, short = ([f"{term}_{name}" for name in memory] for term in ("long", "short"))
    left = [name for name in layered(size.layers, "key", "value", "trace") if name != "trace_0"]
    free |= {name: {0: "cells"} for name in (*short, *left)} | {name: {0: "remembered"} for name in long}
    given = (*features, *(torch.cat([part, part]) for part in kept), *kept)
    write(Propagate(model), given, paths[2], [*seen, *long, *short], ["logits", *left], free)
    traces = [name for name in left if name.startswith("trace")]
    given = (mask, *(torch.randn(cells[0] * cells[1], size.channels) for _ in traces))
    identities = layered(size.layers, "identity")
    write(Identify(model), given, paths[3], ["mask", *traces], identities, free | tokens_free)
    return paths


def write(model, given, path, inputs, outputs, free):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # values that tracing treats as constants are constant
        torch.onnx.export(
            model.eval(),
            given,
            path,
            input_names=inputs,
            output_names=outputs,
            dynamic_axes={name: axes for name, axes in free.items() if name in (*inputs, *outputs)},
            opset_version=17,
            dynamo=False,
        )


def parameters(path):
    """Returns the parameters of a checkpoint that the official training wrote."""
    state = torch.load(path, map_location="cpu", weights_only=True)
    state = state.get("state_dict", state)
    return {name.removeprefix("module."): value for name, value in state.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path, nargs="?")
    parser.add_argument("out", type=Path, nargs="?")
    parser.add_argument("--size", choices=SIZES, default="l")
    parser.add_argument("--random", type=int, metavar="SEED")
    parser.add_argument("--parameters", action="store_true")
    asked = parser.parse_args()
    size = SIZES[asked.size]
    model = DeAot(size)
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
            model.load_state_dict(parameters(asked.checkpoint))
        except (RuntimeError, OSError) as error:
            sys.exit(f"{asked.checkpoint}: {error}")
    asked.out.mkdir(parents=True, exist_ok=True)
    with torch.no_grad():
        for path in export(model, size, asked.out):
            print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Exports XMem to the three ONNX files that `ostra models add xmem` takes.

    pip install torch onnx
    python3 assets/export/xmem.py XMem-s012.pth OUT
    ostra models add xmem OUT/xmem-key-encoder.onnx OUT/xmem-value-encoder.onnx OUT/xmem-decoder.onnx

Use the official checkpoint of https://github.com/hkchengrex/XMem. Parameters have the same names here as in the
checkpoint. The checkpoint must contain all of them. The files contain only the networks. OSTRA itself manages the
memory.

    --size full|tiny            network to export; tiny is for tests
    --random SEED               use random weights instead of a checkpoint, for timing
    --parameters                only print the name and shape of every parameter

Cheng, Schwing: "XMem: Long-Term Video Object Segmentation with an Atkinson-Shiffrin Memory Model", ECCV 2022.
Features: He et al.: "Deep Residual Learning for Image Recognition", CVPR 2016.
Attention: Woo et al.: "CBAM: Convolutional Block Attention Module", ECCV 2018.
"""

import argparse
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import nn

CELL = 16  # side of a memory cell, in pixels
SHRUNK = 16  # reduction factor of the inner layer of channel attention
SEEN = 7  # kernel side of spatial attention, in cells


@dataclass(frozen=True)
class Size:
    """Widths of the networks."""

    name: str  # prefix of the file names
    width: int  # channels of the first features
    key: int
    value: int
    hidden: int
    picture_blocks: tuple[int, int, int]  # number of blocks in the stages of the key encoder
    mask_blocks: tuple[int, int, int]  # number of blocks in the stages of the value encoder

    @property
    def f4(self):
        return 4 * self.width

    @property
    def f8(self):
        return 8 * self.width

    @property
    def f16(self):
        return 16 * self.width

    @property
    def fused(self):
        """Returns the channels of the fused features in the decoder."""
        return 8 * self.width


SIZES = {
    "full": Size("xmem", 64, 64, 512, 64, (3, 4, 6), (2, 2, 2)),
    "tiny": Size("xmem-tiny", 4, 8, 32, 8, (1, 1, 1), (1, 1, 1)),
}


class Residual(nn.Module):
    """A residual block of two 3 × 3 convolutions.

    A `deep` block has one 3 × 3 convolution between two of 1 × 1. Its output has four times the width.
    """

    def __init__(self, inside, width, stride, deep):
        super().__init__()
        out = 4 * width if deep else width
        shapes = [(1, 1), (3, stride), (1, 1)] if deep else [(3, stride), (3, 1)]
        widths = [inside, width, width, out] if deep else [inside, width, out]
        for at, (side, step) in enumerate(shapes):
            conv = nn.Conv2d(widths[at], widths[at + 1], side, step, side // 2, bias=False)
            setattr(self, f"conv{at + 1}", conv)
            setattr(self, f"bn{at + 1}", nn.BatchNorm2d(widths[at + 1]))
        self.count = len(shapes)
        self.downsample = None
        if stride != 1 or inside != out:
            self.downsample = nn.Sequential(nn.Conv2d(inside, out, 1, stride, bias=False), nn.BatchNorm2d(out))

    def forward(self, x):
        y = x
        for at in range(1, self.count + 1):
            y = getattr(self, f"bn{at}")(getattr(self, f"conv{at}")(y))
            y = F.relu(y) if at < self.count else y
        return F.relu(y + (x if self.downsample is None else self.downsample(x)))


def stage(inside, width, blocks, stride, deep):
    out = 4 * width if deep else width
    first = Residual(inside, width, stride, deep)
    return nn.Sequential(first, *(Residual(out, width, 1, deep) for _ in range(blocks - 1)))


class KeyEncoder(nn.Module):
    """Computes features of an image at a 16th, an 8th and a 4th of its size."""

    def __init__(self, size):
        super().__init__()
        width, blocks = size.width, size.picture_blocks
        self.conv1 = nn.Conv2d(3, width, 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        self.res2 = stage(width, width, blocks[0], 1, True)
        self.layer2 = stage(size.f4, 2 * width, blocks[1], 2, True)
        self.layer3 = stage(size.f8, 4 * width, blocks[2], 2, True)

    def forward(self, image):
        x = F.max_pool2d(F.relu(self.bn1(self.conv1(image))), 3, 2, 1)
        f4 = self.res2(x)
        f8 = self.layer2(f4)
        return self.layer3(f8), f8, f4


class KeyProjection(nn.Module):
    """Projects features to keys, shrinkage and selection.

    The shrinkage (at least 1) says how narrowly a key matches. The selection (0 to 1) weighs the channels of a key.
    """

    def __init__(self, size):
        super().__init__()
        self.key_proj = nn.Conv2d(size.f16, size.key, 3, padding=1)
        self.d_proj = nn.Conv2d(size.f16, 1, 3, padding=1)
        self.e_proj = nn.Conv2d(size.f16, size.key, 3, padding=1)

    def forward(self, f16):
        return self.key_proj(f16), self.d_proj(f16) ** 2 + 1, self.e_proj(f16).sigmoid()


class ConvBlock(nn.Module):
    """A residual block without norms."""

    def __init__(self, inside, out):
        super().__init__()
        self.downsample = None if inside == out else nn.Conv2d(inside, out, 3, padding=1)
        self.conv1 = nn.Conv2d(inside, out, 3, padding=1)
        self.conv2 = nn.Conv2d(out, out, 3, padding=1)

    def forward(self, x):
        y = self.conv2(F.relu(self.conv1(F.relu(x))))
        return y + (x if self.downsample is None else self.downsample(x))

    def of_both(self, shared, count, own):
        """Applies the block to `count` features shared by all objects [1, …] and the features of each [objects, …].

        The shared part of both convolutions is computed once for all objects.
        """
        y = self.conv2(F.relu(both(self.conv1, F.relu(shared), count, F.relu(own))))
        return y + both(self.downsample, shared, count, own)


def both(conv, shared, count, own):
    once = F.conv2d(shared, conv.weight[:, :count], conv.bias, padding=1)
    return once + F.conv2d(own, conv.weight[:, count:], padding=1)


class ChannelGate(nn.Module):
    def __init__(self, width):
        super().__init__()
        inner = width // SHRUNK
        self.mlp = nn.Sequential(nn.Identity(), nn.Linear(width, inner), nn.ReLU(), nn.Linear(inner, width))

    def forward(self, x):
        scale = self.mlp(x.mean((2, 3))) + self.mlp(x.amax((2, 3)))
        return x * scale.sigmoid()[:, :, None, None]


class Spatial(nn.Module):
    def __init__(self):
        super().__init__()
        self.conv = nn.Conv2d(2, 1, SEEN, padding=SEEN // 2)


class SpatialGate(nn.Module):
    def __init__(self):
        super().__init__()
        self.spatial = Spatial()

    def forward(self, x):
        pooled = torch.cat([x.amax(1, keepdim=True), x.mean(1, keepdim=True)], 1)
        return x * self.spatial.conv(pooled).sigmoid()


class Attention(nn.Module):
    def __init__(self, width):
        super().__init__()
        self.ChannelGate = ChannelGate(width)
        self.SpatialGate = SpatialGate()

    def forward(self, x):
        return self.SpatialGate(self.ChannelGate(x))


class Fuser(nn.Module):
    """Fuses the features of the image [1, …] with those of each object [objects, …]."""

    def __init__(self, shared, own, out):
        super().__init__()
        self.shared = shared
        self.block1 = ConvBlock(shared + own, out)
        self.attention = Attention(out)
        self.block2 = ConvBlock(out, out)

    def forward(self, shared, own):
        x = self.block1.of_both(shared, self.shared, own)
        return self.block2(x + self.attention(x))


class Gate(nn.Module):
    """The recurrent unit of sensory memory. It mixes old and new values."""

    def __init__(self, inside, hidden):
        super().__init__()
        self.transform = nn.Conv2d(inside + hidden, 3 * hidden, 3, padding=1)

    def renew(self, x, hidden):
        forget, update, new = self.transform(torch.cat([x, hidden], 1)).chunk(3, 1)
        update = update.sigmoid()
        return forget.sigmoid() * hidden * (1 - update) + update * new.tanh()


class ValueEncoder(nn.Module):
    """Computes the value to remember for each object [objects, value, …], and updates its sensory memory."""

    def __init__(self, size):
        super().__init__()
        width, blocks = size.width, size.mask_blocks
        self.conv1 = nn.Conv2d(5, width, 7, 2, 3, bias=False)  # red, green, blue, the object, all others
        self.bn1 = nn.BatchNorm2d(width)
        self.layer1 = stage(width, width, blocks[0], 1, False)
        self.layer2 = stage(width, 2 * width, blocks[1], 2, False)
        self.layer3 = stage(2 * width, 4 * width, blocks[2], 2, False)
        self.fuser = Fuser(size.f16, 4 * width, size.value)
        self.hidden_reinforce = Gate(size.value, size.hidden)

    def forward(self, image, f16, hidden, masks, others):
        seen = torch.cat([image.expand(masks.shape[0], -1, -1, -1), masks, others], 1)
        x = F.max_pool2d(F.relu(self.bn1(self.conv1(seen))), 3, 2, 1)
        value = self.fuser(f16, self.layer3(self.layer2(self.layer1(x))))
        return value, self.hidden_reinforce.renew(value, hidden)


class Upsample(nn.Module):
    def __init__(self, skip, inside, out):
        super().__init__()
        self.skip_conv = nn.Conv2d(skip, inside, 3, padding=1)
        self.out_conv = ConvBlock(inside, out)

    def forward(self, skip, x):
        x = F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)
        return self.out_conv(self.skip_conv(skip) + x)


class HiddenUpdate(Gate):
    """Updates the sensory memory from features of all three sizes. Averaging reduces them to the coarsest size."""

    def __init__(self, size):
        inner = size.f4
        super().__init__(inner, size.hidden)
        self.g16_conv = nn.Conv2d(size.fused, inner, 1)
        self.g8_conv = nn.Conv2d(size.f4, inner, 1)
        self.g4_conv = nn.Conv2d(size.f4 + 1, inner, 1)

    def forward(self, g16, g8, g4, hidden):
        x = self.g16_conv(g16) + self.g8_conv(F.avg_pool2d(g8, 2)) + self.g4_conv(F.avg_pool2d(g4, 4))
        return self.renew(x, hidden)


class Decoder(nn.Module):
    """Decodes the memory readout of each object into logits [objects, 1, height, width].

    The second output is the updated sensory memory.
    """

    def __init__(self, size):
        super().__init__()
        self.fuser = Fuser(size.f16, size.value + size.hidden, size.fused)
        self.hidden_update = HiddenUpdate(size)
        self.up_16_8 = Upsample(size.f8, size.fused, size.f4)
        self.up_8_4 = Upsample(size.f4, size.f4, size.f4)
        self.pred = nn.Conv2d(size.f4, 1, 3, padding=1)

    def forward(self, f16, f8, f4, readout, hidden):
        g16 = self.fuser(f16, torch.cat([readout, hidden], 1))
        g8 = self.up_16_8(f8, g16)
        g4 = self.up_8_4(f4, g8)
        logits = self.pred(F.relu(g4))
        hidden = self.hidden_update(g16, g8, torch.cat([g4, logits], 1), hidden)
        return F.interpolate(logits, scale_factor=4, mode="bilinear", align_corners=False), hidden


class XMem(nn.Module):
    def __init__(self, size):
        super().__init__()
        self.key_encoder = KeyEncoder(size)
        self.key_proj = KeyProjection(size)
        self.value_encoder = ValueEncoder(size)
        self.decoder = Decoder(size)


class PictureEncoder(nn.Module):
    """Computes the key, shrinkage, selection and features of an image [1, 3, height, width]."""

    def __init__(self, xmem):
        super().__init__()
        self.key_encoder, self.key_proj = xmem.key_encoder, xmem.key_proj

    def forward(self, image):
        features = self.key_encoder(image)
        return *self.key_proj(features[0]), *features


def randomise(model, seed):
    """Draws random weights under which values neither vanish nor explode.

    Works for any module with the parameter names of this file.
    """
    draw = torch.Generator().manual_seed(seed)
    for name, value in model.state_dict().items():
        if not value.is_floating_point():
            continue  # number of batches that a norm has seen
        drawn = torch.randn(value.shape, generator=draw)
        if value.ndim == 1:
            # Norm weights and variances lie around one, biases around zero.
            drawn = drawn * 0.1 + (name.endswith("running_var") or ".bn" in name and name.endswith("weight"))
            drawn = drawn + (".downsample.1.weight" in name)
            if name.endswith("bn3.weight") or "value_encoder.layer" in name and name.endswith("bn2.weight"):
                drawn = drawn * 0.3  # last norm of a residual block: keeps sums over many blocks small
        else:
            drawn = drawn * (1.4 * value[0].numel() ** -0.5)
        value.copy_(drawn)


def export(model, size, folder):
    """Writes the three files and returns their paths."""
    paths = [folder / f"{size.name}-{part}.onnx" for part in ("key-encoder", "value-encoder", "decoder")]
    objects, rows, columns = 3, 4, 6

    def zeros(count, channels, scale):
        return torch.zeros(count, channels, rows * scale, columns * scale)

    image, f16 = zeros(1, 3, CELL), zeros(1, size.f16, 1)
    hidden, masks = zeros(objects, size.hidden, 1), zeros(objects, 1, CELL)
    outputs = ["key", "shrinkage", "selection", "f16", "f8", "f4"]
    write(PictureEncoder(model), {"image": image}, paths[0], outputs)
    given = {"image": image, "f16": f16, "hidden": hidden, "masks": masks, "others": masks}
    write(model.value_encoder, given, paths[1], ["value", "new_hidden"])
    given = {
        "f16": f16,
        "f8": zeros(1, size.f8, 2),
        "f4": zeros(1, size.f4, 4),
        "readout": zeros(objects, size.value, 1),
        "hidden": hidden,
    }
    write(model.decoder, given, paths[2], ["logits", "new_hidden"])
    return paths


# Tensors with one entry per object.
OF_OBJECTS = ("hidden", "masks", "others", "readout", "value", "new_hidden", "logits")


def write(model, given, path, outputs):
    free = {name: {2: f"{name}_rows", 3: f"{name}_columns"} for name in [*given, *outputs]}
    for name in free.keys() & OF_OBJECTS:
        free[name][0] = "objects"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter warns that it is deprecated
        torch.onnx.export(
            model.eval(),
            tuple(given.values()),
            path,
            input_names=list(given),
            output_names=outputs,
            dynamic_axes=free,
            opset_version=17,
            dynamo=False,
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path, nargs="?")
    parser.add_argument("out", type=Path, nargs="?")
    parser.add_argument("--size", choices=SIZES, default="full")
    parser.add_argument("--random", type=int, metavar="SEED")
    parser.add_argument("--parameters", action="store_true")
    asked = parser.parse_args()
    size = SIZES[asked.size]
    model = XMem(size)
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
    with torch.no_grad():
        for path in export(model, size, asked.out):
            print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()

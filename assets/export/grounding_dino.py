#!/usr/bin/env python3
"""Exports Grounding DINO to the ONNX file that `ostra models add grounding-dino` takes.

    pip install torch onnx
    python3 assets/export/grounding_dino.py groundingdino_swint_ogc.pth OUT      # OUT/grounding-dino.onnx
    ostra models add grounding-dino OUT/grounding-dino.onnx vocab.txt

Use the official checkpoint of https://github.com/IDEA-Research/GroundingDINO (Swin-T, OGC). `vocab.txt` is the file of
https://huggingface.co/google-bert/bert-base-uncased with 30522 lines. Parameters have the same names here as in the
checkpoint. The checkpoint must contain all of them.

    --size swin-t|tiny    network to export; tiny is for tests
    --random SEED         use random weights instead of a checkpoint, for timing
    --parameters          only print the name and shape of every parameter

Liu et al.: "Grounding DINO: Marrying DINO with Grounded Pre-Training for Open-Set Object Detection", ECCV 2024.
"""

import argparse
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import torch
from bert import Bert
from dino import Mlp, Transformer
from swin import Swin
from torch import nn

GROUPS = 32  # channel groups in the norms of the levels
# Unused entries of the checkpoint: training labels, and the indices of token positions.
UNUSED = ("label_enc.weight", "bert.embeddings.position_ids")


@dataclass(frozen=True)
class Size:
    """Widths of a network."""

    name: str  # file name without the extension
    queries: int
    width: int  # channels of the transformer
    hidden: int
    heads: int
    depth: int  # number of layers in the encoder, and in the decoder
    swin: tuple  # width, depths, heads, window side in cells
    bert: tuple  # width, depth, heads, hidden width, vocabulary size, positions


SIZES = {
    "swin-t": Size(
        "grounding-dino", 900, 256, 2048, 8, 6,
        swin=(96, (2, 2, 6, 2), (3, 6, 12, 24), 7),
        bert=(768, 12, 12, 3072, 30522, 512),
    ),
    "tiny": Size(
        "grounding-tiny", 12, 32, 64, 4, 2,
        swin=(4, (1, 1, 2, 1), (1, 2, 2, 4), 3),
        bert=(16, 2, 2, 32, 53, 40),
    ),
}  # fmt: skip


def level(width_in, width, side):
    """Returns the projection of one level. The coarsest one halves the last backbone features."""
    fold = nn.Conv2d(width_in, width, 3, 2, 1) if side == 3 else nn.Conv2d(width_in, width, 1)
    return nn.Sequential(fold, nn.GroupNorm(GROUPS, width))


class GroundingDino(nn.Module):
    """Detects objects that match the phrases of a caption.

    Inputs are a normalised image [1, 3, height, width] and tokens [1, tokens]. `position_ids` is the position of each
    token in its phrase. `attention_mask` [1, tokens, tokens] is 1 where one token attends to another, else 0.

    Outputs are the logits of every query for every token [1, queries, tokens], and boxes [1, queries, 4]. A box holds
    centre, width and height as shares of the image.
    """

    def __init__(self, size):
        super().__init__()
        box_head = Mlp(size.width, size.width, size.width, 4)
        # All layers share one box head. The checkpoint stores it under two names per layer.
        self.bbox_embed = nn.ModuleList([box_head] * size.depth)
        self.transformer = Transformer(size, self.bbox_embed)
        self.bert = Bert(*size.bert)
        self.feat_map = nn.Linear(size.bert[0], size.width)
        widths = [size.swin[0] << at for at in (1, 2, 3)]
        self.input_proj = nn.ModuleList(level(width, size.width, 1) for width in widths)
        self.input_proj.append(level(widths[-1], size.width, 3))
        self.backbone = nn.ModuleList([Swin(*size.swin)])

    def forward(self, image, input_ids, position_ids, attention_mask):
        barred = (1.0 - attention_mask[:, None].float()) * torch.finfo(torch.float32).min
        tokens = self.feat_map(self.bert(input_ids, position_ids, barred))
        features = self.backbone[0](image)
        features.append(features[-1])
        levels = [fold(feature) for fold, feature in zip(self.input_proj, features)]
        x, boxes, tokens = self.transformer(levels, tokens, position_ids.float(), barred)
        return x @ tokens.transpose(1, 2), boxes[None]


def randomise(model, size, seed):
    """Draws random weights under which every part affects the output."""
    draw = torch.Generator().manual_seed(seed)
    done = set()
    for name, value in model.state_dict().items():
        if not value.is_floating_point() or value.data_ptr() in done:
            continue
        done.add(value.data_ptr())
        drawn = torch.randn(value.shape, generator=draw)
        if value.ndim == 1:
            # Norm weights and residual scales lie around one, biases around zero.
            is_scale = "norm" in name.lower() and name.endswith("weight") or "gamma" in name
            is_scale = is_scale or "input_proj" in name and name.endswith("1.weight")
            drawn = drawn * 0.1 + is_scale
        elif "embed" not in name or "bbox_embed" in name:
            drawn = drawn * value[0].numel() ** -0.5
        if "bbox_embed" in name and "layers.2" in name:
            drawn = drawn * 0.5  # keeps boxes inside the image
        if name.startswith(("transformer.decoder.norm", f"transformer.encoder.text_layers.{size.depth - 1}.norm2")):
            drawn = drawn * size.width**-0.25  # keeps logits around one
        value.copy_(drawn)


def load(model, path):
    """Loads all parameters of a checkpoint into the model."""
    state = torch.load(path, map_location="cpu", weights_only=True)
    state = {name.removeprefix("module."): value for name, value in state.get("model", state).items()}
    model.load_state_dict({name: value for name, value in state.items() if name not in UNUSED})


def export(model, size, folder):
    """Writes the file and returns its path."""
    path = folder / f"{size.name}.onnx"
    given = {
        "image": torch.zeros(1, 3, 416, 608),
        "input_ids": torch.tensor([[2, 5, 3, 2]]),
        "position_ids": torch.tensor([[0, 0, 1, 0]]),
        "attention_mask": torch.tensor([[[1, 0, 0, 0], [0, 1, 1, 0], [0, 1, 1, 0], [0, 0, 0, 1]]]),
    }
    free = {
        "image": {2: "height", 3: "width"},
        "input_ids": {1: "tokens"},
        "position_ids": {1: "tokens"},
        "attention_mask": {1: "tokens", 2: "tokens"},
        "logits": {2: "tokens"},
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # sizes that tracing treats as constants are constant
        torch.onnx.export(
            model.eval(),
            tuple(given.values()),
            path,
            input_names=list(given),
            output_names=["logits", "boxes"],
            dynamic_axes=free,
            opset_version=17,
            dynamo=False,
        )
    return path


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path, nargs="?")
    parser.add_argument("out", type=Path, nargs="?")
    parser.add_argument("--size", choices=SIZES, default="swin-t")
    parser.add_argument("--random", type=int, metavar="SEED")
    parser.add_argument("--parameters", action="store_true")
    asked = parser.parse_args()
    size = SIZES[asked.size]
    model = GroundingDino(size)
    if asked.parameters:
        for name, value in model.state_dict().items():
            print(name, *value.shape)
        return
    with torch.no_grad():
        if asked.random is not None:
            # The only positional argument is the output folder.
            asked.checkpoint, asked.out = None, asked.out or asked.checkpoint
            randomise(model, size, asked.random)
        if asked.out is None:
            parser.error("a checkpoint and an output folder are required")
        if asked.checkpoint is not None:
            try:
                load(model, asked.checkpoint)
            except (RuntimeError, OSError) as error:
                sys.exit(f"{asked.checkpoint}: {error}")
        asked.out.mkdir(parents=True, exist_ok=True)
        path = export(model, size, asked.out)
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()

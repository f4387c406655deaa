#!/usr/bin/env python3
"""Exports Segment Anything to the two ONNX files that `ostra models add sam-vit-b` takes.

    pip install torch onnx
    python3 assets/export/sam.py sam_vit_b_01ec64.pth OUT
    ostra models add sam-vit-b OUT/sam-vit-b-encoder.onnx OUT/sam-vit-b-decoder.onnx

    # MobileSAM: OUT/mobile-sam-encoder.onnx, OUT/mobile-sam-decoder.onnx
    python3 assets/export/sam.py mobile_sam.pt OUT --size mobile

Use the official checkpoints of https://github.com/facebookresearch/segment-anything and
https://github.com/ChaoningZhang/MobileSAM. Parameters have the same names here as in the checkpoints. A checkpoint must
contain all of them.

    --size vit-b|mobile|tiny    network to export; tiny is for tests
    --random SEED               use random weights instead of a checkpoint, for timing
    --parameters                only print the name and shape of every parameter

Kirillov et al.: "Segment Anything", ICCV 2023. Image encoder: Li, Mao, Girshick, He: "Exploring Plain Vision
Transformer Backbones for Object Detection", ECCV 2022.
"""

import argparse
import math
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import torch
import torch.nn.functional as F
from tiny_vit import WIDTHS, TinyVit
from torch import nn

PATCH = 16
MASK_TOKENS = 4  # one for clear prompts, three for ambiguous ones
DECODER_HEADS = 8
DECODER_DEPTH = 2
MASK_CHANNELS = 16


@dataclass(frozen=True)
class Size:
    """Widths of a network."""

    name: str  # prefix of the file names
    side: int  # side of the encoder's square input, in pixels
    channels: int  # channels of the embedding
    mlp: int  # hidden width of the decoder's layers
    score: int  # hidden width of the head that predicts the IoU
    width: int = 0  # channels of the encoder; 0 selects the encoder of MobileSAM
    depth: int = 0
    heads: int = 0
    whole: tuple[int, ...] = ()  # blocks with attention to the whole image; the others use windows
    window: int = 0  # cells

    @property
    def cells(self):
        return self.side // PATCH


SIZES = {
    "vit-b": Size("sam-vit-b", 1024, 256, 2048, 256, width=768, depth=12, heads=12, whole=(2, 5, 8, 11), window=14),
    "mobile": Size("mobile-sam", 1024, 256, 2048, 256),
    "tiny": Size("sam-tiny", 256, 32, 64, 32, width=32, depth=2, heads=2, whole=(1,), window=14),
}


class ChannelNorm(nn.Module):
    """Normalises over the channels of each cell."""

    def __init__(self, channels):
        super().__init__()
        self.weight = nn.Parameter(torch.ones(channels))
        self.bias = nn.Parameter(torch.zeros(channels))

    def forward(self, x):
        x = x.permute(0, 2, 3, 1)
        return F.layer_norm(x, self.weight.shape, self.weight, self.bias, 1e-6).permute(0, 3, 1, 2)


class Mlp(nn.Module):
    def __init__(self, width, hidden, act):
        super().__init__()
        self.lin1 = nn.Linear(width, hidden)
        self.lin2 = nn.Linear(hidden, width)
        self.act = act

    def forward(self, x):
        return self.lin2(self.act(self.lin1(x)))


class CellAttention(nn.Module):
    """Attention among the cells of a square, with learned biases for the distance in rows and in columns."""

    def __init__(self, width, heads, cells):
        super().__init__()
        self.heads, self.cells = heads, cells
        self.qkv = nn.Linear(width, 3 * width)
        self.proj = nn.Linear(width, width)
        self.rel_pos_h = nn.Parameter(torch.zeros(2 * cells - 1, width // heads))
        self.rel_pos_w = nn.Parameter(torch.zeros(2 * cells - 1, width // heads))

    def forward(self, x):
        squares, n, _, width = x.shape
        head = width // self.heads
        qkv = self.qkv(x).reshape(squares, n * n, 3, self.heads, head).permute(2, 3, 0, 1, 4)
        apart = torch.arange(n)[:, None] - torch.arange(n)[None, :] + n - 1
        rows, columns = self.rel_pos_h[apart], self.rel_pos_w[apart]  # [from, to, head]
        # One head at a time, because all scores at once would be by far the largest tensor.
        heads = range(self.heads)
        out = [self.one_head(qkv[0, at], qkv[1, at], qkv[2, at], rows, columns) for at in heads]
        return self.proj(torch.cat(out, -1).reshape(squares, n, n, width))

    def one_head(self, q, k, v, rows, columns):
        squares, n = q.shape[0], self.cells
        grid = q.reshape(squares, n, n, -1)
        by_row = (grid @ rows.transpose(1, 2)).reshape(squares, n * n, n, 1)
        by_column = (grid.transpose(1, 2) @ columns.transpose(1, 2)).transpose(1, 2).reshape(squares, n * n, 1, n)
        scores = ((q * q.shape[-1] ** -0.5) @ k.transpose(1, 2)).reshape(squares, n * n, n, n)
        scores = (scores + by_row + by_column).reshape(squares, n * n, n * n)
        return scores.softmax(-1) @ v


class EncoderBlock(nn.Module):
    def __init__(self, size, is_whole):
        super().__init__()
        self.cells, self.window = size.cells, 0 if is_whole else size.window
        self.norm1 = nn.LayerNorm(size.width, eps=1e-6)
        self.attn = CellAttention(size.width, size.heads, size.cells if is_whole else size.window)
        self.norm2 = nn.LayerNorm(size.width, eps=1e-6)
        self.mlp = Mlp(size.width, 4 * size.width, F.gelu)

    def forward(self, x):
        near = self.norm1(x)
        near = self.in_windows(near) if self.window else self.attn(near)
        x = x + near
        return x + self.mlp(self.norm2(x))

    def in_windows(self, x):
        """Applies attention in windows. Zeros pad the last windows."""
        n, w, width = self.cells, self.window, x.shape[-1]
        count = -(-n // w)
        x = F.pad(x, (0, 0, 0, count * w - n, 0, count * w - n))
        x = x.reshape(count, w, count, w, width).transpose(1, 2).reshape(count * count, w, w, width)
        x = self.attn(x).reshape(count, count, w, w, width).transpose(1, 2)
        return x.reshape(1, count * w, count * w, width)[:, :n, :n]


class PatchEmbed(nn.Module):
    def __init__(self, width):
        super().__init__()
        self.proj = nn.Conv2d(3, width, PATCH, PATCH)

    def forward(self, x):
        return self.proj(x).permute(0, 2, 3, 1)


def neck(width, channels):
    return nn.Sequential(
        nn.Conv2d(width, channels, 1, bias=False),
        ChannelNorm(channels),
        nn.Conv2d(channels, channels, 3, padding=1, bias=False),
        ChannelNorm(channels),
    )


class ImageEncoder(nn.Module):
    """Computes the embedding [1, channels, cells, cells] of an image [1, 3, side, side]."""

    def __init__(self, size):
        super().__init__()
        self.patch_embed = PatchEmbed(size.width)
        self.pos_embed = nn.Parameter(torch.zeros(1, size.cells, size.cells, size.width))
        self.blocks = nn.ModuleList(EncoderBlock(size, at in size.whole) for at in range(size.depth))
        self.neck = neck(size.width, size.channels)

    def forward(self, image):
        x = self.patch_embed(image) + self.pos_embed
        for block in self.blocks:
            x = block(x)
        return self.neck(x.permute(0, 3, 1, 2))


class Waves(nn.Module):
    """Encodes positions between 0 and 1 as sines and cosines of random frequencies."""

    def __init__(self, channels):
        super().__init__()
        self.register_buffer("positional_encoding_gaussian_matrix", torch.randn(2, channels // 2))

    def forward(self, places):
        angles = 2 * math.pi * ((2 * places - 1) @ self.positional_encoding_gaussian_matrix)
        return torch.cat([angles.sin(), angles.cos()], -1)


class PromptEncoder(nn.Module):
    def __init__(self, size):
        super().__init__()
        self.side, self.cells = size.side, size.cells
        self.pe_layer = Waves(size.channels)
        # Embeddings of exclude clicks, include clicks, and the upper left and lower right corners of boxes.
        self.point_embeddings = nn.ModuleList(nn.Embedding(1, size.channels) for _ in range(4))
        self.not_a_point_embed = nn.Embedding(1, size.channels)
        self.mask_downscaling = nn.Sequential(
            nn.Conv2d(1, MASK_CHANNELS // 4, 2, 2),
            ChannelNorm(MASK_CHANNELS // 4),
            nn.GELU(),
            nn.Conv2d(MASK_CHANNELS // 4, MASK_CHANNELS, 2, 2),
            ChannelNorm(MASK_CHANNELS),
            nn.GELU(),
            nn.Conv2d(MASK_CHANNELS, size.channels, 1),
        )
        self.no_mask_embed = nn.Embedding(1, size.channels)

    def points(self, coords, labels):
        kinds = labels[..., None]
        tokens = self.pe_layer((coords + 0.5) / self.side) * (kinds != -1)
        tokens = tokens + self.not_a_point_embed.weight * (kinds == -1)
        for kind, embedding in enumerate(self.point_embeddings):
            tokens = tokens + embedding.weight * (kinds == kind)
        return tokens

    def mask(self, mask, is_given):
        nothing = self.no_mask_embed.weight[:, :, None, None]
        return is_given * self.mask_downscaling(mask) + (1 - is_given) * nothing

    def grid(self):
        """Returns the position encoding of every cell of the embedding, [1, cells · cells, channels]."""
        middles = (torch.arange(self.cells) + 0.5) / self.cells
        rows, columns = torch.meshgrid(middles, middles, indexing="ij")
        return self.pe_layer(torch.stack([columns, rows], -1)).reshape(1, self.cells**2, -1)


class Attention(nn.Module):
    """Attention with the inner width `width // shrink`."""

    def __init__(self, width, shrink=1):
        super().__init__()
        inner = width // shrink
        self.q_proj, self.k_proj, self.v_proj = (nn.Linear(width, inner) for _ in range(3))
        self.out_proj = nn.Linear(inner, width)

    def forward(self, q, k, v):
        q, k, v = (self.split(part) for part in (self.q_proj(q), self.k_proj(k), self.v_proj(v)))
        scores = (q @ k.transpose(-1, -2)) * q.shape[-1] ** -0.5
        return self.out_proj((scores.softmax(-1) @ v).transpose(1, 2).flatten(2))

    @staticmethod
    def split(x):
        return x.unflatten(-1, (DECODER_HEADS, -1)).transpose(1, 2)


class DecoderLayer(nn.Module):
    def __init__(self, size, is_first):
        super().__init__()
        self.is_first = is_first
        self.self_attn = Attention(size.channels)
        self.norm1 = nn.LayerNorm(size.channels)
        self.cross_attn_token_to_image = Attention(size.channels, 2)
        self.norm2 = nn.LayerNorm(size.channels)
        self.mlp = Mlp(size.channels, size.mlp, F.relu)
        self.norm3 = nn.LayerNorm(size.channels)
        self.cross_attn_image_to_token = Attention(size.channels, 2)
        self.norm4 = nn.LayerNorm(size.channels)

    def forward(self, tokens, cells, token_places, cell_places):
        if self.is_first:
            tokens = self.self_attn(tokens, tokens, tokens)
        else:
            placed = tokens + token_places
            tokens = tokens + self.self_attn(placed, placed, tokens)
        tokens = self.norm1(tokens)
        seen = self.cross_attn_token_to_image(tokens + token_places, cells + cell_places, cells)
        tokens = self.norm2(tokens + seen)
        tokens = self.norm3(tokens + self.mlp(tokens))
        told = self.cross_attn_image_to_token(cells + cell_places, tokens + token_places, tokens)
        return tokens, self.norm4(cells + told)


class TwoWayTransformer(nn.Module):
    def __init__(self, size):
        super().__init__()
        self.layers = nn.ModuleList(DecoderLayer(size, at == 0) for at in range(DECODER_DEPTH))
        self.final_attn_token_to_image = Attention(size.channels, 2)
        self.norm_final_attn = nn.LayerNorm(size.channels)

    def forward(self, token_places, cells, cell_places):
        tokens = token_places
        for layer in self.layers:
            tokens, cells = layer(tokens, cells, token_places, cell_places)
        seen = self.final_attn_token_to_image(tokens + token_places, cells + cell_places, cells)
        return self.norm_final_attn(tokens + seen), cells


class Head(nn.Module):
    """Three linear layers."""

    def __init__(self, width, hidden, out):
        super().__init__()
        self.layers = nn.ModuleList([nn.Linear(width, hidden), nn.Linear(hidden, hidden), nn.Linear(hidden, out)])

    def forward(self, x):
        first, second, last = self.layers
        return last(F.relu(second(F.relu(first(x)))))


class MaskDecoder(nn.Module):
    def __init__(self, size):
        super().__init__()
        width = size.channels
        self.cells = size.cells
        self.transformer = TwoWayTransformer(size)
        self.iou_token = nn.Embedding(1, width)
        self.mask_tokens = nn.Embedding(MASK_TOKENS, width)
        self.output_upscaling = nn.Sequential(
            nn.ConvTranspose2d(width, width // 4, 2, 2),
            ChannelNorm(width // 4),
            nn.GELU(),
            nn.ConvTranspose2d(width // 4, width // 8, 2, 2),
            nn.GELU(),
        )
        self.output_hypernetworks_mlps = nn.ModuleList(Head(width, width, width // 8) for _ in range(MASK_TOKENS))
        self.iou_prediction_head = Head(width, size.score, MASK_TOKENS)

    def forward(self, embedding, cell_places, sparse, dense):
        """Returns mask logits [1, 4, 4 · cells, 4 · cells] and the predicted IoU of each mask."""
        own = torch.cat([self.iou_token.weight, self.mask_tokens.weight])[None]
        cells = (embedding + dense).flatten(2).transpose(1, 2)
        tokens, cells = self.transformer(torch.cat([own, sparse], 1), cells, cell_places)
        cells = cells.transpose(1, 2).unflatten(2, (self.cells, self.cells))
        fine = self.output_upscaling(cells)
        heads = enumerate(self.output_hypernetworks_mlps)
        weights = torch.stack([head(tokens[:, 1 + at]) for at, head in heads], 1)
        masks = (weights @ fine.flatten(2)).unflatten(2, fine.shape[2:])
        return masks, self.iou_prediction_head(tokens[:, 0])


class Sam(nn.Module):
    def __init__(self, size):
        super().__init__()
        self.image_encoder = ImageEncoder(size) if size.width else TinyVit(neck(WIDTHS[-1], size.channels))
        self.prompt_encoder = PromptEncoder(size)
        self.mask_decoder = MaskDecoder(size)


class PromptedDecoder(nn.Module):
    """Computes masks from an embedding and prompts, with the inputs and outputs of the official export."""

    def __init__(self, sam, size):
        super().__init__()
        self.prompt_encoder, self.mask_decoder, self.side = sam.prompt_encoder, sam.mask_decoder, size.side

    def forward(self, image_embeddings, point_coords, point_labels, mask_input, has_mask_input, orig_im_size):
        sparse = self.prompt_encoder.points(point_coords, point_labels)
        dense = self.prompt_encoder.mask(mask_input, has_mask_input)
        low, scores = self.mask_decoder(image_embeddings, self.prompt_encoder.grid(), sparse, dense)
        return self.at_size(low, orig_im_size), scores, low

    def at_size(self, low, size):
        """Returns masks at the size of the image, without the padding."""
        shown = (size * (self.side / size.max()) + 0.5).floor().to(torch.int64)
        size = size.to(torch.int64)
        masks = F.interpolate(low, (self.side, self.side), mode="bilinear", align_corners=False)
        masks = masks[:, :, : shown[0], : shown[1]]
        return F.interpolate(masks, (size[0], size[1]), mode="bilinear", align_corners=False)


def randomise(model, seed):
    """Draws random weights under which every part affects the output."""
    draw = torch.Generator().manual_seed(seed)
    for name, value in model.state_dict().items():
        if not value.is_floating_point():
            continue  # number of batches that a norm has seen
        drawn = torch.randn(value.shape, generator=draw)
        if value.ndim == 1:
            # Norm weights and variances lie around one, biases around zero.
            drawn = drawn * 0.1 + name.endswith(("weight", "running_var"))
        elif value.shape[0] > 4 or value.ndim == 4 and value.shape[0] > 1:
            drawn = drawn * value[0].numel() ** -0.5
        value.copy_(drawn)


def export(model, size, folder):
    """Writes both files and returns their paths."""
    encoder, decoder = (folder / f"{size.name}-{part}.onnx" for part in ("encoder", "decoder"))
    image = torch.zeros(1, 3, size.side, size.side)
    write(model.image_encoder, (image,), encoder, ["image"], ["image_embeddings"], {})
    fine = 4 * size.cells
    given = {
        "image_embeddings": torch.zeros(1, size.channels, size.cells, size.cells),
        "point_coords": torch.rand(1, 3, 2) * size.side,
        "point_labels": torch.tensor([[1.0, 0.0, -1.0]]),
        "mask_input": torch.zeros(1, 1, fine, fine),
        "has_mask_input": torch.ones(1),
        "orig_im_size": torch.tensor([600.0, 800.0]),
    }
    outputs = ["masks", "iou_predictions", "low_res_masks"]
    free = {"point_coords": {1: "points"}, "point_labels": {1: "points"}, "masks": {2: "height", 3: "width"}}
    write(PromptedDecoder(model, size), tuple(given.values()), decoder, list(given), outputs, free)
    return encoder, decoder


def write(model, given, path, inputs, outputs, free):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # sizes that tracing treats as constants are constant
        torch.onnx.export(
            model.eval(),
            given,
            path,
            input_names=inputs,
            output_names=outputs,
            dynamic_axes=free,
            opset_version=17,
            dynamo=False,
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path, nargs="?")
    parser.add_argument("out", type=Path, nargs="?")
    parser.add_argument("--size", choices=SIZES, default="vit-b")
    parser.add_argument("--random", type=int, metavar="SEED")
    parser.add_argument("--parameters", action="store_true")
    asked = parser.parse_args()
    size = SIZES[asked.size]
    model = Sam(size)
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

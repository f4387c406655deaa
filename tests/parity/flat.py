#!/usr/bin/env python3
"""Writes small networks with the interface of Segment Anything that segment flat colours, to test prompts.

    pip install torch onnx
    python3 tests/parity/flat.py tests/parity/sam-flat
    python3 tests/parity/flat.py tests/parity/efficient-sam-flat --efficient

The embedding is the mean colour of each cell. The answer is all cells within the box that have the mean colour of the
include clicks. Without include clicks, it is the colour at the centre of the box. An earlier answer is added. Cells
with the colour of an exclude click are removed. Clicks on two colours at once therefore find neither.

Networks with the interface of EfficientSAM take no exclude clicks. They return three masks. The first covers the
colours of the include clicks, or everything inside a box that is not grey. It scores 0.7 for clicks and 0.95 for a box.
The other two masks cover the whole image, and score 0.9 and 0.5.
"""

import argparse
import warnings
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import nn

SIDE, CELLS = 256, 16
CELL = SIDE // CELLS


class Encoder(nn.Module):
    def forward(self, image):
        return F.avg_pool2d(image, CELL)


class Decoder(nn.Module):
    def forward(self, embedding, coords, labels, mask, has_mask, size):
        colours = embedding.flatten(2).transpose(1, 2)  # [1, cells, 3]
        middles = torch.arange(CELLS) * CELL + (CELL - 1) / 2
        rows, columns = torch.meshgrid(middles, middles, indexing="ij")
        places = torch.stack([columns, rows], -1).reshape(1, 1, -1, 2)
        include, first, last = ((labels == kind).float()[..., None] for kind in (1, 2, 3))
        is_boxed, is_clicked = last.sum(), include.sum().clamp(max=1)
        lower, upper = (coords * first).sum(1), (coords * last).sum(1)
        at = torch.cat([coords, ((lower + upper) / 2)[:, None]], 1)
        weight = torch.cat([include, ((1 - is_clicked) * is_boxed).reshape(1, 1, 1)], 1)
        near = ((places - at[:, :, None]).abs() <= CELL / 2).all(-1).float()  # [1, points, cells]
        seen = (near @ colours) / near.sum(-1, keepdim=True).clamp(min=1)
        meant = (seen * weight).sum(1, keepdim=True) / weight.sum(1, keepdim=True).clamp(min=1)
        alike = 1 - 10 * (colours - meant).square().sum(-1)
        outside = ((places[:, 0] < lower[:, None]) | (places[:, 0] > upper[:, None])).any(-1).float()
        alike = alike - 100 * outside * is_boxed - 100 * (1 - weight.sum().clamp(max=1))
        earlier = F.avg_pool2d(mask, mask.shape[-1] // CELLS).flatten(1)
        alike = torch.where(has_mask > 0, torch.maximum(alike, earlier), alike)
        unlike = 10 * (colours[:, None] - seen[:, :-1, None]).square().sum(-1) - 1  # [1, points, cells]
        unlike = unlike + 1000 * (labels != 0).float()[..., None]
        low = torch.minimum(alike, unlike.amin(1)).unflatten(1, (CELLS, CELLS))[:, None]
        low = 8 * F.interpolate(low.clamp(-1, 1), scale_factor=4.0, mode="nearest")
        masks = torch.cat([low, low * 0 - 1, low, low * 0 + 1], 1)
        return F.interpolate(masks, (16, 16)) + 0 * size.sum(), low.sum() * 0 + torch.tensor([[0.5, 0.6, 0.95, 0.7]]), masks


class EfficientEncoder(nn.Module):
    def forward(self, images):
        return F.interpolate(images, (CELLS, CELLS), mode="bilinear")


class EfficientDecoder(nn.Module):
    def forward(self, embedding, coords, labels, size):
        height, width = size[0], size[1]
        colours = embedding.flatten(2).transpose(1, 2)  # [1, cells, 3]
        middles = (torch.arange(CELLS) + 0.5) / CELLS
        rows, columns = torch.meshgrid(middles, middles, indexing="ij")
        places = torch.stack([columns, rows], -1).reshape(1, 1, -1, 2)
        at = (coords[0] + 0.5) / torch.stack([width, height])
        include, first, last = ((labels[0] == kind).float()[..., None] for kind in (1, 2, 3))
        near = ((places - at[:, :, None]).abs() <= 0.5 / CELLS).all(-1).float()
        seen = (near @ colours) / near.sum(-1, keepdim=True).clamp(min=1)
        unlike = (colours[:, None] - seen[:, :, None]).square().sum(-1) + 100 * (1 - include)
        lower, upper = (at * first).sum(1), (at * last).sum(1)
        inside = ((places[:, 0] >= lower[:, None]) & (places[:, 0] <= upper[:, None])).all(-1).float()
        coloured = (colours.amax(-1) - colours.amin(-1) > 0.1).float()
        boxed = last.sum()
        thing = torch.where(boxed > 0, inside * coloured, (unlike.amin(1) < 0.01).float())
        low = torch.stack([thing, thing * 0 + 1, thing * 0 + 1], 1).unflatten(2, (CELLS, CELLS))
        masks = F.interpolate(16 * low - 8, scale_factor=4.0, mode="nearest")
        scores = torch.stack([0.7 + 0.25 * boxed, 0.9 + 0 * boxed, 0.5 + 0 * boxed]).reshape(1, 1, 3)
        return F.interpolate(masks, (height, width), mode="bilinear")[:, None], scores


def efficient(out, export):
    points = {2: "num_points"}
    names = ["image_embeddings", "batched_point_coords", "batched_point_labels", "orig_im_size"]
    given = (torch.zeros(1, 3, CELLS, CELLS), torch.zeros(1, 1, 3, 2), torch.ones(1, 1, 3), torch.tensor([64, 64]))
    torch.onnx.export(
        EfficientEncoder(),
        (torch.zeros(1, 3, 80, 112),),
        out / "encoder.onnx",
        input_names=["batched_images"],
        output_names=["image_embeddings"],
        dynamic_axes={"batched_images": {2: "height", 3: "width"}},
        **export,
    )
    torch.onnx.export(
        EfficientDecoder(),
        given,
        out / "decoder.onnx",
        input_names=names,
        output_names=["output_masks", "iou_predictions"],
        dynamic_axes={names[1]: points, names[2]: points},
        **export,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--efficient", action="store_true")
    asked = parser.parse_args()
    out = asked.out
    out.mkdir(parents=True, exist_ok=True)
    given = {
        "image_embeddings": torch.zeros(1, 3, CELLS, CELLS),
        "point_coords": torch.zeros(1, 3, 2),
        "point_labels": torch.tensor([[1.0, 0.0, -1.0]]),
        "mask_input": torch.zeros(1, 1, 4 * CELLS, 4 * CELLS),
        "has_mask_input": torch.zeros(1),
        "orig_im_size": torch.tensor([16.0, 16.0]),
    }
    outputs = ["masks", "iou_predictions", "low_res_masks"]
    free = {"point_coords": {1: "points"}, "point_labels": {1: "points"}}
    export = {"opset_version": 17, "dynamo": False}
    image = torch.zeros(1, 3, SIDE, SIDE)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if asked.efficient:
            efficient(out, export)
            return
        torch.onnx.export(
            Encoder(), (image,), out / "encoder.onnx", input_names=["image"], output_names=["image_embeddings"], **export
        )
        torch.onnx.export(
            Decoder(),
            tuple(given.values()),
            out / "decoder.onnx",
            input_names=list(given),
            output_names=outputs,
            dynamic_axes=free,
            **export,
        )


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Compares EfficientSAM in OSTRA with the official code, using the same random weights.

    git clone https://github.com/yformer/EfficientSAM OFFICIAL
    pip install torch onnx onnxscript pillow
    python3 tests/parity/efficient_sam.py OFFICIAL OUT [--size tiny|vitt] [--frames FOLDER] [--seed S]
                                          [--fault bgr|shift] [--no-test]

The script builds the official network with seeded weights. It exports the network with the official wrappers, like the
official script. It runs the PyTorch network on images and prompts, and writes the results to OUT. Finally the test of
the crate runs the exported networks on the same images, and compares every tensor.

Without FOLDER the script uses two synthetic images. `--fault` puts a fault into the reference, and the test must then
fail. `tests/parity/efficient-sam-tiny` is OUT of `--size tiny`.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from pictures import half_a_pixel, pictures
from references import COVERED, DRAWS, put_frames

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "assets" / "export"))
import sam as exporter  # noqa: E402

# Side of the square input; width, depth and heads of the encoder; width of all later parts; width of the decoder's MLP.
SIZES = {"tiny": (256, 32, 2, 2, 32, 64), "vitt": (1024, 192, 12, 3, 256, 2048)}


def reference(official, size):
    """Returns the official network at one of our sizes. With `vitt` it equals `build_efficient_sam_vitt`."""
    sys.path.insert(0, str(official))
    from efficient_sam.efficient_sam import EfficientSam, ImageEncoderViT, MaskDecoder, PromptEncoder
    from efficient_sam.efficient_sam import TwoWayTransformer

    side, width, depth, heads, channels, mlp = SIZES[size]
    act, norm = torch.nn.GELU, "layer_norm"
    encoder = ImageEncoderViT(side, 16, 3, width, norm, depth, heads, 4.0, [channels, channels], act)
    cells = encoder.image_embedding_size
    decoder = MaskDecoder(
        transformer_dim=channels,
        transformer=TwoWayTransformer(2, channels, 8, mlp, act, False),
        num_multimask_outputs=3,
        activation=act,
        normalization_type=norm,
        normalize_before_activation=False,
        iou_head_depth=2,
        iou_head_hidden_dim=channels,
        upscaling_layer_dims=[channels // 4, channels // 8],
    )
    prompts = PromptEncoder(channels, (cells, cells), (side, side))
    return EfficientSam(encoder, prompts, 6, decoder).eval()


def prompts(width, height):
    """Returns include clicks and boxes in pixels. Coordinates count from the centre of the first pixel."""
    at = lambda x, y: [int(x * width), int(y * height), 1]  # noqa: E731
    box = [int(0.2 * width), int(0.3 * height), int(0.7 * width), int(0.8 * height)]
    many = [at(0.1 * k + 0.1, 0.3 + 0.05 * (k % 3)) for k in range(8)]
    return [
        {"clicks": [at(0.31, 0.42)], "boxes": []},
        {"clicks": [at(0.31, 0.42), at(0.6, 0.7)], "boxes": []},
        {"clicks": [], "boxes": [box]},
        {"clicks": [at(0.4, 0.5)], "boxes": [box]},
        {"clicks": many, "boxes": []},
    ]


class Asked:
    """The embedding of one image, and the answers to prompts on it."""

    def __init__(self, model, picture, fault):
        shown = np.asarray(picture)
        if fault == "bgr":
            shown = shown[:, :, ::-1]
        if fault == "shift":
            shown = half_a_pixel(shown)
        tensor = torch.from_numpy(shown.transpose(2, 0, 1).astype(np.float32) / 255.0)[None]
        self.model, self.size, self.embedding = model, picture.size, model.get_image_embeddings(tensor)

    def answers(self):
        return [self.answer(prompt) for prompt in prompts(*self.size)]

    def answer(self, prompt):
        width, height = self.size
        corners = [[*box[2 * k : 2 * k + 2], 2 + k] for box in prompt["boxes"] for k in (0, 1)]
        # The network uses six points: the corners and the latest clicks.
        told = corners + prompt["clicks"][-(6 - len(corners)) :]
        told = torch.tensor(told, dtype=torch.float32)[None, None]
        masks, scores = self.model.predict_masks(
            self.embedding, told[..., :2], told[..., 2], multimask_output=True, input_h=height, input_w=width
        )
        masks, scores = masks[0, 0], scores[0, 0]
        large = torch.nn.functional.interpolate(masks[None], (height, width), mode="bilinear")[0]
        cells, side = masks.shape[-1], self.model.image_encoder.img_size
        # The cell of a click. The network adds half a pixel after it scales a click to the square.
        cell = lambda at, size: int((at * side / size + 0.5) * cells / side)  # noqa: E731
        clicked = [(cell(y, height), cell(x, width)) for x, y, _ in prompt["clicks"]]
        inside = [sum(bool(mask[at] > 0) for at in clicked) for mask in masks]
        best = max(range(len(masks)), key=lambda k: (inside[k], float(scores[k])))
        covers = float((large[best] > 0).float().mean())
        chosen = {"low": masks[best], "logits": large[best], "iou": float(scores[best]), "covers": covers}
        return prompt | {"after": None} | chosen


def build(official, size, seed, shown, fault):
    """Returns the reference with weights under which every mask covers a fair share, and its answers per image."""
    model = reference(official, size)
    exporter.randomise(model, seed)
    of_encoder = {name: value.clone() for name, value in model.state_dict().items() if "image_encoder" in name}
    asked = [Asked(model, picture, fault) for picture in shown]
    for draw in range(DRAWS):
        exporter.randomise(model, seed + draw)
        model.load_state_dict(model.state_dict() | of_encoder)
        answers = [of.answers() for of in asked]
        if all(COVERED[0] <= answer["covers"] <= COVERED[1] for given in answers for answer in given):
            return model, list(zip(asked, answers))
    sys.exit(f"none of {DRAWS} draws gives masks that cover {COVERED[0]:.0%} to {COVERED[1]:.0%}; try another --seed")


def export(model, name, folder):
    """Writes both files, with the official wrappers, names and dynamic axes."""
    import onnx_models

    sizes = {0: "batch", 2: "height", 3: "width"}
    points = {2: "num_points"}
    encoder = onnx_models.OnnxEfficientSamEncoder(model=model)
    image = torch.randn(1, 3, 108, 192)
    cells, channels = model.image_encoder.image_embedding_size, model.image_encoder.transformer_output_dim
    given = (torch.randn(1, channels, cells, cells), torch.rand(1, 1, 5, 2) * 108, torch.ones(1, 1, 5))
    given = (*given, torch.tensor([108, 192]))
    names = ["image_embeddings", "batched_point_coords", "batched_point_labels", "orig_im_size"]
    axes = {names[0]: {0: "batch"}, names[1]: points, names[2]: points}
    common = {"opset_version": 17, "do_constant_folding": True, "dynamo": False}
    torch.onnx.export(
        encoder, (image,), folder / f"{name}-encoder.onnx", input_names=["batched_images"],
        output_names=["image_embeddings"], dynamic_axes={"batched_images": sizes}, **common,
    )  # fmt: skip
    torch.onnx.export(
        onnx_models.OnnxEfficientSamDecoder(model=model), given, folder / f"{name}-decoder.onnx", input_names=names,
        output_names=["output_masks", "iou_predictions"], dynamic_axes=axes, **common,
    )  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("official", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--size", choices=list(SIZES), default="tiny")
    parser.add_argument("--frames", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fault", choices=["bgr", "shift"])
    parser.add_argument("--no-test", action="store_true")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    shown, name = list(pictures(asked.frames)), f"efficient-sam-{asked.size}"
    with torch.no_grad():
        model, given = build(asked.official.resolve(), asked.size, asked.seed, shown, asked.fault)
        put_frames(asked.out, name, shown, given)
        export(model, name, asked.out)
    for of, answers in given:
        print(f"{of.size}: masks cover", ", ".join(f"{answer['covers']:.1%}" for answer in answers))
    if not asked.no_test:
        test = ["cargo", "test", "--release", "--lib", "-p", "ostra-masks", "onnx::sam::tests::parity"]
        test += ["--", "--include-ignored", "--nocapture"]
        environment = os.environ | {"OSTRA_PARITY_EFFICIENT_SAM": str(asked.out.resolve())}
        sys.exit(subprocess.run(test, cwd=ROOT, env=environment).returncode)


if __name__ == "__main__":
    main()

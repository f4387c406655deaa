#!/usr/bin/env python3
"""Compares Segment Anything in OSTRA with the implementation in `transformers`, using the same random weights.

    pip install torch transformers onnx onnxscript pillow
    python3 tests/parity/sam.py OUT [--size tiny|vit-b] [--frames FOLDER] [--seed S] [--fault bgr|shift] [--no-test]

The script builds the reference with seeded weights, and a checkpoint with the official names. It exports the checkpoint
with `assets/export/sam.py`. It runs the reference on images and prompts, and writes the results to OUT. Finally the
test of the crate runs the exported networks on the same images, and compares every tensor.

Without FOLDER the script uses two synthetic images. `--fault` puts a fault into the reference, and the test must then
fail. `tests/parity/sam-tiny` is OUT of `--size tiny`.
"""

import argparse
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import torch
from pictures import half_a_pixel, pictures
from PIL import Image
from references import COVERED, DRAWS, prompts, put_frames, tie
from transformers import SamConfig, SamModel
from transformers.models.sam.image_processing_pil_sam import SamImageProcessorPil

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "assets" / "export"))
import sam as exporter  # noqa: E402


def reference(size):
    """Returns the same network in `transformers`."""
    common = {"image_size": size.side, "patch_size": exporter.PATCH}
    vision = common | {
        "hidden_size": size.width,
        "output_channels": size.channels,
        "num_hidden_layers": size.depth,
        "num_attention_heads": size.heads,
        "mlp_dim": 4 * size.width,
        "window_size": size.window,
        "global_attn_indexes": list(size.whole),
        "num_pos_feats": size.channels // 2,
    }
    prompts = common | {"hidden_size": size.channels}
    decoder = {"hidden_size": size.channels, "mlp_dim": size.mlp, "iou_head_hidden_dim": size.score}
    config = SamConfig(vision_config=vision, prompt_encoder_config=prompts, mask_decoder_config=decoder)
    return SamModel(config).eval()


# Replacements that turn names in `transformers` into those of the official checkpoint.
RENAMED = [
    (r"^vision_encoder\.layers\.", "image_encoder.blocks."),
    (r"^vision_encoder\.", "image_encoder."),
    (r"patch_embed\.projection", "patch_embed.proj"),
    (r"neck\.conv1", "neck.0"),
    (r"neck\.layer_norm1", "neck.1"),
    (r"neck\.conv2", "neck.2"),
    (r"neck\.layer_norm2", "neck.3"),
    (r"^shared_image_embedding\.positional_embedding", "prompt_encoder.pe_layer.positional_encoding_gaussian_matrix"),
    (r"mask_embed\.conv1", "mask_downscaling.0"),
    (r"mask_embed\.layer_norm1", "mask_downscaling.1"),
    (r"mask_embed\.conv2", "mask_downscaling.3"),
    (r"mask_embed\.layer_norm2", "mask_downscaling.4"),
    (r"mask_embed\.conv3", "mask_downscaling.6"),
    (r"\.point_embed\.", ".point_embeddings."),
    (r"layer_norm_final_attn", "norm_final_attn"),
    (r"upscale_conv1", "output_upscaling.0"),
    (r"upscale_layer_norm", "output_upscaling.1"),
    (r"upscale_conv2", "output_upscaling.3"),
    (r"(mlps\.\d+|head)\.layers\.0", r"\1.layers.1"),
    (r"\.proj_in\b", ".layers.0"),
    (r"\.proj_out\b", ".layers.2"),
    (r"layer_norm(\d)", r"norm\1"),
]


def official(state):
    """Returns the weights of the reference under the names of the official checkpoint."""
    named = {}
    for name, value in state.items():
        if name.startswith("prompt_encoder.shared_embedding"):
            continue  # the same tensor as shared_image_embedding
        for pattern, replacement in RENAMED:
            name = re.sub(pattern, replacement, name)
        named[name] = value
    return named


class Asked:
    """The embedding of one image, and the answers to prompts on it."""

    def __init__(self, model, processor, picture, fault):
        shown = picture
        if fault == "bgr":
            shown = Image.fromarray(np.asarray(picture)[:, :, ::-1])
        if fault == "shift":
            shown = Image.fromarray(half_a_pixel(np.asarray(picture)))
        given = processor(images=shown, return_tensors="pt")
        self.model, self.processor, self.size = model, processor, picture.size
        self.reshaped = [int(side) for side in given["reshaped_input_sizes"][0]]
        self.embedding = model.get_image_embeddings(given["pixel_values"])

    def answers(self):
        given = []
        for prompt in prompts(*self.size):
            given.append(self.answer(prompt, given))
        return given

    def answer(self, prompt, before):
        (width, height), (rows, columns) = self.size, self.reshaped
        scale = torch.tensor([columns / width, rows / height])
        asked = {}
        if prompt["clicks"]:
            clicks = torch.tensor(prompt["clicks"], dtype=torch.float32)
            asked["input_points"] = (clicks[:, :2] * scale)[None, None]
            asked["input_labels"] = clicks[:, 2].to(torch.int64)[None, None]
        if prompt["boxes"]:
            boxes = torch.tensor(prompt["boxes"], dtype=torch.float32)
            asked["input_boxes"] = (boxes.reshape(-1, 2, 2) * scale).reshape(1, -1, 4)
        if prompt["after"] is not None:
            asked["input_masks"] = before[prompt["after"]]["low"][None, None]
        many = len(prompt["clicks"]) == 1 and not prompt["boxes"]
        out = self.model(image_embeddings=self.embedding, multimask_output=many, **asked)
        best = int(out.iou_scores[0, 0].argmax())
        low = out.pred_masks[0, :, best : best + 1]
        logits = self.processor.post_process_masks(
            low[None], [[height, width]], [self.reshaped], binarize=False
        )[0]
        chosen = {"low": low[0, 0], "logits": logits[0, 0], "iou": float(out.iou_scores[0, 0, best])}
        return prompt | chosen | {"covers": float((logits > 0).float().mean())}


def build(size, seed, processor, shown, fault):
    """Returns the reference with weights under which every mask covers a fair share, and its answers per image."""
    model = reference(size)
    exporter.randomise(model, seed)
    of_encoder = {name: value.clone() for name, value in model.state_dict().items() if "vision_encoder" in name}
    tie(model)
    asked = [Asked(model, processor, picture, fault) for picture in shown]
    for draw in range(DRAWS):
        exporter.randomise(model, seed + draw)
        model.load_state_dict(model.state_dict() | of_encoder)
        tie(model)
        answers = [of.answers() for of in asked]
        if all(COVERED[0] <= answer["covers"] <= COVERED[1] for given in answers for answer in given):
            return model, list(zip(asked, answers))
    sys.exit(f"none of {DRAWS} draws gives masks that cover {COVERED[0]:.0%} to {COVERED[1]:.0%}; try another --seed")


def check_names():
    """Checks that parameter names and shapes match the official ones, because `load_state_dict` requires them."""
    for size, checkpoint in (("vit-b", "sam_vit_b_01ec64"), ("mobile", "mobile_sam")):
        with torch.device("meta"):
            state = exporter.Sam(exporter.SIZES[size]).state_dict()
        ours = sorted(" ".join([name, *map(str, value.shape)]) for name, value in state.items())
        if ours != sorted((ROOT / "tests" / "parity" / f"{checkpoint}.txt").read_text().splitlines()):
            sys.exit(f"assets/export/sam.py: parameters differ from those of {checkpoint} (tests/parity)")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--size", choices=["tiny", "vit-b"], default="tiny")
    parser.add_argument("--frames", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fault", choices=["bgr", "shift"])
    parser.add_argument("--no-test", action="store_true")
    asked = parser.parse_args()
    check_names()
    size = exporter.SIZES[asked.size]
    asked.out.mkdir(parents=True, exist_ok=True)
    square = {"height": size.side, "width": size.side}
    processor = SamImageProcessorPil(size={"longest_edge": size.side}, pad_size=square)
    shown = list(pictures(asked.frames))
    with torch.no_grad():
        model, given = build(size, asked.seed, processor, shown, asked.fault)
        put_frames(asked.out, size.name, shown, given)
    for of, answers in given:
        print(f"{of.size}: masks cover", ", ".join(f"{answer['covers']:.1%}" for answer in answers))
    checkpoint = asked.out / "checkpoint.pth"
    torch.save(official(model.state_dict()), checkpoint)
    script = ROOT / "assets" / "export" / "sam.py"
    subprocess.run([sys.executable, script, checkpoint, asked.out, "--size", asked.size], check=True)
    checkpoint.unlink()
    if not asked.no_test:
        test = ["cargo", "test", "--release", "--lib", "-p", "ostra-masks", "onnx::sam::tests::parity"]
        test += ["--", "--include-ignored", "--nocapture"]
        environment = os.environ | {"OSTRA_PARITY_SAM": str(asked.out.resolve())}
        sys.exit(subprocess.run(test, cwd=ROOT, env=environment).returncode)


if __name__ == "__main__":
    main()

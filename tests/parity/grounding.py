#!/usr/bin/env python3
"""Compares Grounding DINO in OSTRA with the implementation in `transformers`, using the same random weights.

    pip install torch transformers onnx pillow
    python3 tests/parity/grounding.py OUT [--size tiny|swin-t] [--frames FOLDER] [--seed S] [--fault bgr|shift]
                                      [--no-test]

The script builds the reference with seeded weights, and a checkpoint with the official names. It exports the checkpoint
with `assets/export/grounding_dino.py`. It runs the reference on images and phrases, and writes the results to OUT.
Finally the test of the crate runs the exported network on the same images and phrases, and compares every tensor.

Without FOLDER the script uses two synthetic images. `--fault` puts a fault into the reference, and the test must then
fail. `tests/parity/grounding-tiny` is OUT of `--size tiny`.
"""

import argparse
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import torch
from pictures import half_a_pixel, pictures
from PIL import Image
from transformers import BertTokenizer, GroundingDinoConfig, GroundingDinoForObjectDetection
from words import PIECES

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "assets" / "export"))
import grounding_dino as exporter  # noqa: E402

# Ids of these tokens in the vocabulary of BERT. The reference treats them as ends of phrases.
SPECIAL = {"[CLS]": 101, "[SEP]": 102, ".": 1012, "?": 1029}
# Shorter side and largest longer side in pixels, as in the official program.
SIDES = (800, 1333)
PHRASES = [["the red cat", "panicle of rice"], ["leaf"]]
# Least difference, in standard deviations, between the scores of any two cells that become queries. Rounding can swap
# closer ones. Among 900 queries some are always closer. With `swin-t` all queries therefore share one embedding, and a
# swap does no harm.
LEAST_GAP = {"tiny": 1e-3, "swin-t": 0.0}
# Largest number of draws of the weights.
DRAWS = 200


def vocabulary(size):
    """Returns the word pieces, one per line. The full vocabulary has the special tokens at the ids of BERT."""
    count = size.bert[4]
    if count == len(PIECES):
        return PIECES
    lines = [f"[unused{at}]" for at in range(count)]
    lines[0] = "[PAD]"
    for at, piece in enumerate(PIECES[1:]):
        lines[SPECIAL.get(piece, 2000 + 500 * at)] = piece
    return lines


def reference(size, lines):
    """Returns the same network in `transformers`."""
    width, depths, heads, window = size.swin
    bert = dict(zip(("hidden_size", "num_hidden_layers", "num_attention_heads", "intermediate_size"), size.bert))
    config = GroundingDinoConfig(
        backbone_config={
            "model_type": "swin",
            "embed_dim": width,
            "depths": list(depths),
            "num_heads": list(heads),
            "window_size": window,
            "out_indices": [2, 3, 4],
        },
        text_config=bert
        | {"model_type": "bert", "vocab_size": size.bert[4], "max_position_embeddings": size.bert[5]},
        num_queries=size.queries,
        d_model=size.width,
        encoder_layers=size.depth,
        encoder_ffn_dim=size.hidden,
        encoder_attention_heads=size.heads,
        decoder_layers=size.depth,
        decoder_ffn_dim=size.hidden,
        decoder_attention_heads=size.heads,
        disable_custom_kernels=True,
    )
    model = GroundingDinoForObjectDetection(config).eval()
    model.model.special_tokens = torch.tensor([lines.index(piece) for piece in SPECIAL])
    return model


# Replacements that turn names in `transformers` into those of the official checkpoint.
RENAMED = [
    (r"^model\.", ""),
    (r"^backbone\.conv_encoder\.model\.", "backbone.0."),
    (r"^backbone\.0\.(swin\.)?embeddings\.patch_embeddings\.projection", "backbone.0.patch_embed.proj"),
    (r"^backbone\.0\.(swin\.)?embeddings\.norm", "backbone.0.patch_embed.norm"),
    (r"^backbone\.0\.(swin\.)?encoder\.layers", "backbone.0.layers"),
    (r"^backbone\.0\.hidden_states_norms\.stage2", "backbone.0.norm1"),
    (r"^backbone\.0\.hidden_states_norms\.stage3", "backbone.0.norm2"),
    (r"^backbone\.0\.hidden_states_norms\.stage4", "backbone.0.norm3"),
    (r"(blocks\.\d+)\.layernorm_before", r"\1.norm1"),
    (r"(blocks\.\d+)\.layernorm_after", r"\1.norm2"),
    (r"(blocks\.\d+)\.intermediate\.dense", r"\1.mlp.fc1"),
    (r"(blocks\.\d+)\.output\.dense", r"\1.mlp.fc2"),
    (r"(blocks\.\d+)\.attention\.o_proj", r"\1.attn.proj"),
    (r"(blocks\.\d+)\.attention\.q_proj", r"\1.attn.query"),
    (r"(blocks\.\d+)\.attention\.k_proj", r"\1.attn.key"),
    (r"(blocks\.\d+)\.attention\.v_proj", r"\1.attn.value"),
    (r"(blocks\.\d+)\.attention\.relative_position_bias\.", r"\1.attn."),
    (r"^text_backbone\.", "bert."),
    (r"^text_projection\.", "feat_map."),
    (r"^input_proj_vision\.", "input_proj."),
    (r"^(encoder|decoder|enc_output|enc_output_norm|level_embed)\b", r"transformer.\1"),
    (r"^query_position_embeddings\.", "transformer.tgt_embed."),
    (r"^encoder_output_bbox_embed\.", "transformer.enc_out_bbox_embed."),
    (r"decoder\.layer_norm\.", "decoder.norm."),
    (r"decoder\.reference_points_head\.", "decoder.ref_point_head."),
    (r"encoder\.layers\.(\d+)\.fusion_layer\.", r"encoder.fusion_layers.\1."),
    (r"encoder\.layers\.(\d+)\.text_enhancer_layer\.", r"encoder.text_layers.\1."),
    (r"encoder\.layers\.(\d+)\.deformable_layer\.", r"encoder.layers.\1."),
    (r"vision_param$", "gamma_v"),
    (r"text_param$", "gamma_l"),
    (r"layer_norm_vision\.", "layer_norm_v."),
    (r"layer_norm_text\.", "layer_norm_l."),
    (r"(fusion_layers\..*)vision_proj\.", r"\1v_proj."),
    (r"(fusion_layers\..*)text_proj\.", r"\1l_proj."),
    (r"(text_layers\..*)layer_norm_before\.", r"\1norm1."),
    (r"(text_layers\..*)layer_norm_after\.", r"\1norm2."),
    (r"(encoder\.layers\..*)self_attn_layer_norm\.", r"\1norm1."),
    (r"(encoder\.layers\..*)final_layer_norm\.", r"\1norm2."),
    (r"(decoder\.layers\..*)encoder_attn_layer_norm\.", r"\1norm1."),
    (r"(decoder\.layers\..*)encoder_attn_text_layer_norm\.", r"\1catext_norm."),
    (r"(decoder\.layers\..*)self_attn_layer_norm\.", r"\1norm2."),
    (r"(decoder\.layers\..*)final_layer_norm\.", r"\1norm3."),
    (r"(decoder\.layers\..*)encoder_attn_text\.", r"\1ca_text."),
    (r"(decoder\.layers\..*)encoder_attn\.", r"\1cross_attn."),
    (r"(transformer\..*)\.fc([12])\.", r"\1.linear\2."),
]
# One tensor in the official checkpoint, three in `transformers`.
JOINED = re.compile(r"^(?!bert\.)(.*(?:attn|ca_text)\.)(query|key|value)\.(weight|bias)$")
# Not in the reference: the bias index of each pair of cells, and the unused pooler.
BESIDE = re.compile(r"relative_position_index$|^bert\.pooler\.")
# Only in the reference: index buffers, and a norm after the last features that are used.
ONLY_THERE = re.compile(r"special_tokens$|position_ids$|relative_position_index$|swin\.layernorm\.")


def official(name):
    """Returns the name in the official checkpoint, and which third of that tensor it is."""
    for pattern, replacement in RENAMED:
        name = re.sub(pattern, replacement, name)
    joined = JOINED.match(name)
    if not joined:
        return name, None
    before, part, kind = joined.groups()
    whole = f"{before}qkv.{kind}" if name.startswith("backbone.") else f"{before}in_proj_{kind}"
    return whole, ("query", "key", "value").index(part)


def give(model, weights):
    """Copies weights with official names into the reference. Exits if any weight remains unused."""
    left = {name for name in weights if not BESIDE.search(name)}
    for name, value in model.state_dict().items():
        if ONLY_THERE.search(name):
            continue
        there, third = official(name)
        value.copy_(weights[there] if third is None else weights[there].chunk(3)[third])
        left.discard(there)
    if left:
        sys.exit(f"the reference lacks these weights: {sorted(left)}")


def shrunk(width, height):
    """Returns the columns and rows of the image that the network sees."""
    short, longest = SIDES
    least, most = min(width, height), max(width, height)
    if most / least * short > longest:
        short = int(round(longest * least / most))
    if width < height:
        return short, int(short * height / width)
    return int(short * width / height), short


def fed(picture, fault):
    if fault == "bgr":
        picture = Image.fromarray(np.ascontiguousarray(np.asarray(picture)[:, :, ::-1]))
    if fault == "shift":
        picture = Image.fromarray(half_a_pixel(np.asarray(picture)))
    shown = np.asarray(picture.resize(shrunk(*picture.size), Image.Resampling.BILINEAR), np.float32) / 255
    normed = (shown - np.array([0.485, 0.456, 0.406], np.float32)) / np.array([0.229, 0.224, 0.225], np.float32)
    return torch.from_numpy(normed.transpose(2, 0, 1).copy())[None]


class Asker:
    """Runs the reference on images and phrases."""

    def __init__(self, model, lines, folder):
        path = folder / "vocab.txt"
        path.write_text("\n".join(lines) + "\n")
        self.tokenizer = BertTokenizer(vocab=str(path), vocab_file=str(path), do_lower_case=True)
        self.model = model

    def answer(self, picture, phrases, fault):
        ids = self.tokenizer(" ".join(f"{phrase} ." for phrase in phrases), return_tensors="pt")["input_ids"]
        out = self.model(pixel_values=fed(picture, fault), input_ids=ids)
        # Least difference between the scores of chosen cells, and to the best cell that was not chosen.
        best = out.enc_outputs_class[0].max(-1).values.sort(descending=True).values[: self.model.config.num_queries + 1]
        gap = float((best[:-1] - best[1:]).min() / best.std())
        return {"phrases": phrases, "logits": out.logits[0, :, : ids.shape[1]], "boxes": out.pred_boxes[0], "gap": gap}


def build(asked, size, lines, shown):
    """Returns weights that clearly separate the scores of chosen cells, and the reference's answers per image."""
    model = reference(size, lines)
    ours = exporter.GroundingDino(size)
    asker = Asker(model, lines, asked.out)
    for draw in range(DRAWS):
        exporter.randomise(ours, size, asked.seed + draw)
        if LEAST_GAP[asked.size] == 0:
            told = ours.transformer.tgt_embed.weight
            told.copy_(told[:1].clone().expand_as(told))
        give(model, ours.state_dict())
        given = [[asker.answer(picture, phrases, asked.fault) for phrases in PHRASES] for picture in shown]
        gap = min(answer["gap"] for answers in given for answer in answers)
        print(f"seed {asked.seed + draw}: scores of chosen cells differ by at least {gap:.1e} standard deviations")
        if gap > LEAST_GAP[asked.size]:
            return ours.state_dict(), given
    sys.exit(f"none of the {DRAWS} draws separates the chosen cells clearly; try another --seed")


def write(out, size, shown, given):
    """Writes the reference files to `out`.

    `reference.bin` holds little-endian 32-bit floats. `reference.json` gives the start of each tensor in it.
    """
    values, frames = [], []

    def put(tensor):
        start = sum(len(part) for part in values)
        values.append(tensor.detach().numpy().astype("<f4").ravel())
        return {"start": start, "shape": list(tensor.shape)}

    for at, (picture, answers) in enumerate(zip(shown, given)):
        file = f"frame-{at}.png"
        picture.save(out / file, optimize=True)
        cases = [
            {"phrases": answer["phrases"], "logits": put(answer["logits"]), "boxes": put(answer["boxes"])}
            for answer in answers
        ]
        frames.append({"picture": file, "cases": cases})
        for answer in answers:
            spread = ", ".join(f"{of} {float(answer[of].std()):.2f}" for of in ("logits", "boxes"))
            print(f"{file} {picture.size} {answer['phrases']}: standard deviations {spread}")
    np.concatenate(values).tofile(out / "reference.bin")
    told = {"network": f"{size.name}.onnx", "frames": frames}
    (out / "reference.json").write_text(json.dumps(told, indent=1) + "\n")


def shorten(path):
    """Shortens the names inside the file, because they make up most of a tiny network."""
    network = onnx.load(path)
    kept = {port.name for port in [*network.graph.input, *network.graph.output]}
    short = {}
    rename = lambda name: name if not name or name in kept else short.setdefault(name, f"{len(short):x}")  # noqa: E731
    for tensor in network.graph.initializer:
        tensor.name = rename(tensor.name)
    for node in network.graph.node:
        node.name = ""
        node.input[:] = map(rename, node.input)
        node.output[:] = map(rename, node.output)
    onnx.save(network, path)


def check_names():
    """Checks that parameter names and shapes match the official ones, because `load_state_dict` requires them."""
    with torch.device("meta"):
        state = exporter.GroundingDino(exporter.SIZES["swin-t"]).state_dict()
    ours = sorted(" ".join([name, *map(str, value.shape)]) for name, value in state.items())
    if ours != sorted((ROOT / "tests" / "parity" / "groundingdino_swint_ogc.txt").read_text().splitlines()):
        sys.exit("assets/export/grounding_dino.py: parameters differ from tests/parity/groundingdino_swint_ogc.txt")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--size", choices=exporter.SIZES, default="tiny")
    parser.add_argument("--frames", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fault", choices=["bgr", "shift"])
    parser.add_argument("--no-test", action="store_true")
    asked = parser.parse_args()
    check_names()
    size = exporter.SIZES[asked.size]
    asked.out.mkdir(parents=True, exist_ok=True)
    shown = list(pictures(asked.frames))
    with torch.no_grad():
        weights, given = build(asked, size, vocabulary(size), shown)
    write(asked.out, size, shown, given)
    checkpoint = asked.out / "checkpoint.pth"
    torch.save({"model": {f"module.{name}": value for name, value in weights.items()}}, checkpoint)
    script = ROOT / "assets" / "export" / "grounding_dino.py"
    subprocess.run([sys.executable, script, checkpoint, asked.out, "--size", asked.size], check=True)
    checkpoint.unlink()
    if asked.size == "tiny":
        shorten(asked.out / f"{size.name}.onnx")
    if not asked.no_test:
        test = ["cargo", "test", "--release", "--lib", "-p", "ostra-masks", "onnx::grounding::tests::parity"]
        test += ["--", "--include-ignored", "--nocapture"]
        environment = os.environ | {"OSTRA_PARITY_GROUNDING": str(asked.out.resolve())}
        sys.exit(subprocess.run(test, cwd=ROOT, env=environment).returncode)


if __name__ == "__main__":
    main()

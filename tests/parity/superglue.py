#!/usr/bin/env python3
"""Compares SuperPoint and SuperGlue in OSTRA with `transformers`, using the same random weights.

    pip install torch transformers onnx pillow
    python3 tests/parity/superglue.py OUT [--size tiny|official] [--frames FOLDER] [--seed S]
                                      [--fault bgr|shift] [--no-test]

The script draws seeded weights under the names of the official checkpoints. It exports them with
`assets/export/superglue.py`, and copies them into the reference. It runs the reference on two images, and writes the
results to OUT. Finally the test of the crate runs the exported networks on the same images, and compares every tensor.

Without FOLDER the script uses two synthetic images. `--fault` puts a fault into the reference, and the test must then
fail. `tests/parity/superglue-tiny` is OUT of `--size tiny`.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from transformers import SuperGlueConfig, SuperGlueForKeypointMatching, SuperPointConfig
from transformers.models.superglue import modeling_superglue
from transformers.models.superpoint import modeling_superpoint

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "assets" / "export"))
import superglue as exporter  # noqa: E402

# Largest number of keypoints to match.
MOST = {"tiny": 60, "official": 256}
# Least and largest share of keypoints with a partner. Outside this range the comparison means little.
MATCHED = (0.15, 0.85)
# Largest number of draws of the weights.
DRAWS = 40
# Standard deviation of the agreement of two keypoints, similar to that of trained weights.
SPREAD = 6.0


def reference(size, most):
    """Returns the same networks in `transformers`."""
    points = SuperPointConfig(
        encoder_hidden_sizes=list(size.blocks),
        decoder_hidden_size=size.head,
        keypoint_decoder_dim=exporter.CHANNELS,
        descriptor_decoder_dim=size.descriptor,
        keypoint_threshold=0.005,
        max_keypoints=most,
        nms_radius=4,
        border_removal_distance=4,
    )
    glue = SuperGlueConfig(
        keypoint_detector_config=points,
        hidden_size=size.descriptor,
        keypoint_encoder_sizes=list(size.keypoint),
        gnn_layers_types=["self", "cross"] * size.rounds,
        num_attention_heads=size.heads,
        sinkhorn_iterations=100,
        matching_threshold=0.2,
        attn_implementation="eager",
    )
    return SuperGlueForKeypointMatching(glue).eval()


def renamed_points(state):
    """Yields the weights of the official SuperPoint under their names in `transformers`."""
    heads = {"convP": "keypoint_decoder.conv_score_", "convD": "descriptor_decoder.conv_descriptor_"}
    for name, value in state.items():
        layer, kind = name.split(".")
        head = heads.get(layer[:-1])
        block = f"encoder.conv_blocks.{int(layer[4]) - 1}.conv_" if head is None else head
        yield f"keypoint_detector.{block}{layer[-1]}.{kind}", value


def renamed_glue(state, heads):
    """Yields the weights of the official SuperGlue under their names in `transformers`.

    The channels also change their order, because `transformers` keeps those of a head together.
    """

    def perceptron(before, rest):
        number, kind = rest.split(".")
        # Each layer has three modules: linear, normalisation and rectifier.
        at, part = divmod(int(number), 3)
        last = f"{before}{3 * at + 1}.weight" not in state
        if last:
            return f"{before}{at}.{kind}"
        return f"{before}{at}.{('linear', 'batch_norm')[part]}.{kind}"

    def gathered(value, dim):
        order = torch.arange(value.shape[dim]).view(-1, heads).T.reshape(-1)
        return value.index_select(dim, order)

    for name, value in state.items():
        value = value.squeeze(-1) if value.dim() == 3 else value
        if name.startswith("kenc.encoder."):
            short = perceptron("kenc.encoder.", name.removeprefix("kenc.encoder."))
            yield short.replace("kenc", "keypoint_encoder"), value
        elif ".mlp." in name:
            before, rest = name.split("mlp.")
            yield perceptron(f"{before}mlp.", rest), value
        elif ".attn.proj." in name:
            before, rest = name.split("attn.proj.")
            number, kind = rest.split(".")
            asked = ("query", "key", "value")[int(number)]
            yield f"{before}attention.self.{asked}.{kind}", gathered(value, 0)
        elif ".attn.merge." in name:
            value = gathered(value, 1) if name.endswith("weight") else value
            yield name.replace("attn.merge", "attention.output.dense"), value
        elif name.startswith("final_proj"):
            yield f"final_projection.{name}", value
        else:
            yield name, value


def made_pictures():
    """Returns two synthetic images of the same spots and waves. The second is shifted."""
    shown = []
    for moved in (0, 16):
        y, x = np.mgrid[:120, :160].astype(float)
        x = x + moved
        picture = np.stack([90 + 80 * np.sin(x / 7) * np.cos(y / 5), 60 + 0.5 * x + 0 * y, 200 - y], -1)
        draw = np.random.default_rng(3)
        for _ in range(60):
            at, radius, color = draw.uniform((0, 0), (180, 120)), draw.uniform(2, 9), draw.uniform(0, 255, 3)
            picture[(x - at[0]) ** 2 + (y - at[1]) ** 2 < radius**2] = color
        shown.append(Image.fromarray(picture.clip(0, 255).astype(np.uint8)))
    return shown


def pictures(folder):
    if folder is None:
        return made_pictures()
    files = sorted(folder.iterdir())
    if len(files) < 6:
        sys.exit(f"{folder}: found {len(files)} images, need at least 6 to compare the first and the sixth")
    opened = (Image.open(file).convert("RGB") for file in (files[0], files[5]))
    # The size is a whole number of cells, because the reference does not have the padding of OSTRA.
    return [picture.resize((640, 480)).crop((0, 0, 320, 240)) for picture in opened]


def grey(picture, fault):
    pixels = np.asarray(picture).astype(np.float32) / 255
    if fault == "bgr":
        pixels = pixels[:, :, ::-1]
    tone = pixels @ np.array([0.299, 0.587, 0.114], np.float32)
    if fault == "shift":
        tone = (tone + np.concatenate([tone[:, 1:], tone[:, -1:]], 1)) / 2
    return torch.from_numpy(np.ascontiguousarray(tone))


class Asked:
    """The results of the reference for two images."""

    def __init__(self, model, tones):
        kept = {}

        def transport(scores, alone, iterations):
            kept["agreement"] = scores[0]
            return TRANSPORT(scores, alone, iterations)

        modeling_superglue.log_optimal_transport = transport
        model.final_projection.register_forward_pre_hook(lambda _, given: kept.update(projected=given[0]))
        given = torch.stack(tones)[None, :, None].expand(-1, -1, 3, -1, -1)
        points = model.keypoint_detector(given[0])
        if not bool(points.mask.all()):
            sys.exit("found too few keypoints; try another --seed")
        size = torch.tensor([tones[0].shape[1], tones[0].shape[0]])
        self.keypoints, self.scores = points.keypoints * size, points.scores
        self.descriptors = points.descriptors
        out = model(given)
        self.matches, self.shares = out.matches[0, 0], out.matching_scores[0, 0]
        self.agreement, self.projected = kept["agreement"], kept["projected"]
        self.matched = float((self.matches >= 0).float().mean())


TRANSPORT = modeling_superglue.log_optimal_transport
BORDERS = modeling_superpoint.remove_keypoints_from_borders


def without_rim(keypoints, scores, rim, height, width):
    """Removes keypoints near the border like the official code.

    Both multiply the size by 8. The official code passes the size in cells, but `transformers` passes it in pixels.
    """
    return BORDERS(keypoints, scores, rim, height // 8, width // 8)


modeling_superpoint.remove_keypoints_from_borders = without_rim


def draw(size, seed, most, tones):
    """Returns both networks and the reference, with seeded weights under which agreement varies as if trained."""
    points, glue = exporter.SuperPoint(size), exporter.SuperGlue(size)
    exporter.randomise(points, seed)
    exporter.randomise(glue, seed + 1)
    for layer in glue.gnn.layers:
        # A layer changes a descriptor only a little, like a trained layer.
        layer.mlp[-1].weight.data *= 0.02
    glue.kenc.encoder[-1].weight.data *= 0.1
    model = reference(size, most)

    def load():
        state = dict(renamed_points(points.state_dict())) | dict(renamed_glue(glue.state_dict(), size.heads))
        model.load_state_dict(state)

    def centre(of):
        # With random weights, descriptors consist almost only of their common mean.
        glue.final_proj.bias.data = -glue.final_proj.weight.squeeze(-1) @ of.projected.mean((0, 1))

    load()
    centre(Asked(model, tones))
    load()
    asked = Asked(model, tones)
    by = (SPREAD / asked.agreement.std()) ** 0.5
    glue.final_proj.weight.data *= by
    glue.final_proj.bias.data *= by
    glue.bin_score.data = asked.agreement.quantile(0.75) * by**2
    load()
    return points, glue, model


def drawn(size, seed, most, tones):
    """Returns the first draw that gives a partner to a fair share of the keypoints."""
    for draws in range(DRAWS):
        points, glue, model = draw(size, seed + draws, most, tones)
        if MATCHED[0] <= Asked(model, tones).matched <= MATCHED[1]:
            return points, glue, model
    sys.exit(f"none of {DRAWS} draws matches {MATCHED[0]:.0%} to {MATCHED[1]:.0%} of keypoints; try another --seed")


def write(out, name, shown, asked):
    """Writes the reference files to `out`.

    `reference.bin` holds little-endian 32-bit floats. `reference.json` gives the start of each tensor in it.
    """
    values, frames = [], []

    def put(tensor):
        start = sum(len(part) for part in values)
        values.append(tensor.detach().numpy().astype("<f4").ravel())
        return {"start": start, "shape": list(tensor.shape)}

    for at, picture in enumerate(shown):
        file = f"frame-{at}.png"
        picture.save(out / file, optimize=True)
        told = {part: put(getattr(asked, part)[at]) for part in ("keypoints", "scores", "descriptors")}
        frames.append({"picture": file} | told)
    told = {
        "points": "superpoint.onnx",
        "glue": "superglue-indoor.onnx",
        "frames": frames,
        "agreement": put(asked.agreement),
        "matches": asked.matches.tolist(),
    }
    np.concatenate(values).tofile(out / "reference.bin")
    (out / "reference.json").write_text(json.dumps(told) + "\n")
    print(f"{name}: agreement varies by {asked.agreement.std():.2f}, {asked.matched:.0%} of keypoints have a partner")


def check_names():
    """Checks that parameter names and shapes match the official ones, because `load_state_dict` requires them."""
    size = exporter.SIZES["official"]
    for network, checkpoint in (("superpoint", "superpoint_v1"), ("superglue", "superglue")):
        state = exporter.build(network, size).state_dict()
        ours = sorted(" ".join([name, *map(str, value.shape)]) for name, value in state.items())
        if ours != sorted((ROOT / "tests" / "parity" / f"{checkpoint}.txt").read_text().splitlines()):
            sys.exit(f"assets/export/superglue.py: parameters differ from those of {checkpoint} (tests/parity)")


def export(model, network, size, out):
    checkpoint = out / "checkpoint.pth"
    torch.save(model.state_dict(), checkpoint)
    script = ROOT / "assets" / "export" / "superglue.py"
    subprocess.run([sys.executable, script, checkpoint, out, "--size", size, "--network", network], check=True)
    checkpoint.unlink()


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
    size, most = exporter.SIZES[asked.size], MOST[asked.size]
    asked.out.mkdir(parents=True, exist_ok=True)
    shown = pictures(asked.frames)
    with torch.no_grad():
        points, glue, model = drawn(size, asked.seed, most, [grey(picture, None) for picture in shown])
        write(asked.out, asked.size, shown, Asked(model, [grey(picture, asked.fault) for picture in shown]))
    export(points, "superpoint", asked.size, asked.out)
    export(glue, "superglue-indoor", asked.size, asked.out)
    if not asked.no_test:
        test = ["cargo", "test", "--release", "--lib", "sfm::onnx::tests::superglue", "--", "--nocapture"]
        environment = os.environ | {"OSTRA_PARITY_SUPERGLUE": str(asked.out.resolve())}
        sys.exit(subprocess.run(test, cwd=ROOT, env=environment).returncode)


if __name__ == "__main__":
    main()

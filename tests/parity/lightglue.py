#!/usr/bin/env python3
"""Compares LightGlue in OSTRA with `transformers`, using the same random weights.

    pip install torch transformers onnx pillow
    python3 tests/parity/lightglue.py OUT [--layers N] [--seed S] [--fault axes|shorter|threshold] [--no-test]

The script draws seeded weights, and exports a network with the interface of COLMAP's `aliked-lightglue.onnx`. It copies
the weights into the reference, and runs that on keypoints and descriptors of pairs of synthetic images: two wide ones,
two tall ones, and one of each. It writes the results to OUT. Finally the test of the crate matches the same keypoints,
and compares matches and scores.

`--fault` puts a fault into the reference, and the test must then fail. `tests/parity/lightglue-tiny` is OUT by default.

The interface of `sift-lightglue.onnx` is not compared, because the reference has no scales and orientations.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import torch
from PIL import Image
from torch import nn
from transformers import LightGlueConfig, LightGlueForKeypointMatching, LightGlueImageProcessor, SuperPointConfig
from transformers.models.lightglue import modeling_lightglue

ROOT = Path(__file__).resolve().parents[2]

# Values per descriptor of ALIKED.
DESCRIPTOR = 128
# Channels and heads of the small network.
CHANNELS, HEADS = 24, 2
# Least score of a match, as in the public file and in OSTRA.
THRESHOLD = 0.1
# Standard deviation of the angles per unit of the normalised positions. More than of trained weights, so that half a
# pixel changes the scores.
ANGLES = 80.0
# Standard deviation of the similarity of two keypoints, similar to that of trained weights.
SPREAD = 4.0
# Keypoints of the first and of the second image.
KEYPOINTS = (40, 32)
# Share of the second image's keypoints that the first one has, too.
SHARED = 0.7
# Sizes of the images of each pair, width and height.
SIZES = [((640, 480), (640, 480)), ((360, 500), (360, 500)), ((640, 360), (300, 420))]
# Least and largest share of keypoints with a partner. Outside this range the comparison means little.
MATCHED = (0.25, 0.85)
# Least difference of the threshold and of a score, which keeps rounding from changing a match.
APART = 5e-3
# Largest number of draws.
DRAWS = 60


class Perceptron(nn.Module):
    """Returns descriptors changed by messages."""

    def __init__(self, channels):
        super().__init__()
        self.wide = nn.Linear(2 * channels, 2 * channels)
        self.normal = nn.LayerNorm(2 * channels)
        self.narrow = nn.Linear(2 * channels, channels)

    def forward(self, descriptors, messages):
        both = self.wide(torch.cat([descriptors, messages], -1))
        return descriptors + self.narrow(nn.functional.gelu(self.normal(both)))


def split(values):
    """Splits the channels of [1, keypoints, channels] into heads."""
    return values.unflatten(-1, (HEADS, CHANNELS // HEADS)).transpose(1, 2)


def attended(queries, keys, values):
    weights = queries @ keys.transpose(-1, -2) / (CHANNELS // HEADS) ** 0.5
    return (weights.softmax(-1) @ values).transpose(1, 2).flatten(-2)


def turned(values, angles):
    """Turns each pair of channels by an angle."""
    even, odd = values[..., ::2], values[..., 1::2]
    cosine, sine = angles.cos(), angles.sin()
    return torch.stack([even * cosine - odd * sine, odd * cosine + even * sine], -1).flatten(-2)


class Layer(nn.Module):
    """Self-attention with relative positions, and cross-attention in which queries are keys, too."""

    def __init__(self, channels):
        super().__init__()
        for name in ("query", "key", "value", "out", "cross", "cross_value", "cross_out"):
            setattr(self, name, nn.Linear(channels, channels))
        self.own, self.other = Perceptron(channels), Perceptron(channels)

    def within(self, descriptors, angles):
        queries, keys = (turned(split(of(descriptors)), angles) for of in (self.query, self.key))
        messages = self.out(attended(queries, keys, split(self.value(descriptors))))
        return self.own(descriptors, messages)

    def forward(self, descriptors, angles):
        descriptors = [self.within(*given) for given in zip(descriptors, angles)]
        keys = [split(self.cross(of)) for of in descriptors]
        values = [split(self.cross_value(of)) for of in descriptors]
        messages = [self.cross_out(attended(keys[at], keys[1 - at], values[1 - at])) for at in (0, 1)]
        return [self.other(*given) for given in zip(descriptors, messages)]


class LightGlue(nn.Module):
    """LightGlue as its paper describes it, without early exit, with the interface of COLMAP's file.

    Lindenberger, Sarlin, Pollefeys: "LightGlue: Local Feature Matching at Light Speed", ICCV 2023.
    """

    def __init__(self, layers):
        super().__init__()
        self.input = nn.Linear(DESCRIPTOR, CHANNELS)
        self.angles = nn.Linear(2, CHANNELS // HEADS // 2, bias=False)
        self.layers = nn.ModuleList(Layer(CHANNELS) for _ in range(layers))
        self.final = nn.Linear(CHANNELS, CHANNELS)
        self.matchability = nn.Linear(CHANNELS, 1)

    def described(self, places, descriptors, sizes):
        """Returns the descriptors after all layers."""
        angles = []
        for at, size in zip(places, sizes):
            at = (at - size[:, None] / 2) / (size.amax(-1) / 2)[:, None, None]
            angles.append(self.angles(at)[:, None])
        descriptors = [self.input(of) for of in descriptors]
        for layer in self.layers:
            descriptors = layer(descriptors, angles)
        return descriptors

    def similarity(self, descriptors):
        first, second = (self.final(of) / CHANNELS**0.25 for of in descriptors)
        return first @ second.transpose(1, 2)

    def forward(self, kpts0, kpts1, desc0, desc1, image_size0, image_size1):
        descriptors = self.described((kpts0, kpts1), (desc0, desc1), (image_size0, image_size1))
        similar = self.similarity(descriptors)
        first, second = (self.matchability(of).sigmoid() for of in descriptors)
        scores = (similar.softmax(2) * similar.softmax(1) * first * second.transpose(1, 2))[0]
        best, partners = scores.max(1)
        back = scores.argmax(0)
        is_mutual = back[partners] == torch.arange(scores.shape[0])
        best = torch.where(is_mutual, best, torch.zeros_like(best))
        return torch.where(best > THRESHOLD, partners, torch.full_like(partners, -1)), best


def randomise(network, seed):
    draw = torch.Generator().manual_seed(seed)
    for name, value in network.named_parameters():
        normal = torch.randn(value.shape, generator=draw)
        if name.endswith("normal.weight"):
            value.data = 1 + 0.1 * normal
        elif value.dim() == 1:
            value.data = 0.1 * normal
        else:
            value.data = normal / value.shape[1] ** 0.5
    network.angles.weight.data *= ANGLES * 2**0.5
    network.input.weight.data *= (DESCRIPTOR / CHANNELS) ** 0.5
    for layer in network.layers:
        for attention in (layer.query, layer.key, layer.cross):
            # A keypoint attends to a few others.
            attention.weight.data *= 2
        for perceptron in (layer.own, layer.other):
            # A layer changes a descriptor only a little, like a trained layer.
            perceptron.narrow.weight.data *= 0.7


def calibrate(network, pairs):
    """Makes similarity and matchability vary as if trained."""
    described = [network.described(*pair.inputs) for pair in pairs]
    values = torch.cat([of[0] for both in described for of in both])
    mean = values.mean(0)
    # With random weights, descriptors have much in common.
    network.final.bias.data = -network.final.weight @ mean
    by = (SPREAD / torch.cat([network.similarity(both).flatten() for both in described]).std()) ** 0.5
    network.final.weight.data *= by
    network.final.bias.data *= by
    chance = network.matchability
    chance.weight.data *= 1.5 / (values @ chance.weight.T).std()
    chance.bias.data = 2 - chance.weight @ mean


class Pair:
    """Keypoints and descriptors of two synthetic images of a plane."""

    def __init__(self, sizes, seed):
        self.sizes = sizes
        draw = np.random.default_rng(seed)
        # Positions of real extractors are seldom whole pixels.
        first = draw.uniform(0, np.array(sizes[0]) - 1, (KEYPOINTS[0], 2))
        described = draw.normal(size=(KEYPOINTS[0], DESCRIPTOR))
        count = KEYPOINTS[1]
        second = draw.uniform(0, np.array(sizes[1]) - 1, (count, 2))
        others = draw.normal(size=(count, DESCRIPTOR))
        seen = draw.permutation(KEYPOINTS[0])[: int(SHARED * count)]
        rows = draw.permutation(count)[: len(seen)]
        # A homography of unit squares that keeps points in the image.
        plane = np.array([[0.85, 0.06, 0.05], [-0.05, 0.9, 0.08], [0.05, 0.03, 1]])
        unit = np.c_[first[seen] / (np.array(sizes[0]) - 1), np.ones(len(seen))] @ plane.T
        second[rows] = unit[:, :2] / unit[:, 2:] * (np.array(sizes[1]) - 1)
        others[rows] = described[seen] + draw.normal(size=(len(seen), DESCRIPTOR)) * draw.uniform(0.1, 0.6, (len(seen), 1))
        tensor = lambda value: torch.tensor(value, dtype=torch.float32)  # noqa: E731
        self.places = [tensor(first), tensor(second)]
        self.descriptors = [nn.functional.normalize(tensor(of), dim=-1) for of in (described, others)]

    @property
    def inputs(self):
        """Returns positions, descriptors and sizes as the network takes them."""
        sizes = [torch.tensor([size], dtype=torch.float32) for size in self.sizes]
        return [at[None] for at in self.places], [of[None] for of in self.descriptors], sizes


class Detector(nn.Module):
    """Gives the keypoints of a pair, in place of SuperPoint."""

    def __init__(self):
        super().__init__()
        self.pair = None

    def forward(self, images, **_):
        most = max(KEYPOINTS)
        canvas = torch.tensor([images.shape[-1], images.shape[-2]])
        fill = lambda value: nn.functional.pad(value, (0, 0, 0, most - len(value)))  # noqa: E731
        places = torch.stack([fill(at / canvas) for at in self.pair.places])
        descriptors = torch.stack([fill(of) for of in self.pair.descriptors])
        mask = torch.stack([(torch.arange(most) < len(at)).int() for at in self.pair.places])
        return places, torch.ones(places.shape[:2]), descriptors, mask


def reference(layers):
    """Returns the same network in `transformers`."""
    points = SuperPointConfig(encoder_hidden_sizes=[8, 8, 8, 8], decoder_hidden_size=8, descriptor_decoder_dim=DESCRIPTOR)
    config = LightGlueConfig(
        keypoint_detector_config=points,
        descriptor_dim=CHANNELS,
        num_hidden_layers=layers,
        num_attention_heads=HEADS,
        depth_confidence=-1.0,
        width_confidence=-1.0,
        filter_threshold=THRESHOLD,
        attn_implementation="eager",
    )
    model = LightGlueForKeypointMatching(config).eval()
    model.keypoint_detector = Detector()
    return model


def renamed(name):
    """Returns the names in `transformers` of a weight."""
    plain = {
        "input": "input_projection",
        "angles": "positional_encoder.projector",
    }
    within = {
        "query": ["self_attention.q_proj"],
        "key": ["self_attention.k_proj"],
        "value": ["self_attention.v_proj"],
        "out": ["self_attention.o_proj"],
        "cross": ["cross_attention.q_proj", "cross_attention.k_proj"],
        "cross_value": ["cross_attention.v_proj"],
        "cross_out": ["cross_attention.o_proj"],
    }
    for block, mlp in (("own", "self_mlp"), ("other", "cross_mlp")):
        for part, theirs in (("wide", "fc1"), ("normal", "layer_norm"), ("narrow", "fc2")):
            within[f"{block}.{part}"] = [f"{mlp}.{theirs}"]
    module, kind = name.rsplit(".", 1)
    if module.startswith("layers."):
        _, number, part = module.split(".", 2)
        return [f"transformer_layers.{number}.{theirs}.{kind}" for theirs in within[part]]
    return [f"{plain[module]}.{kind}"]


def load(model, network, layers):
    """Copies the weights into the reference."""
    state = {}
    for name, value in network.state_dict().items():
        module, kind = name.rsplit(".", 1)
        if module in ("final", "matchability"):
            theirs = {"final": "final_projection", "matchability": "matchability"}[module]
            state[f"match_assignment_layers.{layers - 1}.{theirs}.{kind}"] = value
        else:
            state.update((theirs, value) for theirs in renamed(name))
    missing, unexpected = model.load_state_dict(state, strict=False)
    # What only early exits would use has no weights here.
    unused = ("token_confidence.", *(f"match_assignment_layers.{at}." for at in range(layers - 1)))
    missing = [name for name in missing if not name.startswith(unused)]
    if missing or unexpected:
        sys.exit(f"weights of `transformers` without a value: {missing}; unknown to it: {unexpected}")


NORMALISED = modeling_lightglue.normalize_keypoints


def normalised_by(sizes, fault):
    """Returns the reference's normalisation with the size of each image.

    `transformers` assumes one size for both images of a pair.
    """

    def normalise(keypoints, height, width):
        parts = []
        for at, (width, height) in zip(keypoints, sizes):
            if fault == "shorter":
                width = height = min(width, height)
            part = NORMALISED(at[None], height, width)
            if fault == "axes":
                part = part * max(width, height) / torch.tensor([width, height])
            parts.append(part)
        return torch.cat(parts)

    return normalise


def ask(model, pair, fault=None):
    """Returns partners and scores of the first image's keypoints by the reference."""
    canvas = pair.sizes[0]
    own = pair.sizes[0] == pair.sizes[1] and fault is None
    modeling_lightglue.normalize_keypoints = NORMALISED if own else normalised_by(pair.sizes, fault)
    model.keypoint_detector.pair = pair
    processor = LightGlueImageProcessor(do_resize=False)
    given = processor([Image.new("RGB", canvas)] * 2, return_tensors="pt")
    out = model(**given)
    # Without early exit, `transformers` does not group images by pairs, as its processor expects.
    out.matches, out.matching_scores = (of.reshape(1, 2, -1) for of in (out.matches, out.matching_scores))
    least = 2 * THRESHOLD if fault == "threshold" else THRESHOLD
    shown = processor.post_process_keypoint_matching(out, [[canvas[::-1]] * 2], threshold=least)[0]
    count = len(pair.places[0])
    partners, scores = out.matches[0, 0, :count].long(), out.matching_scores[0, 0, :count]
    partners = torch.where(scores > least, partners, -1)
    chosen = partners >= 0
    # The processor gives positions in whole pixels, in the order of the first image's keypoints.
    for places, name in ((pair.places[0][chosen], "keypoints0"), (pair.places[1][partners[chosen]], "keypoints1")):
        if (shown[name] - places).abs().max() > 1:
            sys.exit(f"the reference's processor gives other {name}")
    if not torch.equal(shown["matching_scores"], scores[chosen]):
        sys.exit("the reference's processor gives other scores")
    return SimpleNamespace(partners=partners, scores=scores)


def drawn(layers, seed):
    """Returns the first draw that gives a partner to a fair share of the keypoints of each pair."""
    model = reference(layers)
    for draws in range(DRAWS):
        pairs = [Pair(sizes, 100 * (seed + draws) + at) for at, sizes in enumerate(SIZES)]
        network = LightGlue(layers).eval()
        randomise(network, seed + draws)
        calibrate(network, pairs)
        load(model, network, layers)
        asked = [ask(model, pair) for pair in pairs]
        shares = [float((of.partners >= 0).float().mean()) for of in asked]
        apart = min(float((of.scores - THRESHOLD).abs().min()) for of in asked)
        if all(MATCHED[0] <= share <= MATCHED[1] for share in shares) and apart >= APART:
            print(f"draw {draws}: shares of keypoints with a partner {', '.join(f'{share:.0%}' for share in shares)}")
            return network, model, pairs
    sys.exit(f"none of {DRAWS} draws matches {MATCHED[0]:.0%} to {MATCHED[1]:.0%} of keypoints; try another --seed")


def write(out, pairs, asked):
    """Writes the reference files to `out`.

    `reference.bin` holds little-endian 32-bit floats. `reference.json` gives the start of each tensor in it.
    """
    values, described = [], []

    def put(tensor):
        start = sum(len(part) for part in values)
        values.append(tensor.numpy().astype("<f4").ravel())
        return {"start": start, "shape": list(tensor.shape)}

    for pair, of in zip(pairs, asked):
        images = [
            {"size": size, "keypoints": put(places), "descriptors": put(descriptors)}
            for size, places, descriptors in zip(pair.sizes, pair.places, pair.descriptors)
        ]
        described.append({"images": images, "matches": of.partners.tolist(), "scores": put(of.scores)})
    np.concatenate(values).tofile(out / "reference.bin")
    (out / "reference.json").write_text(json.dumps({"glue": "aliked-lightglue.onnx", "pairs": described}) + "\n")


def export(network, pair, path):
    places, descriptors, sizes = pair.inputs
    names = ["kpts0", "kpts1", "desc0", "desc1", "image_size0", "image_size1"]
    axes = {name: {1: f"num_keypoints{name[-1]}"} for name in names[:4]}
    torch.onnx.export(
        network,
        (*places, *descriptors, *sizes),
        path,
        input_names=names,
        output_names=["matches0", "mscores0"],
        dynamic_axes=axes | {"matches0": {0: "num_keypoints0"}, "mscores0": {0: "num_keypoints0"}},
        opset_version=17,
        dynamo=False,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--layers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fault", choices=["axes", "shorter", "threshold"])
    parser.add_argument("--no-test", action="store_true")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    with torch.no_grad():
        network, model, pairs = drawn(asked.layers, asked.seed)
        write(asked.out, pairs, [ask(model, pair, asked.fault) for pair in pairs])
        export(network, pairs[0], asked.out / "aliked-lightglue.onnx")
    if not asked.no_test:
        test = ["cargo", "test", "--release", "--lib", "-p", "ostra-reconstruct", "lightglue_reference", "--"]
        environment = os.environ | {"OSTRA_PARITY_LIGHTGLUE": str(asked.out.resolve())}
        sys.exit(subprocess.run([*test, "--include-ignored", "--nocapture"], cwd=ROOT, env=environment).returncode)


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Compares DeAOT in OSTRA with the official implementation, using the same random weights.

    git clone https://github.com/yoxu515/aot-benchmark CHECKOUT
    pip install torch onnx opencv-python-headless pillow
    python3 tests/parity/deaot.py CHECKOUT OUT [--size tiny|l] [--frames FOLDER] [--count N] [--side PX] [--seed S]
                                  [--fault bgr|shift|memory] [--no-test]

The script builds the official network with seeded weights, under which every mask moves and covers a fair share of the
image. It exports the weights with `assets/export/deaot.py`. The official engine then tracks the objects through the
images, and the script writes the results to OUT. Finally the test of the crate tracks the same objects, and compares
every logit and mask.

Without FOLDER the script uses synthetic images. `--side` shrinks the images of FOLDER. `--fault` puts a fault into the
reference, and the test must then fail. `tests/parity/deaot-tiny` is OUT of `--size tiny`.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "assets" / "export"))
import deaot as exporter  # noqa: E402

# Least and largest share of an image that a mask may cover. Outside this range the comparison means little.
COVERED = (0.02, 0.60)
# Least share of an object's pixels that must change between the first and the last image.
MOVED = 0.05
# Attempts to balance the weights of the last layer.
ROUNDS = 8
# Cases after the first store the logits of every third image.
STORED = 3
LONGEST = 800 * 1.3
# Modules that the checkout imports but this script does not need.
UNUSED = ["networks.encoders.swin", "torchvision", "torchvision.transforms", "torchvision.transforms.functional"]


class Official:
    """The parts of a checkout that this script uses."""

    def __init__(self, checkout):
        sys.path.insert(0, str(checkout))
        for name in UNUSED:
            sys.modules[name] = MagicMock()
        import configs.default
        from dataloaders.video_transforms import MultiRestrictSize, MultiToTensor
        from networks.encoders import resnet
        from networks.engines import build_engine
        from networks.layers.normalization import FrozenBatchNorm2d
        from networks.models import build_vos_model

        self.config = configs.default.DefaultEngineConfig("parity", "r50_deaotl")
        self.resnet, self.norm = resnet, FrozenBatchNorm2d
        self.build_model, self.build_engine = build_vos_model, build_engine
        self.restrict = MultiRestrictSize(None, LONGEST, False, [1], self.config.MODEL_ALIGN_CORNERS)
        self.to_tensor = MultiToTensor()

    def model(self, size):
        self.config.MODEL_ENCODER_EMBEDDING_DIM = size.channels
        self.config.MODEL_ENCODER_DIM = [*size.seen, size.seen[-1]]
        self.config.MODEL_LSTT_NUM = size.layers
        model = self.build_model(self.config.MODEL_VOS, self.config)
        if size.width != 64:
            model.encoder = self.encoder(size)
        return model.eval()

    def encoder(self, size):
        """Returns the official encoder with other widths."""
        block, norm = self.resnet.Bottleneck, self.norm
        encoder = self.resnet.ResNet(block, [1, 1, 1], 16, norm)
        encoder.inplanes = size.width
        encoder.conv1 = torch.nn.Conv2d(3, size.width, 7, 2, 3, bias=False)
        encoder.bn1 = norm(size.width)
        for at, (blocks, stride) in enumerate(zip(size.blocks, (1, 2, 2))):
            layer = encoder._make_layer(block, size.width * 2**at, blocks, stride, 1, norm)
            setattr(encoder, f"layer{at + 1}", layer)
        return encoder

    def engine(self, model):
        gap = self.config.TEST_LONG_TERM_MEM_GAP
        engine = self.build_engine("deaotengine", phase="eval", aot_model=model, long_term_mem_gap=gap)
        return engine.eval()

    def shown(self, picture):
        """Returns an image as the official test transform passes it to the network."""
        sample = {"current_img": np.asarray(picture, np.float32), "meta": {}}
        return self.to_tensor(self.restrict(sample))[0]["current_img"][None].float()


def made_pictures(count):
    """Yields synthetic images of shapes that move in front of a gradient."""
    height, width = 90, 300
    y, x = np.mgrid[:height, :width] / height
    for at in range(count):
        picture = np.stack([200 * y, 60 + 50 * x, 220 - 40 * y * x], -1)
        picture[(x - 0.5 - 0.1 * at) ** 2 + (y - 0.4) ** 2 < 0.06] = (230, 200, 40)
        picture[(abs(x - 2.6 + 0.08 * at) < 0.3) & (abs(y - 0.65) < 0.25)] = (30, 60, 90)
        picture[abs(x - 1.4 - 0.3 * y - 0.03 * at) < 0.12] = (250, 90, 160)
        yield Image.fromarray(picture.astype(np.uint8))


def pictures(folder, count, side):
    if folder is None:
        return list(made_pictures(count))
    shown = [Image.open(file).convert("RGB") for file in sorted(folder.iterdir())[:count]]
    for picture in shown:
        picture.thumbnail((side, side), Image.Resampling.BICUBIC)
    return shown


def columns(width, height, objects):
    """Returns a mask with boxes side by side, labelled 1 to `objects`, on a background of 0."""
    mask = np.zeros((height, width), np.uint8)
    for at in range(objects):
        first, last = (int(width * (at + share) / objects) for share in (0.15, 0.85))
        mask[height // 5 + at % 3 * height // 20 : 4 * height // 5, first:last] = at + 1
    return mask


def cases(size, width, height):
    """Returns the input masks of each case by image number.

    The case `three` has three objects. The tiny network also gets the case `many` with more than ten objects, some of
    which appear later.
    """
    told = {"three": {0: columns(width, height, 3)}}
    if size.name.endswith("tiny"):
        all_of_them = columns(width, height, 13)
        first = np.where(all_of_them > 9, 0, all_of_them)
        told["many"] = {0: first, 4: np.where(all_of_them > 9, all_of_them, 0).astype(np.uint8)}
    return told


def as_label(mask, size=None):
    label = torch.from_numpy(mask)[None, None].float()
    return label if size is None else F.interpolate(label, size=size, mode="nearest")


def walk(official, model, shown, told, fault=None):
    """Returns the logits of every group of objects and the mask, for each image after the first."""
    engine, found, objects = official.engine(model), [], 0
    for at, picture in enumerate(shown):
        pixels = np.asarray(picture)
        if fault == "bgr":
            pixels = pixels[:, :, ::-1]
        if fault == "shift":
            pixels = half_a_pixel(pixels)
        given, label = official.shown(pixels), told.get(at)
        if at > 0:
            engine.match_propogate_one_frame(given)
            logits = engine.decode_current_logits(pixels.shape[:2])
            mask = logits.softmax(1).argmax(1)[0].numpy().astype(np.uint8)
            groups = [group.pred_id_logits[0].clone() for group in engine.aot_engines]
            found.append({"frame": at, "groups": groups, "mask": mask, "objects": objects})
        if label is not None:
            objects = max(objects, int(label.max()))
            label = label if at == 0 else np.where(label > 0, label, mask)
            engine.add_reference_frame(given, as_label(label, given.shape[2:]), objects, frame_step=at)
        elif fault != "memory":
            engine.update_memory(as_label(mask, engine.input_size_2d))
    return found


def half_a_pixel(picture):
    """Returns the image shifted to the left by half a pixel."""
    right = np.concatenate([picture[:, 1:], picture[:, -1:]], 1)
    return ((picture.astype(np.uint16) + right + 1) // 2).astype(np.uint8)


def covered(found):
    """Returns the least and largest share of the image that an object covers, and the least change of an object."""
    objects = range(1, found[-1]["objects"] + 1)
    shares = [(of["mask"] == at).mean() for of in found for at in range(1, of["objects"] + 1)]
    changes = []
    for at in objects:
        first, last = (of["mask"] == at for of in (next(of for of in found if of["objects"] >= at), found[-1]))
        changes.append((first ^ last).sum() / max(1, (first | last).sum()))
    return min(shares), max(shares), min(changes)


def calm(bank):
    """Makes identities depend more on how much of a cell an object covers than on single pixels.

    Masks are fed back into the network. Rounding decides pixels between two objects, and without this step such a
    difference would grow with every image.
    """
    bank.copy_(0.1 * bank + bank.mean((2, 3), keepdim=True) * bank.shape[1] ** 0.5)


def balance(model, walks):
    """Shifts and scales the last layer so that the logits of no object dominate."""
    last = model.decoder.conv_out
    for channel in range(exporter.OBJECTS + 1):
        seen = [of["groups"][0][channel].ravel() for found in walks for of in found if channel <= of["objects"]]
        if seen:
            values = torch.cat(seen)
            scale = 1 / values.std()
            last.weight[channel] *= scale
            last.bias[channel] = (last.bias[channel] - values.mean()) * scale


def fair(official, size, seed, shown, told):
    """Returns the official network with weights that give meaningful masks, and its results for each case."""
    model = official.model(size)
    exporter.randomise(model, seed)
    calm(model.patch_wise_id_bank.weight)
    for _ in range(ROUNDS):
        walks = [walk(official, model, shown, given) for given in told.values()]
        shares = covered(walks[0])
        print(f"masks cover {shares[0]:.1%} to {shares[1]:.1%}; at least {shares[2]:.1%} of each changes", flush=True)
        if COVERED[0] <= shares[0] and shares[1] <= COVERED[1] and shares[2] >= MOVED:
            return model, walks
        balance(model, walks)
    sys.exit(f"no moving masks that cover {COVERED[0]:.0%} to {COVERED[1]:.0%}; try another --seed")


def write(out, name, shown, told, walks):
    """Writes the reference files to `out`.

    `reference.bin` holds little-endian 32-bit floats. `reference.json` gives the start of each tensor in it.
    """
    values, start, listed = [], 0, []
    for at, picture in enumerate(shown):
        picture.save(out / f"frame-{at}.png", optimize=True)
    for (case, given), found in zip(told.items(), walks):
        frames = []
        for of in found:
            groups = []
            # Cases after the first store only some of the logits, but every mask.
            is_stored = not listed or of["frame"] % STORED == 0
            for group, logits in enumerate(of["groups"] if is_stored else []):
                used = min(of["objects"] - exporter.OBJECTS * group, exporter.OBJECTS) + 1
                values.append(logits[:used].numpy().astype("<f4").ravel())
                groups.append({"start": start, "shape": [used, *logits.shape[1:]]})
                start += values[-1].size
            mask = f"{case}-{of['frame']}.png"
            Image.fromarray(of["mask"]).save(out / mask, optimize=True)
            frames.append({"groups": groups, "mask": mask})
        for at, label in given.items():
            Image.fromarray(label).save(out / f"{case}-told-{at}.png", optimize=True)
        deviation = float(torch.cat([of["groups"][0][: of["objects"] + 1].ravel() for of in found]).std())
        print(f"{case}: the standard deviation of the logits is {deviation:.3f}")
        given = {at: f"{case}-told-{at}.png" for at in given}
        listed.append({"name": case, "told": given, "deviation": deviation, "frames": frames})
    np.concatenate(values).tofile(out / "reference.bin")
    networks = [f"{name}-{part}.onnx" for part in ("encoder", "remember", "propagate", "identify")]
    told = {"networks": networks, "frames": len(shown), "cases": listed}
    (out / "reference.json").write_text(json.dumps(told, indent=1) + "\n")


def check_names(official):
    """Checks that parameter names and shapes match the official ones, because `load_state_dict` requires them."""
    with torch.device("meta"):
        state = exporter.DeAot(exporter.SIZES["l"]).state_dict()
    listed = (ROOT / "tests" / "parity" / "R50_DeAOTL_PRE_YTB_DAV.txt").read_text().splitlines()
    theirs = official.model(exporter.SIZES["l"]).state_dict()
    for where, named in (("assets/export/deaot.py", state), ("the checkout", theirs)):
        if sorted(" ".join([name, *map(str, value.shape)]) for name, value in named.items()) != listed:
            sys.exit(f"{where}: parameters differ from those of R50_DeAOTL_PRE_YTB_DAV (tests/parity)")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--size", choices=exporter.SIZES, default="tiny")
    parser.add_argument("--frames", type=Path)
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--side", type=int, default=10**6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fault", choices=["bgr", "shift", "memory"])
    parser.add_argument("--no-test", action="store_true")
    asked = parser.parse_args()
    official = Official(asked.checkout)
    check_names(official)
    size = exporter.SIZES[asked.size]
    asked.out.mkdir(parents=True, exist_ok=True)
    shown = pictures(asked.frames, asked.count, asked.side)
    told = cases(size, *shown[0].size)
    with torch.no_grad():
        model, walks = fair(official, size, asked.seed, shown, told)
        if asked.fault:
            walks = [walk(official, model, shown, given, asked.fault) for given in told.values()]
        write(asked.out, size.name, shown, told, walks)
    checkpoint = asked.out / "checkpoint.pth"
    torch.save({"state_dict": model.state_dict()}, checkpoint)
    script = ROOT / "assets" / "export" / "deaot.py"
    subprocess.run([sys.executable, script, checkpoint, asked.out, "--size", asked.size], check=True)
    checkpoint.unlink()
    if not asked.no_test:
        test = ["cargo", "test", "--release", "--lib", "-p", "ostra-tracking", "deaot::tests::parity"]
        test += ["--", "--include-ignored", "--nocapture"]
        environment = os.environ | {"OSTRA_PARITY_DEAOT": str(asked.out.resolve())}
        sys.exit(subprocess.run(test, cwd=ROOT, env=environment).returncode)


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Compares XMem in OSTRA with the official implementation, using the same random weights.

    git clone https://github.com/hkchengrex/XMem OFFICIAL
    pip install torch onnx pillow
    python3 tests/parity/xmem.py OUT --official OFFICIAL [--size tiny|full] [--frames FOLDER] [--seed S]
                                 [--cases consolidated added] [--fault bgr|shift|no-memory] [--no-test]

The script builds the official network with seeded weights. It exports the weights with `assets/export/xmem.py`. The
official code then tracks three objects through 30 images, and the script writes the results to OUT. Finally the test of
the crate tracks them with the exported networks, and compares every mask and probability.

There are two cases. In `consolidated` the limits are so low that memory is consolidated and forgotten several times. In
`added` one object appears later, and another gets a second mask.

The weights are random, with changes that make the comparison meaningful. Keys are centred and sharpened, so that
few cells are read out. Masks weigh more in the remembered values. The last layer is fitted to the first masks, which
drift over some images. This keeps the objects in sight. The script rejects draws for which rounding changes the answers
of the official code.

Without FOLDER the script uses synthetic images. `--fault` puts a fault into the reference, and the test must then fail.
`tests/parity/xmem-tiny` is OUT of `--size tiny`.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image
from torch import nn

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "assets" / "export"))
import xmem as exporter  # noqa: E402

FRAMES = 30
# Least and largest share of an image that a mask may cover, and its least change. Outside these ranges the comparison
# means little.
COVERED = (0.02, 0.60)
CHANGED = 0.03
# Limits for the effect of rounding on the answers of the official code: change of a probability, and share of equal
# pixels. The limits of the crate's test (1e-2, 0.999) are wider, so that a larger difference is a fault.
STEADY = (5e-3, 0.9997)
# Relative rounding error of the images.
ROUNDING, NOISE = 2e-7, np.random.default_rng(0)
DRAWS = 200
CASES = ["consolidated", "added"]
# With purely random weights, the 30th cell that is read out counts as much as the first. Rounding then chooses among
# thousands of cells. A noise of 2e-7 changes the answers of the official code by 0.04. Sharper keys, a larger weight of
# masks and the fitted last layer reduce this to 2e-3. At full size the crate then agrees with the official code to
# 4e-4.
SHARPNESS = 10.0  # scale of the keys; makes the last cell that is read out count very little
LOGIT = 3.0  # target logit of the last layer
MASKS = 12.0  # weight of masks relative to images in the remembered values
ROUNDS, FITTED = 3, 8  # number of fits of the last layer, and of images in each fit
SAMPLES = 4000  # positions per image in a fit
DRIFT = [(0.0, 0.004), (0.004, 0.0), (0.0, -0.004)]  # of each first mask, as a share of the image per frame
MEAN, DEVIATION = [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]


class Official:
    """The modules of a checkout of the official repository."""

    def __init__(self, folder):
        sys.path.insert(0, str(folder))
        from inference.inference_core import InferenceCore
        from inference.memory_manager import MemoryManager
        from model import modules, resnet
        from model.network import XMem

        # Pretrained weights are not needed.
        deep, flat = resnet.resnet50, resnet.resnet18
        resnet.resnet50 = lambda pretrained, extra_dim=0: deep(False, extra_dim)
        resnet.resnet18 = lambda pretrained, extra_dim=0: flat(False, extra_dim)
        self.core, self.manager, self.modules, self.resnet, self.network = (
            InferenceCore,
            MemoryManager,
            modules,
            resnet,
            XMem,
        )

    def model(self, size):
        dims = {"key_dim": size.key, "value_dim": size.value, "hidden_dim": size.hidden}
        model = self.network(dict(dims)).eval()
        if size.width != 64:
            self.narrow(model, size)
        return model.eval()

    def narrow(self, model, size):
        """Replaces the full layers with narrower ones of the same official types."""
        of, w = self.modules, size.width
        self.stages(model.key_encoder, 3, self.resnet.Bottleneck, ["res2", "layer2", "layer3"], size.picture_blocks, w)
        self.stages(model.value_encoder, 5, self.resnet.BasicBlock, ["layer1", "layer2", "layer3"], size.mask_blocks, w)
        model.value_encoder.fuser = of.FeatureFusionBlock(size.f16, 4 * w, size.value, size.value)
        model.value_encoder.hidden_reinforce = of.HiddenReinforcer(size.value, size.hidden)
        model.key_proj = of.KeyProjection(size.f16, size.key)
        decoder = model.decoder
        decoder.fuser = of.FeatureFusionBlock(size.f16, size.value + size.hidden, size.fused, size.fused)
        decoder.hidden_update = of.HiddenUpdater([size.fused, size.f4, size.f4 + 1], size.f4, size.hidden)
        decoder.up_16_8 = of.UpsampleBlock(size.f8, size.fused, size.f4)
        decoder.up_8_4 = of.UpsampleBlock(size.f4, size.f4, size.f4)
        decoder.pred = nn.Conv2d(size.f4, 1, 3, padding=1)

    def stages(self, encoder, channels, block, names, blocks, width):
        encoder.conv1 = nn.Conv2d(channels, width, 7, 2, 3, bias=False)
        encoder.bn1 = nn.BatchNorm2d(width)
        maker = self.resnet.ResNet(block, [1, 1, 1, 1])
        maker.inplanes = width
        for at, (name, count) in enumerate(zip(names, blocks)):
            setattr(encoder, name, maker._make_layer(block, width * 2**at, count, 1 if at == 0 else 2))


def made_pictures():
    """Yields synthetic images of three shapes that move in front of a changing gradient.

    No cells look exactly alike, because such cells could be matched in any order.
    """
    height, width = 60, 90
    y, x = np.mgrid[:height, :width] / height
    for t in range(FRAMES):
        s = t / FRAMES
        picture = np.stack([200 * y + 25 * s, 60 + 90 * x - 30 * s, 220 - 120 * y * x + 20 * s * x], -1)
        shapes = shapes_at(x, y, s)
        for shape, colour in zip(shapes, [(230, 200, 40), (30, 60, 90), (190, 40, 150)]):
            picture[shape] = np.array(colour) + 12 * np.sin(9 * (x[shape] + y[shape]))[:, None]
        yield Image.fromarray(picture.clip(0, 255).astype(np.uint8))


def shapes_at(x, y, s):
    disk = (x - 0.3 - 0.3 * s) ** 2 + (y - 0.35) ** 2 < 0.04
    box = (abs(x - 1.1) < 0.2) & (abs(y - 0.45 - 0.25 * s) < 0.15)
    bar = (abs(y - 0.85) < 0.09) & (abs(x - 0.6 + 0.2 * s) < 0.35)
    return disk & ~bar, box & ~bar, bar


def pictures(folder):
    if folder is None:
        return list(made_pictures())
    files = sorted(folder.iterdir())[: 2 * FRAMES : 2]
    return [Image.open(file).convert("RGB") for file in files]


def given_mask(picture, folder):
    """Returns the input mask of the first image, with labels 1 to 3."""
    width, height = picture.size
    y, x = np.mgrid[:height, :width] / height
    mask = np.zeros((height, width), np.uint8)
    if folder is None:
        shapes = shapes_at(x, y, 0.0)
    else:
        shapes = [
            (abs(x - 0.55) < 0.13) & (abs(y - 0.45) < 0.28),
            (x - 1.15) ** 2 + (y - 0.5) ** 2 < 0.05,
            (abs(y - 0.85) < 0.1) & (abs(x - 0.9) < 0.5),
        ]
    for label, shape in enumerate(shapes):
        mask[shape] = label + 1
    return mask


def limits(**changed):
    usual = {
        "mem_every": 2,
        "deep_update_every": -1,
        "enable_long_term": True,
        "enable_long_term_count_usage": True,
        "max_mid_term_frames": 4,
        "min_mid_term_frames": 2,
        "num_prototypes": 8,
        "max_long_term_elements": 28,
        "top_k": 30,
    }
    return usual | changed


def cases(mask, size, chosen):
    """Returns the memory limits of each case, and its input masks by frame."""
    only = lambda *labels: np.where(np.isin(mask, labels), mask, 0).astype(np.uint8)  # noqa: E731
    many = size.name == "xmem"
    low = limits(num_prototypes=128, max_long_term_elements=600) if many else limits()
    # These limits are never reached, because the official code does not consolidate objects that appear later.
    high = limits(max_mid_term_frames=40, min_mid_term_frames=20)
    all_cases = {"consolidated": (low, {0: mask}), "added": (high, {0: only(1, 2), 5: only(3), 12: only(1)})}
    return {name: all_cases[name] for name in chosen}


def prepared(picture, side, fault):
    if fault == "bgr":
        picture = Image.fromarray(np.asarray(picture)[:, :, ::-1])
    values = np.asarray(picture).astype(np.float32) / 255
    if fault == "shift":
        values = (values + np.concatenate([values[:, 1:], values[:, -1:]], 1)) / 2
    values = (values - np.float32(MEAN)) / np.float32(DEVIATION)
    if fault == "rounding":
        values = values * (1 + ROUNDING * NOISE.standard_normal(values.shape))
    planes = torch.from_numpy(values.astype(np.float32)).permute(2, 0, 1)
    to = sized(planes.shape[1:], side)
    return F.interpolate(planes[None], to, mode="bilinear", align_corners=False, antialias=True)[0]


def sized(shape, side):
    """Returns the rows and columns for a shorter side of `side`, like torchvision's `Resize`."""
    short, long = min(shape), int(side * max(shape) / min(shape))
    return (side, long) if shape[0] == short else (long, side)


def follow(official, model, size, shown, case, asked):
    """Returns the probabilities [1 + labels, height, width] of every frame, at its own size."""
    limits, given = case
    config = limits | {"hidden_dim": size.hidden, "key_dim": size.key, "value_dim": size.value}
    core = official.core(model, config=config)
    known, answers = [], []
    for at, picture in enumerate(shown):
        image = prepared(picture, asked.side, asked.fault)
        mask = labels = None
        if at in given:
            labels = [int(label) for label in np.unique(given[at]) if label]
            known += [label for label in labels if label not in known]
            one_hot = torch.stack([torch.from_numpy((given[at] == label).astype(np.float32)) for label in known])
            mask = F.interpolate(one_hot[None], image.shape[1:], mode="nearest")[0]
            core.set_all_labels(list(range(1, len(known) + 1)))
        answer = core.step(image, mask, labels, end=at == len(shown) - 1)
        height, width = picture.size[::-1]
        answer = F.interpolate(answer[:, None], (height, width), mode="bilinear", align_corners=False)[:, 0]
        answers.append(answer)
    return answers


def calibrate(official, model, size, shown, mask, asked):
    """Scales keys so that memory distinguishes objects, and fits the last layer to moving masks."""
    image = F.pad(prepared(shown[0], asked.side, None), (0, 16, 0, 16))
    image = image[:, : image.shape[1] // 16 * 16, : image.shape[2] // 16 * 16][None]
    f16 = model.key_encoder(image)[0]
    to = model.key_proj
    for layer, wanted in ((to.d_proj, 0.5), (to.e_proj, 1.0), (to.key_proj, 1.0)):
        layer.weight.mul_(wanted / layer(f16).std())
        layer.bias.sub_(layer(f16).mean())
    to.key_proj.weight.mul_(SHARPNESS)
    model.value_encoder.conv1.weight[:, 3:].mul_(MASKS)
    square, mixed = 0.0, 0.0
    for fitted in range(ROUNDS):
        seen = features(official, model, size, shown[:FITTED], mask, asked, is_led=fitted == 0)
        for at, (x, cells) in enumerate(seen):
            y = wanted_logits(moved(mask, at + 1), cells)
            few = slice(None, None, max(1, len(y) // SAMPLES))
            x, y = x[few].double(), y[few]
            weight = torch.where(y > 0, (y < 0).sum() / len(y), (y > 0).sum() / len(y))[:, None]
            square = square + x.T @ (weight * x)
            mixed = mixed + x.T @ (weight[:, 0] * y)
        steady = square + torch.eye(len(square)) * square.diagonal().mean() * 1e-2
        solved = torch.linalg.solve(steady, mixed).float()
        model.decoder.pred.weight.copy_(solved[:-1].reshape(model.decoder.pred.weight.shape))
        model.decoder.pred.bias.copy_(solved[-1:])


def features(official, model, size, shown, mask, asked, is_led):
    """Returns the inputs of the last layer for every image after the first, and its grid size.

    The inputs have the shape [objects · positions, 9 · channels + 1]. If `is_led`, the target masks replace the
    answers of the network.
    """
    seen, segment = [], model.segment

    def keep(_, given):
        places = F.unfold(given[0], 3, padding=1).transpose(1, 2).flatten(0, 1)
        places = torch.cat([places, torch.ones(len(places), 1)], 1)
        seen.append((places, given[0].shape[2:]))

    def led(*given, **named):
        hidden, logits, answer = segment(*given, **named)
        wanted = wanted_logits(moved(mask, len(seen)), answer.shape[2:]).float().sigmoid()
        wanted = wanted.reshape(1, 3, *answer.shape[2:])
        return hidden, logits, torch.cat([(1 - wanted).prod(1, keepdim=True), wanted], 1)

    hook = model.decoder.pred.register_forward_pre_hook(keep)
    model.segment = led if is_led else segment
    follow(official, model, size, shown, (limits(), {0: mask}), asked)
    del model.segment
    hook.remove()
    return seen


def moved(mask, at):
    """Returns the first masks after `at` frames. Each mask drifts in its own direction."""
    height, width = mask.shape
    out = np.zeros_like(mask)
    for label, (down, right) in enumerate(DRIFT):
        by = (round(down * at * height), round(right * at * width))
        out[np.roll(mask, by, (0, 1)) == label + 1] = label + 1
    return out


def wanted_logits(mask, cells):
    labels = torch.from_numpy(mask.astype(np.float32))[None, None]
    labels = F.interpolate(labels, cells, mode="nearest")[0, 0].flatten()
    return torch.cat([LOGIT * (2.0 * (labels == label + 1) - 1.0) for label in range(3)]).double()


def build(official, size, shown, told, asked):
    """Returns the reference with weights that make the comparison meaningful, and its answers per case.

    The weights are chosen without the fault.
    """
    mask = given_mask(shown[0], asked.frames)
    model = official.model(size)
    usual, rounded = (argparse.Namespace(**vars(asked) | {"fault": fault}) for fault in (None, "rounding"))
    walk = lambda case, asked: follow(official, model, size, shown, case, asked)  # noqa: E731
    for draw in range(DRAWS):
        exporter.randomise(model, asked.seed + draw)
        calibrate(official, model, size, shown, mask, usual)
        answers = {}
        for name, case in told.items():
            answers[name] = walk(case, usual)
            covers, changed = spread(answers[name])
            print(f"draw {draw}, {name}: cover {covers[0]:.1%} to {covers[1]:.1%}, change {changed:.1%}", flush=True)
            if not (COVERED[0] <= covers[0] and covers[1] <= COVERED[1] and changed >= CHANGED):
                break
            largest, equal = apart(answers[name], walk(case, rounded))
            print(f"  rounding: changes a probability by {largest:.1e}, leaves {equal:.3%} of a mask equal", flush=True)
            if largest > STEADY[0] or equal < STEADY[1]:
                break
        else:
            if asked.fault == "no-memory":
                remembered = official.manager.match_memory
                official.manager.match_memory = lambda self, key, selection: 0 * remembered(self, key, selection)
            return model, answers if asked.fault is None else {name: walk(case, asked) for name, case in told.items()}
    sys.exit(f"none of the {DRAWS} draws gives masks that can be compared; try another --seed")


def apart(answers, others):
    """Returns the largest difference of a probability, and the least share of equal pixels in a frame."""
    pairs = list(zip(answers, others))
    largest = max(float((a - b).abs().max()) for a, b in pairs)
    return largest, min(float((a.argmax(0) == b.argmax(0)).float().mean()) for a, b in pairs)


def spread(answers):
    """Returns the least and largest share that a label covers, and the least change (1 − IoU) over all frames."""
    masks = [answer.argmax(0) for answer in answers]
    shares, changes = [], []
    for label in range(1, answers[-1].shape[0]):
        there = [mask == label for mask, answer in zip(masks, answers) if answer.shape[0] > label]
        shares += [float(mask.float().mean()) for mask in there]
        either = (there[0] | there[-1]).sum()
        changes.append(1 - float((there[0] & there[-1]).sum() / either.clamp(min=1)))
    return (min(shares), max(shares)), min(changes)


def write(out, size, shown, told, answers, tensors, asked):
    """Writes the reference files to `out`.

    `reference.bin` holds little-endian 32-bit floats. `reference.json` gives the start of each tensor in it.
    """
    values = []

    def put(tensor):
        start = sum(len(part) for part in values)
        values.append(tensor.detach().numpy().astype("<f4").ravel())
        return {"start": start, "shape": list(tensor.shape)}

    def strip(pictures, name):
        Image.fromarray(np.concatenate([np.asarray(picture) for picture in pictures])).save(out / name, optimize=True)
        return name

    written = []
    for name, (limits, given) in told.items():
        masks = [answer.argmax(0).numpy().astype(np.uint8) for answer in answers[name]]
        asked_for = [at for at in range(1, FRAMES, asked.every) if at not in given]
        written.append(
            {
                "name": name,
                "limits": limits,
                "given": sorted(given),
                "given_masks": strip([given[at] for at in sorted(given)], f"{name}-given.png"),
                "masks": strip(masks, f"{name}-masks.png"),
                "probabilities": [{"frame": at, "tensor": put(answers[name][at])} for at in asked_for],
            }
        )
    told = {
        "networks": [f"{size.name}-{part}.onnx" for part in ("key-encoder", "value-encoder", "decoder")],
        "width": shown[0].width,
        "height": shown[0].height,
        "side": asked.side,
        "pictures": strip(shown, "frames.png"),
        "tensors": {name: put(tensor) for name, tensor in tensors.items()},
        "cases": written,
    }
    np.concatenate(values).tofile(out / "reference.bin")
    (out / "reference.json").write_text(json.dumps(told, indent=1) + "\n")


def first_tensors(model, shown, asked):
    """Returns the outputs of the official encoder for the first image."""
    from util.tensor_util import pad_divide_by

    image, _ = pad_divide_by(prepared(shown[0], asked.side, asked.fault), 16)
    names = ["key", "shrinkage", "selection", "f16", "f8", "f4"]
    return dict(zip(names, model.encode_key(image[None])))


def check_names(official):
    """Checks that parameter names and shapes match the official ones, because `load_state_dict` requires them."""
    listed = lambda state: sorted(" ".join([name, *map(str, v.shape)]) for name, v in state.items())  # noqa: E731
    expected = (ROOT / "tests" / "parity" / "XMem-s012.txt").read_text().splitlines()
    with torch.device("meta"):
        ours = exporter.XMem(exporter.SIZES["full"]).state_dict()
    if listed(ours) != sorted(expected) or listed(official.model(exporter.SIZES["full"]).state_dict()) != sorted(expected):
        sys.exit("parameters differ from those of XMem-s012 (tests/parity/XMem-s012.txt)")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--official", type=Path, required=True)
    parser.add_argument("--size", choices=exporter.SIZES, default="tiny")
    parser.add_argument("--frames", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--side", type=int, help="shorter side of the network's input, in pixels", default=None)
    parser.add_argument("--every", type=int, default=14, help="write the probabilities of every Nth frame")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=CASES)
    parser.add_argument("--fault", choices=["bgr", "shift", "no-memory"])
    parser.add_argument("--no-test", action="store_true")
    asked = parser.parse_args()
    size = exporter.SIZES[asked.size]
    asked.side = asked.side or (72 if asked.size == "tiny" else 480)
    official = Official(asked.official)
    check_names(official)
    asked.out.mkdir(parents=True, exist_ok=True)
    shown = pictures(asked.frames)
    told = cases(given_mask(shown[0], asked.frames), size, asked.cases)
    with torch.no_grad():
        model, answers = build(official, size, shown, told, asked)
        write(asked.out, size, shown, told, answers, first_tensors(model, shown, asked), asked)
    checkpoint = asked.out / "checkpoint.pth"
    torch.save(model.state_dict(), checkpoint)
    script = ROOT / "assets" / "export" / "xmem.py"
    subprocess.run([sys.executable, script, checkpoint, asked.out, "--size", asked.size], check=True)
    checkpoint.unlink()
    if not asked.no_test:
        test = ["cargo", "test", "--release", "--lib", "-p", "ostra-tracking", "xmem::tests::parity"]
        test += ["--", "--include-ignored", "--nocapture"]
        environment = os.environ | {"OSTRA_PARITY_XMEM": str(asked.out.resolve())}
        sys.exit(subprocess.run(test, cwd=ROOT, env=environment).returncode)


if __name__ == "__main__":
    main()

"""Common parts of the references of Segment Anything and related networks."""

import json

import numpy as np
from PIL import Image

# Least and largest share of an image that a mask may cover. Outside this range the comparison means little.
COVERED = (0.02, 0.60)
# Largest number of draws of the decoder's weights.
DRAWS = 400


def prompts(width, height):
    """Returns prompts of Segment Anything in pixels. Coordinates count from the centre of the first pixel.

    `after` is the index of the prompt whose mask this prompt refines.
    """
    at = lambda x, y, include: [int(x * width), int(y * height), include]  # noqa: E731
    box = [int(0.2 * width), int(0.3 * height), int(0.7 * width), int(0.8 * height)]
    first = [at(0.31, 0.42, 1)]
    return [
        {"clicks": first, "boxes": [], "after": None},
        {"clicks": [*first, at(0.6, 0.7, 1), at(0.8, 0.2, 0)], "boxes": [], "after": None},
        {"clicks": [], "boxes": [box], "after": None},
        {"clicks": [at(0.4, 0.5, 0)], "boxes": [box], "after": None},
        {"clicks": [*first, at(0.7, 0.6, 0)], "boxes": [], "after": 0},
    ]


def tie(model):
    """Gives the position embedding of `transformers` the same values under both of its names."""
    shared = model.prompt_encoder.shared_embedding.positional_embedding
    shared.copy_(model.shared_image_embedding.positional_embedding)


def put_frames(out, name, shown, given, has_masks=False):
    """Writes the reference files to `out`.

    `reference.bin` holds little-endian 32-bit floats. `reference.json` gives the start of each tensor in it. With
    `has_masks`, an image per frame holds the masks at its size: bit k of a pixel is the mask of case k.
    """
    values, frames = [], []

    def put(tensor):
        start = sum(len(part) for part in values)
        values.append(tensor.detach().numpy().astype("<f4").ravel())
        return {"start": start, "shape": list(tensor.shape)}

    for at, (picture, (asked, answers)) in enumerate(zip(shown, given)):
        file = f"frame-{at}.png"
        picture.save(out / file, optimize=True)
        masks = {}
        if has_masks:
            bits = sum((answer["logits"].numpy() > 0).astype(np.uint8) << k for k, answer in enumerate(answers))
            masks = {"masks": f"masks-{at}.png"}
            Image.fromarray(bits).save(out / masks["masks"], optimize=True)
        cases = [answer | {"low": put(answer["low"])} for answer in answers]
        for case in cases:
            # One result at the size of the image is enough, because the others are enlarged in the same way.
            case["logits"] = put(case["logits"]) if case is cases[0] else None
        maps = {"embedding": put(asked.embedding[0])}
        if hasattr(asked, "high_resolution"):
            maps["high_resolution"] = [put(of[0]) for of in asked.high_resolution]
        frames.append({"picture": file} | maps | masks | {"cases": cases})
    np.concatenate(values).tofile(out / "reference.bin")
    told = {"encoder": f"{name}-encoder.onnx", "decoder": f"{name}-decoder.onnx", "frames": frames}
    (out / "reference.json").write_text(json.dumps(told, indent=1) + "\n")

"""How the references of Segment Anything and its kin are drawn and written."""

import json

import numpy as np

# The share of a picture that a mask may cover for the comparison to mean something.
COVERED = (0.02, 0.60)
# Draws of the decoder's weights after which none is looked for any more.
DRAWS = 400


def put_frames(out, name, shown, given):
    """`reference.json` tells where in `reference.bin`, little-endian 32-bit floats, each tensor begins."""
    values, frames = [], []

    def put(tensor):
        start = sum(len(part) for part in values)
        values.append(tensor.detach().numpy().astype("<f4").ravel())
        return {"start": start, "shape": list(tensor.shape)}

    for at, (picture, (asked, answers)) in enumerate(zip(shown, given)):
        file = f"frame-{at}.png"
        picture.save(out / file, optimize=True)
        cases = [answer | {"low": put(answer["low"])} for answer in answers]
        for case in cases:
            # One at the size of the picture: the others are enlarged in the same way.
            case["logits"] = put(case["logits"]) if case is cases[0] else None
        frames.append({"picture": file, "embedding": put(asked.embedding[0]), "cases": cases})
    np.concatenate(values).tofile(out / "reference.bin")
    told = {"encoder": f"{name}-encoder.onnx", "decoder": f"{name}-decoder.onnx", "frames": frames}
    (out / "reference.json").write_text(json.dumps(told, indent=1) + "\n")

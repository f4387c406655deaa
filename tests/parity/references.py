"""Common parts of the references of Segment Anything and related networks."""

import json

import numpy as np

# Least and largest share of an image that a mask may cover. Outside this range the comparison means little.
COVERED = (0.02, 0.60)
# Largest number of draws of the decoder's weights.
DRAWS = 400


def put_frames(out, name, shown, given):
    """Writes the reference files to `out`.

    `reference.bin` holds little-endian 32-bit floats. `reference.json` gives the start of each tensor in it.
    """
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
            # One result at the size of the image is enough, because the others are enlarged in the same way.
            case["logits"] = put(case["logits"]) if case is cases[0] else None
        frames.append({"picture": file, "embedding": put(asked.embedding[0]), "cases": cases})
    np.concatenate(values).tofile(out / "reference.bin")
    told = {"encoder": f"{name}-encoder.onnx", "decoder": f"{name}-decoder.onnx", "frames": frames}
    (out / "reference.json").write_text(json.dumps(told, indent=1) + "\n")

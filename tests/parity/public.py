#!/usr/bin/env python3
"""Writes small networks with the interfaces of public files, which segment flat colours, find a clock or match keypoints.

    pip install onnx numpy
    python3 tests/parity/public.py tests/parity/public

The names, types and shapes of inputs and outputs are those of the public files that `assets/models.toml` lists. The
weights are not: the embedding is the mean colour of each cell, and a mask is all cells with the colour of the include
clicks, or with the colour at the centre of the box. Cells with the colour of an exclude click are removed, and an
earlier answer is added. The decoders give one mask (`single`) or four.

`grounding.onnx` has the interface of the export of Hugging Face. Whatever it is asked for, it finds one box, around the
dark pixels of the image. `decoder-wrong.onnx` gives what was not asked for. `encoder-data.onnx` reads its weights from
`encoder-data.bin`.

`aliked.onnx` finds the extrema of a difference of Gaussians and describes them by random projections of the pixels around
them. `aliked-lightglue.onnx` and `sift-lightglue.onnx` match mutually most similar descriptors; that for SIFT also wants
equal scales and orientations. `sift-lightglue-wrong.onnx` gives other partners.
"""

import argparse
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

SIDE, CELLS, CHANNELS = 1024, 64, 256
CELL = SIDE // CELLS
FINE = 4 * CELLS
MEAN, DEVIATION = [123.675, 116.28, 103.53], [58.395, 57.12, 57.375]


class Graph:
    """Collects the nodes and constants of a graph."""

    def __init__(self):
        self.nodes, self.constants, self.count = [], [], 0

    def constant(self, value, dtype=np.float32):
        self.count += 1
        name = f"c{self.count}"
        self.constants.append(numpy_helper.from_array(np.asarray(value, dtype), name))
        return name

    def add(self, kind, *inputs, to=None, **attributes):
        self.count += 1
        name = to or f"t{self.count}"
        self.nodes.append(helper.make_node(kind, list(inputs), [name], **attributes))
        return name

    def cast(self, value, kind=TensorProto.FLOAT):
        self.count += 1
        name = f"t{self.count}"
        self.nodes.append(helper.make_node("Cast", [value], [name], to=kind))
        return name

    def ints(self, *values):
        return self.constant(values, np.int64)

    def save(self, path, inputs, outputs):
        types = {"f32": TensorProto.FLOAT, "i64": TensorProto.INT64}
        port = lambda of: helper.make_tensor_value_info(of[0], types[of[1]], of[2])  # noqa: E731
        graph = helper.make_graph(
            self.nodes, path.stem, [port(of) for of in inputs], [port(of) for of in outputs], self.constants
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        onnx.checker.check_model(model)
        onnx.save(model, path)


def put_in_channels(g, cells, channels, to):
    """Appends channels of zeros to three."""
    pads = g.ints(0, 0, 0, 0, 0, channels - 3, 0, 0)
    return g.add("Pad", cells, pads, to=to)


def pooled(g, image, cell):
    return g.add("AveragePool", image, kernel_shape=[cell, cell], strides=[cell, cell])


def planes_encoder(path, name, output):
    """An encoder of a normalised image, channels first."""
    g = Graph()
    put_in_channels(g, pooled(g, name, CELL), CHANNELS, output)
    inputs = [(name, "f32", [1, 3, SIDE, SIDE])]
    g.save(path, inputs, [(output, "f32", [1, CHANNELS, CELLS, CELLS])])


def hwc_encoder(path):
    """An encoder that normalises and pads an image of rows × columns × colours itself."""
    g = Graph()
    normal = g.add("Div", g.add("Sub", "input_image", g.constant(MEAN)), g.constant(DEVIATION))
    planes = g.add("Transpose", normal, perm=[2, 0, 1])
    batch = g.add("Unsqueeze", planes, g.ints(0))
    size = g.add("Slice", g.add("Shape", batch), g.ints(2), g.ints(4))
    missing = g.add("Sub", g.ints(SIDE, SIDE), size)
    pads = g.add("Concat", g.ints(0, 0, 0, 0, 0, 0), missing, axis=0)
    square = g.add("Reshape", g.add("Pad", batch, pads), g.ints(1, 3, SIDE, SIDE))
    put_in_channels(g, pooled(g, square, CELL), CHANNELS, "image_embeddings")
    inputs = [("input_image", "f32", ["image_height", "image_width", 3])]
    g.save(path, inputs, [("image_embeddings", "f32", [1, CHANNELS, CELLS, CELLS])])


def sam2_encoder(path):
    g = Graph()
    put_in_channels(g, pooled(g, "input", CELL), CHANNELS, "image_embeddings")
    put_in_channels(g, pooled(g, "input", CELL // 4), 32, "high_res_features1")
    put_in_channels(g, pooled(g, "input", CELL // 2), 64, "high_res_features2")
    outputs = [
        ("image_embeddings", "f32", [1, CHANNELS, CELLS, CELLS]),
        ("high_res_features1", "f32", [1, 32, 4 * CELLS, 4 * CELLS]),
        ("high_res_features2", "f32", [1, 64, 2 * CELLS, 2 * CELLS]),
    ]
    g.save(path, [("input", "f32", [1, 3, SIDE, SIDE])], outputs)


def middles():
    """Returns the centres of all cells, [1, 1, cells, 2], relative to the centre of the first pixel."""
    at = np.arange(CELLS) * CELL + (CELL - 1) / 2
    rows, columns = np.meshgrid(at, at, indexing="ij")
    return np.stack([columns, rows], -1).reshape(1, 1, -1, 2)


def distances(g, colours, others):
    """Returns the squared distances of colours, [1, points, cells]."""
    cells = g.add("Unsqueeze", colours, g.ints(1))
    points = g.add("Unsqueeze", others, g.ints(2))
    difference = g.add("Sub", cells, points)
    return g.add("ReduceSum", g.add("Mul", difference, difference), g.ints(3), keepdims=0)


def of_kind(g, kind):
    """Returns 1 for points of a kind, else 0, [1, points, 1]."""
    equal = g.add("Equal", "point_labels", g.constant(kind))
    return g.add("Unsqueeze", g.cast(equal), g.ints(2))


def decoder(path, masks, is_sam2=False, sign=1):
    """A decoder that gives one or four masks, of which the third has the highest score.

    With `sign` -1 it gives what was not asked for.
    """
    g = Graph()
    three = g.add("Slice", "image_embeddings", g.ints(0), g.ints(3), g.ints(1))
    flat = g.add("Reshape", three, g.ints(1, 3, CELLS * CELLS))
    colours = g.add("Transpose", flat, perm=[0, 2, 1])
    include, first, last = (of_kind(g, kind) for kind in (1, 2, 3))
    # The centre of the box is one more point, which counts if nothing was clicked.
    corner = lambda kind: g.add("ReduceSum", g.add("Mul", "point_coords", kind), g.ints(1), keepdims=1)  # noqa: E731
    centre = g.add("Mul", g.add("Add", corner(first), corner(last)), g.constant(0.5))
    is_boxed = g.add("ReduceSum", last, g.ints(1), keepdims=1)
    is_clicked = g.add("Min", g.add("ReduceSum", include, g.ints(1), keepdims=1), g.constant(1))
    weight = g.add("Concat", include, g.add("Mul", g.add("Sub", g.constant(1), is_clicked), is_boxed), axis=1)
    points = g.add("Concat", "point_coords", centre, axis=1)
    offset = g.add("Abs", g.add("Sub", g.constant(middles()), g.add("Unsqueeze", points, g.ints(2))))
    far = g.add("ReduceMax", offset, axes=[3], keepdims=0)
    near = g.cast(g.add("LessOrEqual", far, g.constant(CELL / 2)))
    total = g.add("Max", g.add("ReduceSum", near, g.ints(2), keepdims=1), g.constant(1))
    seen = g.add("Div", g.add("MatMul", near, colours), total)
    weights = g.add("ReduceSum", weight, g.ints(1), keepdims=1)
    meant = g.add("ReduceSum", g.add("Mul", seen, weight), g.ints(1), keepdims=1)
    meant = g.add("Div", meant, g.add("Max", weights, g.constant(1)))
    alike = g.add("Sub", g.constant(1), g.add("Mul", g.constant(4), distances(g, colours, meant)))
    nothing = g.add("Sub", g.constant(1), g.add("Min", weights, g.constant(1)))
    alike = g.add("Sub", alike, g.add("Mul", g.constant(100), nothing))
    earlier = g.add("Reshape", pooled(g, "mask_input", 4), g.ints(1, 1, CELLS * CELLS))
    earlier = g.add("Add", g.add("Mul", earlier, "has_mask_input"), g.add(
        "Mul", g.constant(-1000), g.add("Sub", g.constant(1), "has_mask_input")))
    alike = g.add("Max", alike, earlier)
    exclude = of_kind(g, 0)
    clicked = g.add("Slice", seen, g.ints(0), g.ints(-1), g.ints(1))
    unlike = g.add("Sub", g.add("Mul", g.constant(4), distances(g, colours, clicked)), g.constant(1))
    unlike = g.add("Add", unlike, g.add("Mul", g.constant(1000), g.add("Sub", g.constant(1), exclude)))
    low = g.add("Min", alike, g.add("ReduceMin", unlike, axes=[1], keepdims=1))
    low = g.add("Clip", low, g.constant(-1), g.constant(1))
    low = g.add("Reshape", g.add("Mul", low, g.constant(8 * sign)), g.ints(1, 1, CELLS, CELLS))
    scales = g.constant([1, 1, 4, 4])
    low = g.add("Resize", low, "", scales, mode="nearest", nearest_mode="floor", coordinate_transformation_mode="asymmetric")
    if is_sam2:
        # The masks depend on all inputs, so that none can be left out.
        for name in ("high_res_features1", "high_res_features2"):
            nothing = g.add("Mul", g.add("ReduceSum", name, keepdims=0), g.constant(0))
            low = g.add("Add", low, nothing)
    zero = g.add("Mul", low, g.constant(0))
    if masks == 1:
        g.add("Identity", low, to="low_res_masks")
        scores = [[0.9]]
    else:
        never, always = g.add("Sub", zero, g.constant(1)), g.add("Add", zero, g.constant(1))
        g.add("Concat", low, never, low, always, axis=1, to="low_res_masks")
        scores = [[0.5, 0.6, 0.95, 0.7]]
    g.add("Identity", g.constant(scores), to="iou_predictions")
    size = "orig_im_size" if is_sam2 else g.cast("orig_im_size", TensorProto.INT64)
    sizes = g.add("Concat", g.ints(1, masks), size, axis=0)
    g.add("Resize", "low_res_masks", "", "", sizes, to="masks", mode="linear")
    maps = [("image_embeddings", "f32", [1, CHANNELS, CELLS, CELLS])]
    if is_sam2:
        maps += [("high_res_features1", "f32", [1, 32, FINE, FINE]), ("high_res_features2", "f32", [1, 64, 128, 128])]
    batch = "num_labels" if is_sam2 else 1
    inputs = maps + [
        ("point_coords", "f32", [batch, "num_points", 2]),
        ("point_labels", "f32", [batch, "num_points"]),
        ("mask_input", "f32", [batch, 1, FINE, FINE]),
        ("has_mask_input", "f32", [batch if is_sam2 else 1]),
        ("orig_im_size", "i64" if is_sam2 else "f32", [2]),
    ]
    outputs = [
        ("masks", "f32", [1, masks, "height", "width"]),
        ("iou_predictions", "f32", [1, masks]),
        ("low_res_masks", "f32", [1, masks, FINE, FINE]),
    ]
    g.save(path, inputs, outputs)


def grounding(path):
    """A network that finds the dark pixels, whatever it is asked for."""
    side, queries = 800, 900
    g = Graph()
    grey = g.add("ReduceMean", "pixel_values", axes=[1], keepdims=0)
    dark = g.cast(g.add("Less", grey, g.constant(-1)))
    dark = g.add("Mul", dark, g.cast("pixel_mask"))
    centres = np.arange(side, dtype=np.float32) / side
    extent = []
    for axis in (1, 2):  # over rows: columns with dark pixels, then the reverse
        line = g.add("ReduceMax", dark, axes=[axis], keepdims=0)
        light = g.add("Mul", g.add("Sub", g.constant(1), line), g.constant(10))
        low = g.add("ReduceMin", g.add("Add", light, g.constant(centres)), axes=[1], keepdims=1)
        high = g.add("ReduceMax", g.add("Sub", g.constant(centres + 1 / side), light), axes=[1], keepdims=1)
        extent.append((low, high))
    middle = [g.add("Mul", g.add("Add", low, high), g.constant(0.5)) for low, high in extent]
    size = [g.add("Sub", high, low) for low, high in extent]
    found = g.add("Reshape", g.add("Concat", *middle, *size, axis=1), g.ints(1, 1, 4))
    others = lambda value, size: g.add("Expand", g.constant(value), g.ints(1, queries - 1, size))  # noqa: E731
    g.add("Concat", found, others(0, 4), axis=1, to="pred_boxes")
    # One logit for each token, and as far below all others as a padding of the text is.
    ids = g.cast(g.add("Mul", g.add("Add", "input_ids", "token_type_ids"), "attention_mask"))
    tokens = g.add("Add", g.add("Mul", ids, g.constant(0)), g.constant(2))
    missing = g.add("Sub", g.ints(256), g.add("Slice", g.add("Shape", tokens), g.ints(1), g.ints(2)))
    pads = g.add("Concat", g.ints(0, 0, 0), missing, axis=0)
    row = g.add("Unsqueeze", g.add("Pad", tokens, pads, g.constant(-100)), g.ints(1))
    row = g.add("Reshape", row, g.ints(1, 1, 256))
    g.add("Concat", row, others(-100, 256), axis=1, to="logits")
    inputs = [
        ("pixel_values", "f32", ["batch_size", 3, side, side]),
        ("input_ids", "i64", ["batch_size", "sequence_length"]),
        ("token_type_ids", "i64", ["batch_size", "sequence_length"]),
        ("attention_mask", "i64", ["batch_size", "sequence_length"]),
        ("pixel_mask", "i64", ["batch_size", side, side]),
    ]
    g.save(path, inputs, [("logits", "f32", [1, queries, 256]), ("pred_boxes", "f32", [1, queries, 4])])


def gaussian(side, deviation):
    """Returns a kernel of sum 1, [1, 1, side, side]."""
    at = np.exp(-0.5 * ((np.arange(side) - side // 2) / deviation) ** 2)
    kernel = np.outer(at, at)
    return (kernel / kernel.sum()).reshape(1, 1, side, side)


def aliked(path):
    """A network that finds extrema of a difference of Gaussians, with random projections of 7 × 7 pixels."""
    around, dim = 3, 128
    g = Graph()
    grey = g.add("Conv", "image", g.constant(np.array([0.3, 0.5, 0.2]).reshape(1, 3, 1, 1)))
    padded = lambda by: g.add("Pad", grey, g.ints(0, 0, by, by, 0, 0, by, by), mode="edge")  # noqa: E731
    fine = g.add("Conv", padded(4), g.constant(gaussian(9, 1.2)))
    coarse = g.add("Conv", padded(7), g.constant(gaussian(15, 2.4)))
    strength = g.add("Abs", g.add("Mul", g.add("Sub", fine, coarse), g.constant(6)))
    strength = g.add("Clip", strength, g.constant(0), g.constant(1))
    largest = g.add("MaxPool", strength, kernel_shape=[5, 5], strides=[1, 1], pads=[2, 2, 2, 2])
    peaks = g.add("Mul", strength, g.cast(g.add("Equal", strength, largest)))
    flat = g.add("Reshape", peaks, g.ints(-1))
    count = g.add("Min", g.add("Unsqueeze", "max_keypoints", g.ints(0)), g.add("Shape", flat))
    g.nodes.append(helper.make_node("TopK", [flat, count], ["best", "places"], axis=0))
    is_kept = g.add("And", g.add("GreaterOrEqual", "best", "min_score"), g.add("Greater", "best", g.constant(0)))
    g.add("Unsqueeze", g.add("Compress", "best", is_kept, axis=0), g.ints(0), to="scores")
    places = g.add("Compress", "places", is_kept, axis=0)
    side = lambda axis: g.add("Slice", g.add("Shape", "image"), g.ints(axis), g.ints(axis + 1))  # noqa: E731
    width, height = side(3), side(2)
    row = g.add("Div", places, width)
    column = g.add("Sub", places, g.add("Mul", row, width))
    scaled = []
    for at, size in [(column, width), (row, height)]:
        last = g.cast(g.add("Sub", size, g.ints(1)))
        share = g.add("Div", g.cast(at), last)
        at = g.add("Sub", g.add("Mul", share, g.constant(2)), g.constant(1))
        scaled.append(g.add("Unsqueeze", at, g.ints(1)))
    g.add("Unsqueeze", g.add("Concat", *scaled, axis=1), g.ints(0), to="keypoints")
    # The pixels around a keypoint, in the padded image.
    wide = g.add("Add", width, g.ints(2 * around))
    offsets = np.arange(2 * around + 1)
    rows, columns = (of.reshape(1, -1) for of in np.meshgrid(offsets, offsets, indexing="ij"))
    rows = g.add("Add", g.add("Unsqueeze", row, g.ints(1)), g.constant(rows, np.int64))
    columns = g.add("Add", g.add("Unsqueeze", column, g.ints(1)), g.constant(columns, np.int64))
    pixels = g.add("Gather", g.add("Reshape", padded(around), g.ints(-1)), g.add("Add", g.add("Mul", rows, wide), columns))
    random = np.random.default_rng(45).normal(size=((2 * around + 1) ** 2, dim))
    described = g.add("MatMul", pixels, g.constant(random - random.mean(0)))
    length = g.add("ReduceL2", described, axes=[1], keepdims=1)
    described = g.add("Div", described, g.add("Max", length, g.constant(1e-9)))
    g.add("Unsqueeze", described, g.ints(0), to="descriptors")
    inputs = [
        ("image", "f32", ["batch", 3, "height", "width"]),
        ("max_keypoints", "i64", []),
        ("min_score", "f32", []),
    ]
    outputs = [
        ("keypoints", "f32", ["batch", "num_keypoints", 2]),
        ("descriptors", "f32", ["batch", "num_keypoints", dim]),
        ("scores", "f32", ["batch", "num_keypoints"]),
    ]
    g.save(path, inputs, outputs)


def lightglue(path, is_sift, offset=0):
    """A network that matches mutually most similar descriptors; `offset` is added to the partners."""
    g = Graph()
    alike = g.add("MatMul", "desc0", g.add("Transpose", "desc1", perm=[0, 2, 1]))
    # Descriptors that are not similar do not match.
    alike = g.add("Mul", g.add("Sub", alike, g.constant(0.8)), g.constant(5))
    for at in (0, 1):
        # The matches depend on all inputs, so that none can be left out.
        half = g.add("Div", f"image_size{at}", g.constant(2))
        largest = g.add("ReduceMax", half, axes=[1], keepdims=1)
        placed = g.add("Div", g.add("Sub", f"kpts{at}", g.add("Unsqueeze", half, g.ints(1))), largest)
        sum_of = g.add("ReduceSum", placed, keepdims=0)
        alike = g.add("Add", alike, g.add("Mul", sum_of, g.constant(0)))
    if is_sift:
        column = lambda name: g.add("Unsqueeze", name, g.ints(2))  # noqa: E731
        row = lambda name: g.add("Unsqueeze", name, g.ints(1))  # noqa: E731
        ratio = g.add("Abs", g.add("Log", g.add("Div", column("scales0"), row("scales1"))))
        turn = g.add("Cos", g.add("Sub", column("oris0"), row("oris1")))
        alike = g.add("Sub", alike, g.add("Add", ratio, g.add("Sub", g.constant(1), turn)))
    partners = g.add("Squeeze", g.add("ArgMax", alike, axis=2, keepdims=0), g.ints(0))
    back = g.add("Squeeze", g.add("ArgMax", alike, axis=1, keepdims=0), g.ints(0))
    best = g.add("Squeeze", g.add("ReduceMax", alike, axes=[2], keepdims=0), g.ints(0))
    count = g.add("Squeeze", g.add("Shape", partners), g.ints(0))
    own = g.add("Range", g.constant(0, np.int64), count, g.constant(1, np.int64))
    is_mutual = g.add("Equal", g.add("Gather", back, partners), own)
    is_match = g.add("And", is_mutual, g.add("Greater", best, g.constant(0.1)))
    if offset:
        number = g.add("Shape", back)
        partners = g.add("Mod", g.add("Add", partners, g.ints(offset)), number)
    g.add("Where", is_match, partners, g.ints(-1), to="matches0")
    scores = g.add("Clip", best, g.constant(0), g.constant(1))
    g.add("Mul", scores, g.cast(is_match), to="mscores0")
    inputs = []
    for name, values in [("kpts", 2), ("desc", 128)]:
        inputs += [(f"{name}{at}", "f32", ["batch", f"num_keypoints{at}", values]) for at in (0, 1)]
    inputs += [(f"image_size{at}", "f32", ["batch", 2]) for at in (0, 1)]
    if is_sift:
        for name in ("scales", "oris"):
            inputs += [(f"{name}{at}", "f32", ["batch", f"num_keypoints{at}"]) for at in (0, 1)]
    outputs = [("matches0", "i64", ["num_matches0"]), ("mscores0", "f32", ["num_matches0"])]
    g.save(path, inputs, outputs)


def with_data(path):
    """An encoder with weights in a file of their own, `encoder-data.bin`."""
    g = Graph()
    scaled = g.add("Mul", "image", g.constant(np.ones((1, 3, SIDE // 8, 1))))
    put_in_channels(g, pooled(g, scaled, CELL // 8), CHANNELS, "image_embeddings")
    port = lambda name, shape: helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)  # noqa: E731
    graph = helper.make_graph(
        g.nodes,
        path.stem,
        [port("image", [1, 3, SIDE // 8, SIDE // 8])],
        [port("image_embeddings", [1, CHANNELS, CELLS, CELLS])],
        g.constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, path, save_as_external_data=True, location=path.stem + ".bin", size_threshold=256)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    planes_encoder(out / "encoder-image.onnx", "image", "image_embeddings")
    planes_encoder(out / "encoder-x.onnx", "x", "embedding")
    hwc_encoder(out / "encoder-hwc.onnx")
    sam2_encoder(out / "encoder-sam2.onnx")
    decoder(out / "decoder-multi.onnx", 4)
    decoder(out / "decoder-single.onnx", 1)
    decoder(out / "decoder-wrong.onnx", 4, sign=-1)
    decoder(out / "decoder-sam2.onnx", 4, is_sam2=True)
    grounding(out / "grounding.onnx")
    aliked(out / "aliked.onnx")
    lightglue(out / "aliked-lightglue.onnx", is_sift=False)
    lightglue(out / "sift-lightglue.onnx", is_sift=True)
    lightglue(out / "sift-lightglue-wrong.onnx", is_sift=True, offset=7)
    (out / "encoder-data.bin").unlink(missing_ok=True)
    with_data(out / "encoder-data.onnx")


if __name__ == "__main__":
    main()

"""Estimates cameras with pycolmap, as `ostra bench` starts it.

The argument is a JSON object: images (folder), names (of the images), camera (PINHOLE parameters or null), sequential
(whether the images follow a path) and work (empty folder). The cameras are written to work/cameras. The last line of
the output is a JSON object of what it took. `timed` and `peak_memory_bytes` are in timing.py, which comes before this.
"""

import json
import sys
from pathlib import Path

import pycolmap


def main():
    request = json.loads(sys.argv[1])
    work, images = Path(request["work"]), Path(request["images"])
    database, steps = work / "database.db", []
    reader = pycolmap.ImageReaderOptions()
    mapping = pycolmap.IncrementalPipelineOptions()
    if request["camera"] is not None:
        reader = pycolmap.ImageReaderOptions(
            camera_model="PINHOLE", camera_params=",".join(map(str, request["camera"]))
        )
        mapping = pycolmap.IncrementalPipelineOptions(ba_refine_focal_length=False, ba_refine_extra_params=False)
    cpu = pycolmap.Device.cpu
    timed(
        steps,
        "Find features",
        lambda: pycolmap.extract_features(
            database,
            images,
            image_names=request["names"],
            camera_mode=pycolmap.CameraMode.SINGLE,
            reader_options=reader,
            device=cpu,
        ),
    )
    match = pycolmap.match_sequential if request["sequential"] else pycolmap.match_exhaustive
    timed(steps, "Match images", lambda: match(database, device=cpu))
    models = timed(
        steps, "Compute cameras", lambda: pycolmap.incremental_mapping(database, images, work / "models", mapping)
    )
    if not models:
        sys.exit("pycolmap found no cameras")
    best = max(models.values(), key=lambda model: model.num_reg_images())
    cameras = work / "cameras"
    cameras.mkdir()
    best.write_text(cameras)
    result = {"steps": steps, "placed": best.num_reg_images(), "peak_memory_bytes": peak_memory_bytes()}
    print()
    print(json.dumps(result), flush=True)


main()

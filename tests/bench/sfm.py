#!/usr/bin/env python3
"""Compares structure from motion in OSTRA with pycolmap: wall time, accuracy and memory on the same images and pairs.

    python3 tests/bench/sfm.py DATA [--ostra target/release/ostra] [--sets fountain dtu kitchen] [--threads 2]

DATA is the folder of the data sets. Without pycolmap (`pip install pycolmap`) only OSTRA runs. Both programs get the
intrinsics, one camera per set, and the same pairs. For fountain and dtu these are all pairs. For kitchen the script
takes every third frame. It pairs each with the next 10 frames, and with the frames 2^k away.
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SETS = {
    "fountain": ("strecha_fountain_P11", "images", 1),
    "dtu": ("dtu_scan24", "images", 1),
    "kitchen": ("redkitchen_rgbd_a", "color", 3),
}


def ours(ostra, pictures, truth, work, threads):
    """Runs `ostra reconstruct` and returns (seconds, peak MB, output). Writes the cameras to work/ours."""
    project = work / "project"
    subprocess.run([ostra, "new", project, "--frames", pictures, "--cameras", truth], check=True)
    command = [ostra, "reconstruct", project, "--method", "sfm"]
    begun = time.perf_counter()
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=os.environ | {"RAYON_NUM_THREADS": str(threads)}
    )
    said = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - begun
    if status:
        sys.exit(f"{command} failed")
    subprocess.run([ostra, "export", project, "--cameras", work / "ours"], check=True)
    return seconds, usage.ru_maxrss / 1024, said.strip()


def theirs(pictures, camera, pairs, work, threads):
    """Runs pycolmap in a separate process and returns (seconds, peak MB, output). Writes the cameras to work/theirs."""
    call = [sys.executable, __file__, "--worker", json.dumps([str(pictures), camera, pairs, str(work), threads])]
    begun = time.perf_counter()
    process = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    said = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - begun
    if status:
        sys.exit("pycolmap failed")
    return seconds, usage.ru_maxrss / 1024, said.strip()


def worker(pictures, camera, pairs, work, threads):
    import pycolmap

    database, work = Path(work) / "database.db", Path(work)
    reader = pycolmap.ImageReaderOptions(camera_model="PINHOLE", camera_params=camera)
    extraction = pycolmap.FeatureExtractionOptions(num_threads=threads, use_gpu=False)
    matching = pycolmap.FeatureMatchingOptions(num_threads=threads, use_gpu=False)
    pycolmap.extract_features(
        database, pictures, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader, extraction_options=extraction
    )
    listed = work / "pairs.txt"
    listed.write_text("".join(f"{a} {b}\n" for a, b in pairs))
    pairing = pycolmap.ImportedPairingOptions(match_list_path=str(listed))
    pycolmap.match_image_pairs(database, matching_options=matching, pairing_options=pairing)
    options = pycolmap.IncrementalPipelineOptions(
        num_threads=threads, ba_refine_focal_length=False, ba_refine_extra_params=False
    )
    models = pycolmap.incremental_mapping(database, pictures, work / "models", options)
    best = max(models.values(), key=lambda model: model.num_reg_images())
    (work / "theirs").mkdir()
    best.write_text(work / "theirs")
    print(f"{best.num_reg_images()} of {len(os.listdir(pictures))} frames, {best.num_points3D()} points")


def chosen_pairs(names, exhaustive):
    count = len(names)
    if exhaustive:
        return [(names[i], names[j]) for i in range(count) for j in range(i + 1, count)]
    steps = set(range(1, 11)) | {1 << k for k in range(count.bit_length())}
    return [(names[i], names[i + step]) for i in range(count) for step in sorted(steps) if i + step < count]


def intrinsics(truth):
    for line in (truth / "cameras.txt").read_text().splitlines():
        words = line.split()
        if words and words[0] != "#" and not line.startswith("#"):
            return ",".join(words[4:8])
    sys.exit(f"{truth}/cameras.txt: found no camera")


def accuracy(ostra, truth, found):
    command = [ostra, "eval", "cameras", "--truth", truth, "--result", found, "--align", "sim3", "--json"]
    score = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)
    error = score["error"]
    return f"centre {score['centre_percent']:.3f} %, rotation {error['rotation_deg']['median']:.3f}°"


def main():
    if sys.argv[1:2] == ["--worker"]:
        return worker(*json.loads(sys.argv[2]))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--ostra", default="target/release/ostra")
    parser.add_argument("--sets", nargs="+", default=list(SETS), choices=list(SETS))
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    try:
        import pycolmap
    except ImportError:
        pycolmap = None
        print("pycolmap is not installed (pip install pycolmap); only OSTRA runs")
    for name in args.sets:
        folder, pictures, every = SETS[name]
        truth = args.data / folder / "sparse"
        with tempfile.TemporaryDirectory() as work:
            work = Path(work)
            chosen = work / "pictures"
            chosen.mkdir()
            for picture in sorted((args.data / folder / pictures).iterdir())[::every]:
                shutil.copy(picture, chosen / picture.name)
            seconds, memory, said = ours(args.ostra, chosen, truth, work, args.threads)
            print(f"{name}: OSTRA {seconds:.1f} s, {memory:.0f} MB, {accuracy(args.ostra, truth, work / 'ours')}")
            print(f"    {said}")
            if pycolmap:
                names = sorted(path.name for path in chosen.iterdir())
                pairs = chosen_pairs(names, name != "kitchen")
                other, memory, said = theirs(chosen, intrinsics(truth), pairs, work, args.threads)
                print(f"{name}: pycolmap {other:.1f} s, {memory:.0f} MB, {accuracy(args.ostra, truth, work / 'theirs')}")
                print(f"    {said}; OSTRA took {seconds / other:.2f} times as long")


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    main()

#!/usr/bin/env python3
"""Does three jobs in the window of OSTRA by mouse and keys, with a screenshot of each step, and prints how long they took.

    cargo build --release
    tests/window/tutorials.py DATA SHOTS [JOB…] [--program PATH] [--size WIDTHxHEIGHT]

DATA is the folder of the accuracy tests' data sets (OSTRA_DATA), SHOTS gets a folder of screenshots per job. JOB is
`bananas` (photos to a labelled cloud), `shelf` (an RGB-D recording to four labelled objects) or `bedroom` (a video to
the masks of two children as COCO); all by default. Each job checks what it made.
"""

import argparse
import json
import os
import re
import subprocess
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from driver import Display, Window  # noqa: E402


def new_project(window, source, folder, found):
    """Opens a source by typing its path into the form of a new project."""
    window.shot("first-page")
    window.key("ctrl+n")
    window.wait_for_focus("Frames")
    window.type(source)
    window.wait_for(re.compile(found), 60)
    # The form grows with the preview.
    window.wait_for(re.compile("^Found|^Advanced"), 20)
    window.shot("found")
    window.click("Project folder", "entry")
    window.wait_for_focus("Project folder")
    window.type(folder)
    window.shot("named")
    window.key("Return")
    window.wait_for("Fit", 120)
    window.shot("opened")


def label(window, name):
    """Adds a label."""
    window.key("n")
    window.wait_for_focus(re.compile("^New name of"))
    window.key("ctrl+a")
    window.type(name)
    window.key("Return")


def frame(window, number):
    """Goes to a frame by the filmstrip."""
    window.click(re.compile(f"^Frame {number},"))


def bananas(window, data):
    """Photos of a bunch of bananas to a labelled cloud with its traits."""
    size = (1504, 1000)
    new_project(window, f"{data}/banana/images", "bananas", "16 images")
    window.click(re.compile("^Cameras & depth: "))
    window.click("Advanced")
    window.shot("advanced")
    window.click("Automatic", "check box")
    window.click("Longest side", "spin button")
    window.key("ctrl+a")
    window.type("480")
    window.key("Return")
    window.shot("reconstruct")
    window.key("r")
    # Masks are made while the cameras are computed.
    label(window, "bananas")
    window.click_image(730, 525, size)
    window.shot("clicked")
    window.wait_until_idle(1500)
    window.shot("reconstructed")
    window.key("t")
    window.wait_until_idle(300)
    window.shot("tracked")
    window.key("u")
    window.wait_until_idle(600)
    window.shot("fused")


def shelf(window, data):
    """An RGB-D recording of a shelf to a cloud of four labelled objects."""
    size = (640, 480)
    new_project(window, f"{data}/apc_shelf_rgbd_labels", "shelf", "15 images")
    boxes = {"book": ((158, 155), (318, 428)), "tissues": ((345, 252), (495, 392)),
             "joke book": ((497, 165), (585, 470)), "stems": ((330, 355), (520, 478))}
    for name, (begin, end) in boxes.items():
        label(window, name)
        window.box_image(begin, end, size)
    window.shot("labelled")
    window.key("t")
    window.wait_until_idle(300)
    window.shot("tracked")
    window.key("u")
    window.wait_until_idle(300)
    window.shot("fused")
    window.key("ctrl+e")
    window.wait_for("Export", 20)
    window.shot("export")


JOBS = {"bananas": bananas, "shelf": shelf}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data")
    parser.add_argument("shots")
    parser.add_argument("--program", default="target/release/ostra")
    parser.add_argument("--size", default="1280x800")
    parser.add_argument("jobs", nargs="*", metavar="JOB", help=", ".join(JOBS))
    options = parser.parse_intermixed_args()
    if unknown := set(options.jobs) - set(JOBS):
        parser.error(f"no job is named {', '.join(sorted(unknown))}; jobs: {', '.join(JOBS)}")
    width, height = map(int, options.size.split("x"))
    display = Display(width, height)
    try:
        for name in options.jobs or JOBS:
            window = Window(os.path.abspath(options.program), os.path.join(options.shots, name), (width, height))
            try:
                JOBS[name](window, os.path.abspath(options.data))
                print(window.report(name), flush=True)
            finally:
                window.close()
    finally:
        display.close()


if __name__ == "__main__":
    main()

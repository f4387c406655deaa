"""Input images for the references."""

import numpy as np
from PIL import Image


def made_pictures():
    """Yields two synthetic images of shapes in front of a gradient: a wide one and a tall one."""
    for width, height in ((300, 200), (90, 160)):
        y, x = np.mgrid[:height, :width] / height
        picture = np.stack([200 * y, 60 + 90 * x, 220 - 120 * y * x], -1)
        picture[(x - 0.3) ** 2 + (y - 0.4) ** 2 < 0.05] = (230, 200, 40)
        picture[(abs(x - 0.35) < 0.2) & (abs(y - 0.75) < 0.1)] = (30, 60, 90)
        picture[abs(x - 0.9 * y) < 0.01] = (250, 250, 250)
        yield Image.fromarray(picture.astype(np.uint8))


def pictures(folder):
    if folder is None:
        yield from made_pictures()
        return
    files = sorted(folder.iterdir())
    for at in (0, len(files) // 2):
        yield Image.open(files[at]).convert("RGB")


def half_a_pixel(picture):
    """Returns the image shifted to the left by half a pixel."""
    right = np.concatenate([picture[:, 1:], picture[:, -1:]], 1)
    return ((picture.astype(np.uint16) + right + 1) // 2).astype(np.uint8)

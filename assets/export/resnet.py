"""The image encoder of DeAOT: ResNet-50 up to its third stage, at a sixteenth of the image size.

He, Zhang, Ren, Sun: "Deep Residual Learning for Image Recognition", CVPR 2016.
"""

import torch
import torch.nn.functional as F
from torch import nn

EXPANSION = 4
STRIDES = (1, 2, 2)


class FrozenNorm(nn.Module):
    """Batch normalisation with fixed statistics from training."""

    def __init__(self, channels):
        super().__init__()
        self.register_buffer("weight", torch.ones(channels))
        self.register_buffer("bias", torch.zeros(channels))
        self.register_buffer("running_mean", torch.zeros(channels))
        self.register_buffer("running_var", torch.ones(channels))

    def forward(self, x):
        return F.batch_norm(x, self.running_mean, self.running_var, self.weight, self.bias, eps=1e-5)


class Bottleneck(nn.Module):
    def __init__(self, channels, width, stride):
        super().__init__()
        out = EXPANSION * width
        self.conv1 = nn.Conv2d(channels, width, 1, bias=False)
        self.bn1 = FrozenNorm(width)
        self.conv2 = nn.Conv2d(width, width, 3, stride, 1, bias=False)
        self.bn2 = FrozenNorm(width)
        self.conv3 = nn.Conv2d(width, out, 1, bias=False)
        self.bn3 = FrozenNorm(out)
        if stride != 1 or channels != out:
            self.downsample = nn.Sequential(nn.Conv2d(channels, out, 1, stride, bias=False), FrozenNorm(out))
        else:
            self.downsample = nn.Identity()

    def forward(self, x):
        near = F.relu(self.bn1(self.conv1(x)))
        near = F.relu(self.bn2(self.conv2(near)))
        return F.relu(self.bn3(self.conv3(near)) + self.downsample(x))


def stage(channels, width, blocks, stride):
    first = Bottleneck(channels, width, stride)
    return nn.Sequential(first, *(Bottleneck(EXPANSION * width, width, 1) for _ in range(blocks - 1)))


class ResNet(nn.Module):
    """Computes features of an image at a quarter, an eighth and a sixteenth of its size."""

    def __init__(self, width, blocks):
        super().__init__()
        self.conv1 = nn.Conv2d(3, width, 7, 2, 3, bias=False)
        self.bn1 = FrozenNorm(width)
        channels = [width, *(EXPANSION * width * 2**at for at in range(2))]
        stages = [stage(channels[at], width * 2**at, blocks[at], STRIDES[at]) for at in range(3)]
        self.layer1, self.layer2, self.layer3 = stages

    def forward(self, image):
        x = F.relu(self.bn1(self.conv1(image)))
        fine = self.layer1(F.max_pool2d(x, 3, 2, 1))
        middle = self.layer2(fine)
        return fine, middle, self.layer3(middle)

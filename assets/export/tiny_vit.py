"""The image encoder of MobileSAM, with the parameter names of its official checkpoint.

Wu et al.: "TinyViT: Fast Pretraining Distillation for Small Vision Transformers", ECCV 2022.
Zhang et al.: "Faster Segment Anything: Towards Lightweight SAM for Mobile Applications", arXiv 2306.14289.
"""

import torch
import torch.nn.functional as F
from torch import nn

WIDTHS = (64, 128, 160, 320)
DEPTHS = (2, 2, 6, 2)
HEADS = (2, 4, 5, 10)
WINDOWS = (7, 7, 14, 7)
# Side of a cell in each stage, in pixels. The last stage keeps the size of the stage before.
CELLS = (4, 8, 16, 16)
CLASSES = 1000  # outputs of an unused head in the checkpoint


def conv_norm(inputs, outputs, kernel=1, stride=1, groups=1):
    parts = nn.Sequential()
    parts.add_module("c", nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, groups=groups, bias=False))
    parts.add_module("bn", nn.BatchNorm2d(outputs))
    return parts


class PatchEmbed(nn.Module):
    def __init__(self, width):
        super().__init__()
        self.seq = nn.Sequential(conv_norm(3, width // 2, 3, 2), nn.GELU(), conv_norm(width // 2, width, 3, 2))

    def forward(self, x):
        return self.seq(x)


class ConvBlock(nn.Module):
    def __init__(self, width):
        super().__init__()
        self.conv1 = conv_norm(width, 4 * width)
        self.conv2 = conv_norm(4 * width, 4 * width, 3, groups=4 * width)
        self.conv3 = conv_norm(4 * width, width)

    def forward(self, x):
        return F.gelu(x + self.conv3(F.gelu(self.conv2(F.gelu(self.conv1(x))))))


class Merging(nn.Module):
    """Changes cells to the width of the next stage, and to its size where that is smaller."""

    def __init__(self, inputs, outputs, stride):
        super().__init__()
        self.conv1 = conv_norm(inputs, outputs)
        self.conv2 = conv_norm(outputs, outputs, 3, stride, outputs)
        self.conv3 = conv_norm(outputs, outputs)

    def forward(self, x):
        return self.conv3(F.gelu(self.conv2(F.gelu(self.conv1(x)))))


class WindowAttention(nn.Module):
    """Attention within windows, with a learned bias for each distance in rows and columns."""

    def __init__(self, width, heads, window):
        super().__init__()
        self.heads, self.window = heads, window
        self.norm = nn.LayerNorm(width)
        self.qkv = nn.Linear(width, 3 * width)
        self.proj = nn.Linear(width, width)
        self.attention_biases = nn.Parameter(torch.zeros(heads, window * window))

    def forward(self, x):
        rows, columns = (part.flatten() for part in torch.meshgrid(*[torch.arange(self.window)] * 2, indexing="ij"))
        apart = [(axis[:, None] - axis[None, :]).abs() for axis in (rows, columns)]
        offsets = self.attention_biases[:, apart[0] * self.window + apart[1]]
        q, k, v = self.qkv(self.norm(x)).unflatten(-1, (self.heads, -1)).transpose(1, 2).chunk(3, -1)
        scores = (q @ k.transpose(-1, -2)) * q.shape[-1] ** -0.5 + offsets
        return self.proj((scores.softmax(-1) @ v).transpose(1, 2).flatten(2))


class Mlp(nn.Module):
    def __init__(self, width):
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.fc1 = nn.Linear(width, 4 * width)
        self.fc2 = nn.Linear(4 * width, width)

    def forward(self, x):
        return self.fc2(F.gelu(self.fc1(self.norm(x))))


class AttentionBlock(nn.Module):
    def __init__(self, width, heads, window):
        super().__init__()
        self.window = window
        self.attn = WindowAttention(width, heads, window)
        self.mlp = Mlp(width)
        self.local_conv = conv_norm(width, width, 3, groups=width)

    def forward(self, x):
        x = self.local_conv(x + self.in_windows(x.permute(0, 2, 3, 1)).permute(0, 3, 1, 2))
        return x + self.mlp(x.permute(0, 2, 3, 1)).permute(0, 3, 1, 2)

    def in_windows(self, x):
        """Applies attention in windows. Zeros pad the last windows."""
        n, w, width = int(x.shape[1]), self.window, int(x.shape[3])
        count = -(-n // w)
        x = F.pad(x, (0, 0, 0, count * w - n, 0, count * w - n))
        x = x.reshape(count, w, count, w, width).transpose(1, 2).reshape(count * count, w * w, width)
        x = self.attn(x).reshape(count, count, w, w, width).transpose(1, 2)
        return x.reshape(1, count * w, count * w, width)[:, :n, :n]


class Stage(nn.Module):
    def __init__(self, at):
        super().__init__()
        block = (lambda: ConvBlock(WIDTHS[0])) if at == 0 else lambda: AttentionBlock(WIDTHS[at], HEADS[at], WINDOWS[at])
        self.blocks = nn.ModuleList(block() for _ in range(DEPTHS[at]))
        self.downsample = None
        if at + 1 < len(WIDTHS):
            self.downsample = Merging(WIDTHS[at], WIDTHS[at + 1], CELLS[at + 1] // CELLS[at])

    def forward(self, x):
        for block in self.blocks:
            x = block(x)
        return x if self.downsample is None else self.downsample(x)


class TinyVit(nn.Module):
    """Computes the embedding of an image [1, 3, side, side]. `neck` changes it to the width of the decoder."""

    def __init__(self, neck):
        super().__init__()
        self.patch_embed = PatchEmbed(WIDTHS[0])
        self.layers = nn.ModuleList(Stage(at) for at in range(len(WIDTHS)))
        self.norm_head = nn.LayerNorm(WIDTHS[-1])
        self.head = nn.Linear(WIDTHS[-1], CLASSES)
        self.neck = neck

    def forward(self, image):
        x = self.patch_embed(image)
        for stage in self.layers:
            x = stage(x)
        return self.neck(x)

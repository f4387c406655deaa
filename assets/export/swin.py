"""The Swin Transformer, the image encoder of Grounding DINO (see `grounding_dino.py`).

Liu et al.: "Swin Transformer: Hierarchical Vision Transformer using Shifted Windows", ICCV 2021.
"""

import torch
import torch.nn.functional as F
from torch import nn

PATCH = 4
# Added to the scores of two cells that share a window but are not neighbours in the image.
APART = -100.0


class WindowAttention(nn.Module):
    """Attention among the cells of a window, with a learned bias for every distance."""

    def __init__(self, width, heads, window):
        super().__init__()
        self.heads, self.cells = heads, window * window
        self.relative_position_bias_table = nn.Parameter(torch.zeros((2 * window - 1) ** 2, heads))
        rows, columns = torch.meshgrid(torch.arange(window), torch.arange(window), indexing="ij")
        places = torch.stack([rows.flatten(), columns.flatten()])
        apart = places[:, :, None] - places[:, None, :] + window - 1
        self.register_buffer("relative_position_index", apart[0] * (2 * window - 1) + apart[1])
        self.qkv = nn.Linear(width, 3 * width)
        self.proj = nn.Linear(width, width)

    def forward(self, x, apart):
        """Returns the attention output of `x` [windows, cells, width].

        `apart` [windows, cells, cells], if not None, is added to the scores.
        """
        head = x.shape[-1] // self.heads
        q, k, v = self.qkv(x).reshape(-1, self.cells, 3, self.heads, head).permute(2, 0, 3, 1, 4).unbind()
        offsets = self.relative_position_bias_table[self.relative_position_index.flatten()]
        offsets = offsets.reshape(self.cells, self.cells, self.heads).permute(2, 0, 1)
        scores = (q * head**-0.5) @ k.transpose(-1, -2) + offsets
        if apart is not None:
            scores = scores + apart[:, None]
        return self.proj((scores.softmax(-1) @ v).transpose(1, 2).flatten(2))


class Mlp(nn.Module):
    def __init__(self, width):
        super().__init__()
        self.fc1 = nn.Linear(width, 4 * width)
        self.fc2 = nn.Linear(4 * width, width)

    def forward(self, x):
        return self.fc2(F.gelu(self.fc1(x)))


def windows_of(x, window):
    """Splits cells [rows, columns, width] into windows [windows, cells, width]."""
    rows, columns, width = x.shape
    x = x.reshape(rows // window, window, columns // window, window, width).transpose(1, 2)
    return x.reshape(-1, window * window, width)


def apart_after_shift(rows, columns, window, shift):
    """Returns `APART` for pairs of cells that share a window only because of the shift, and 0 for other pairs."""
    part = lambda at, count: (at >= count - window).long() + (at >= count - shift).long()  # noqa: E731
    rows, columns = part(torch.arange(rows), rows), part(torch.arange(columns), columns)
    parts = windows_of((3 * rows[:, None] + columns[None, :])[:, :, None], window)[:, :, 0]
    return (parts[:, :, None] != parts[:, None, :]).float() * APART


class Block(nn.Module):
    def __init__(self, width, heads, window, is_shifted):
        super().__init__()
        self.window, self.shift = window, window // 2 if is_shifted else 0
        self.norm1 = nn.LayerNorm(width)
        self.attn = WindowAttention(width, heads, window)
        self.norm2 = nn.LayerNorm(width)
        self.mlp = Mlp(width)

    def forward(self, x):
        x = x + self.in_windows(self.norm1(x))
        return x + self.mlp(self.norm2(x))

    def in_windows(self, x):
        """Applies attention in windows. Zeros pad the last windows."""
        (rows, columns, width), w, shift = x.shape, self.window, self.shift
        x = F.pad(x, (0, 0, 0, -columns % w, 0, -rows % w))
        full_rows, full_columns = x.shape[0], x.shape[1]
        apart = None
        if shift:
            x = x.roll((-shift, -shift), (0, 1))
            apart = apart_after_shift(full_rows, full_columns, w, shift)
        x = self.attn(windows_of(x, w), apart)
        x = x.reshape(full_rows // w, full_columns // w, w, w, width).transpose(1, 2)
        x = x.reshape(full_rows, full_columns, width)
        if shift:
            x = x.roll((shift, shift), (0, 1))
        return x[:rows, :columns]


class PatchMerging(nn.Module):
    """Merges four cells into one of twice the width."""

    def __init__(self, width):
        super().__init__()
        self.reduction = nn.Linear(4 * width, 2 * width, bias=False)
        self.norm = nn.LayerNorm(4 * width)

    def forward(self, x):
        x = F.pad(x, (0, 0, 0, x.shape[1] % 2, 0, x.shape[0] % 2))
        x = torch.cat([x[0::2, 0::2], x[1::2, 0::2], x[0::2, 1::2], x[1::2, 1::2]], -1)
        return self.reduction(self.norm(x))


class Stage(nn.Module):
    def __init__(self, width, depth, heads, window, is_last):
        super().__init__()
        self.blocks = nn.ModuleList(Block(width, heads, window, at % 2 == 1) for at in range(depth))
        self.downsample = None if is_last else PatchMerging(width)

    def forward(self, x):
        for block in self.blocks:
            x = block(x)
        return x


class PatchEmbed(nn.Module):
    def __init__(self, width):
        super().__init__()
        self.proj = nn.Conv2d(3, width, PATCH, PATCH)
        self.norm = nn.LayerNorm(width)

    def forward(self, image):
        """Turns an image [1, 3, height, width] into cells [rows, columns, width]."""
        rows, columns = image.shape[2], image.shape[3]
        x = self.proj(F.pad(image, (0, -columns % PATCH, 0, -rows % PATCH)))
        return self.norm(x[0].permute(1, 2, 0))


class Swin(nn.Module):
    """Computes the features [1, width, rows, columns] of stages 2, 3 and 4 of an image [1, 3, height, width]."""

    def __init__(self, width, depths, heads, window):
        super().__init__()
        self.patch_embed = PatchEmbed(width)
        last = len(depths) - 1
        stages = enumerate(zip(depths, heads))
        self.layers = nn.ModuleList(Stage(width << at, depth, of, window, at == last) for at, (depth, of) in stages)
        self.norm1, self.norm2, self.norm3 = (nn.LayerNorm(width << at) for at in (1, 2, 3))

    def forward(self, image):
        x, given = self.patch_embed(image), []
        for stage, norm in zip(self.layers, [None, self.norm1, self.norm2, self.norm3]):
            x = stage(x)
            if norm is not None:
                given.append(norm(x).permute(2, 0, 1)[None])
            if stage.downsample is not None:
                x = stage.downsample(x)
        return given

"""The gated propagation module of DeAOT.

One branch carries the appearance of the image, the other the identity of the objects. Tokens have the shape
[cells, channels], with the cells of a `height · width` grid in row order.

Yang, Yang: "Decoupling Features in Hierarchical Propagation for Video Object Segmentation", NeurIPS 2022.
"""

from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import nn

REACH = 7  # cells that an object may move between two images
WINDOW = 2 * REACH + 1
FAR = -1e8  # score of cells outside the window
# Chunks of queries for the long-term memory. The scores of all queries at once would be by far the largest tensor.
PARTS = 4


def grid(tokens, size):
    """Returns tokens as a grid [1, channels, height, width]."""
    return tokens.transpose(0, 1).reshape(1, tokens.shape[1], *size)


def tokens(grid):
    return grid.flatten(2)[0].transpose(0, 1)


class DepthwiseConv(nn.Module):
    def __init__(self, channels):
        super().__init__()
        self.conv = nn.Conv2d(channels, channels, 5, padding=2, groups=channels, bias=False)

    def forward(self, x, size):
        return tokens(self.conv(grid(x, size)))


def attend(q, k, values, bias=0):
    """Returns the attention output of each query for every tensor of `values`, concatenated."""
    scores = (q * q.shape[-1] ** -0.5) @ k.transpose(0, 1)
    weights = (scores + bias).softmax(-1)
    return torch.cat([weights @ value for value in values], -1)


def spread(near, size):
    """Expands the window scores of each cell [cells, 15 · 15] to [cells, cells]. Other cells get the score `FAR`.

    The window of the next cell begins one cell later. `skew` therefore pads every row to one element more than a row
    of the reshaped tensor. This shifts each row by one more element than the row before.
    """
    height, width = size
    near = near.reshape(height, width, WINDOW, WINDOW).transpose(1, 2)  # y, window row, x, window column
    near = skew(near.reshape(height * WINDOW, width, WINDOW), width)
    near = near.reshape(height, WINDOW, width * width)
    near = near.permute(2, 0, 1)
    near = skew(near, height)  # from x and to x, from y, to y
    near = near.reshape(width, width, height, height).permute(2, 0, 3, 1)
    return near.reshape(height * width, height * width)


def skew(windows, count):
    """Turns [n, count, 15] into [n, count, count]: element `j` of row `i` moves to `i + j - 7`."""
    filled = F.pad(windows, (0, count), value=FAR).flatten(1)
    return filled[:, :-count].reshape(-1, count, count + WINDOW - 1)[:, :, REACH:-REACH]


class MemoryAttention(nn.Module):
    """Attention to the memory of any number of images."""

    def __init__(self, size):
        super().__init__()
        self.dw_conv = DepthwiseConv(4 * size.channels)
        self.projection = nn.Linear(4 * size.channels, 2 * size.channels)

    def gated(self, seen, gate, size):
        return self.projection(self.dw_conv(seen * gate, size))

    def forward(self, q, memory, gate, size):
        k, *values = memory
        bounds = [q.shape[0] * part // PARTS for part in range(PARTS + 1)]
        parts = (q[first:last] for first, last in pairwise(bounds))
        return self.gated(torch.cat([attend(part, k, values) for part in parts]), gate, size)


class NearAttention(MemoryAttention):
    """Attention to the cells around the same position in one image."""

    def __init__(self, size):
        super().__init__(size)
        self.relative_emb_k = nn.Conv2d(size.key, WINDOW**2, 1)

    def forward(self, q, memory, gate, size):
        k, *values = memory
        bias = spread(tokens(self.relative_emb_k(grid(q, size))), size)
        return self.gated(attend(q, k, values, bias), gate, size)


class SelfAttention(MemoryAttention):
    def __init__(self, size):
        super().__init__(size)
        self.linear_QK = nn.Linear(2 * size.channels, size.key)
        halves = (nn.Linear(size.channels, 2 * size.channels) for _ in range(4))
        self.linear_V1, self.linear_V2, self.linear_U1, self.linear_U2 = halves

    def forward(self, what, which, size):
        k = self.linear_QK(torch.cat([what, which], -1))
        values = [F.silu(self.linear_V1(what)), F.silu(self.linear_V2(which))]
        gate = F.silu(torch.cat([self.linear_U1(what), self.linear_U2(which)], -1))
        return self.gated(attend(k, k, values), gate, size)


class Layer(nn.Module):
    """One step of both branches. A memory holds (key, value, identity) tokens."""

    def __init__(self, size, is_first):
        super().__init__()
        channels, self.key = size.channels, size.key
        self.is_first = is_first
        self.norm1 = nn.LayerNorm(channels)
        self.linear_QV = nn.Linear(channels, size.key + 2 * channels)
        self.linear_U = nn.Linear(channels, 2 * channels)
        if is_first:
            self.linear_ID_V = nn.Linear(channels, 2 * channels)
        else:
            self.id_norm1 = nn.LayerNorm(channels)
            self.linear_ID_V = nn.Linear(2 * channels, 2 * channels)
            self.linear_ID_U = nn.Linear(channels, 2 * channels)
        self.long_term_attn = MemoryAttention(size)
        self.short_term_attn = NearAttention(size)
        self.norm2 = nn.LayerNorm(channels)
        self.id_norm2 = nn.LayerNorm(channels)
        self.self_attn = SelfAttention(size)

    def identity(self, trace, ids):
        """Returns the identities to remember for an image, from this layer's trace. The first layer has no trace."""
        return F.silu(self.linear_ID_V(ids if self.is_first else torch.cat([trace, ids], -1)))

    def forward(self, what, which, memory, size):
        """Returns both branches, and the (key, value, trace) of this layer.

        `memory(key, value, trace)` returns the long-term and the short-term memory.
        """
        near = self.norm1(what)
        key, value = self.linear_QV(near).split([self.key, self.linear_U.out_features], -1)
        value, gate = F.silu(value), F.silu(self.linear_U(near))
        if self.is_first:
            trace, gates = None, [gate, torch.ones_like(gate)]
        else:
            trace = self.id_norm1(which)
            gates = [gate, F.silu(self.linear_ID_U(trace))]
        gate = torch.cat(gates, -1)
        long, short = memory(key, value, trace)
        seen = self.long_term_attn(key, long, gate, size) + self.short_term_attn(key, short, gate, size)
        what, which = self.plus(what, which, seen)
        seen = self.self_attn(self.norm2(what), self.id_norm2(which), size)
        return *self.plus(what, which, seen), (key, value, trace)

    @staticmethod
    def plus(what, which, seen):
        first, second = seen.chunk(2, -1)
        return what + first, second if which is None else which + second


class TokenNorm(nn.Module):
    """Normalises each branch over all cells."""

    def __init__(self, channels):
        super().__init__()
        self.gn = nn.GroupNorm(2, channels)

    def forward(self, x):
        return self.gn(x.transpose(0, 1)[None])[0].transpose(0, 1)


class Propagation(nn.Module):
    def __init__(self, size):
        super().__init__()
        self.layers = nn.ModuleList(Layer(size, at == 0) for at in range(size.layers))
        self.decoder_norms = nn.ModuleList([TokenNorm(2 * size.channels)])

    def forward(self, embedding, memories):
        """Returns the tokens of both branches, and the key, value and trace of every layer.

        `memories` holds the `memory` argument of each layer.
        """
        what, which, size = tokens(embedding), None, embedding.shape[2:]
        kept = []
        for layer, memory in zip(self.layers, memories, strict=True):
            what, which, of_layer = layer(what, which, memory, size)
            kept.append(of_layer)
        return self.decoder_norms[0](torch.cat([what, which], -1)), kept

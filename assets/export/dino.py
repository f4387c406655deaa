"""The transformer of Grounding DINO (see `grounding_dino.py`).

Cells and tokens attend to each other, and queries attend to both.

Deformable attention: Zhu et al.: "Deformable DETR", ICLR 2021. Query selection among the cells, and box refinement in
every layer: Zhang et al.: "DINO: DETR with Improved DeNoising Anchor Boxes", ICLR 2023.
"""

import math

import torch
import torch.nn.functional as F
from torch import nn

POINTS = 4  # sampling points of a head in every level
LEVELS = 4
# Side of the box that a cell of the finest level proposes, as a share of the image. It doubles with every level.
PROPOSED = 0.05
# A cell makes no proposal if a value of its box lies closer than this to 0 or 1.
MARGIN = 0.01


def inverse_sigmoid(x):
    x = x.clamp(0, 1)
    return (x.clamp(min=1e-3) / (1 - x).clamp(min=1e-3)).log()


def sines(x, width, temperature):
    """Encodes numbers [...] as alternating sines and cosines of `width` / 2 frequencies, [..., width]."""
    steps = torch.arange(width // 2) * 2 / width
    angles = x[..., None] * (2 * math.pi / temperature**steps)
    return torch.stack([angles.sin(), angles.cos()], -1).flatten(-2)


class Mlp(nn.Module):
    """Linear layers with ReLU between them."""

    def __init__(self, *widths):
        super().__init__()
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in zip(widths, widths[1:]))

    def forward(self, x):
        for layer in self.layers[:-1]:
            x = F.relu(layer(x))
        return self.layers[-1](x)


class Attention(nn.Module):
    """Attention for a batch of one, with the parameters of `torch.nn.MultiheadAttention`."""

    def __init__(self, width, heads):
        super().__init__()
        self.heads = heads
        self.in_proj_weight = nn.Parameter(torch.zeros(3 * width, width))
        self.in_proj_bias = nn.Parameter(torch.zeros(3 * width))
        self.out_proj = nn.Linear(width, width)

    def forward(self, q, k, v, barred=None):
        """Returns the attention output. `barred` is added to the scores."""
        parts = zip((q, k, v), self.in_proj_weight.chunk(3), self.in_proj_bias.chunk(3))
        q, k, v = (F.linear(x, *own).unflatten(-1, (self.heads, -1)).transpose(1, 2) for x, *own in parts)
        scores = (q * q.shape[-1] ** -0.5) @ k.transpose(-1, -2)
        if barred is not None:
            scores = scores + barred
        return self.out_proj((scores.softmax(-1) @ v).transpose(1, 2).flatten(2))


class DeformableAttention(nn.Module):
    """Attention from every query to a few points around its position in each level."""

    def __init__(self, width, heads):
        super().__init__()
        self.heads = heads
        self.sampling_offsets = nn.Linear(width, heads * LEVELS * POINTS * 2)
        self.attention_weights = nn.Linear(width, heads * LEVELS * POINTS)
        self.value_proj = nn.Linear(width, width)
        self.output_proj = nn.Linear(width, width)

    def forward(self, x, places, cells, sizes):
        """Returns the attention output of the queries `x` [1, queries, width].

        `places` holds points [queries, 2] or boxes [queries, 4] as shares of the image. `cells` [1, cells, width] holds
        the cells of all levels. `sizes` gives the (rows, columns) of each level.
        """
        offsets = self.sampling_offsets(x)[0].unflatten(-1, (self.heads, LEVELS, POINTS, 2))
        weights = self.attention_weights(x)[0].unflatten(-1, (self.heads, LEVELS * POINTS)).softmax(-1)
        weights = weights.unflatten(-1, (LEVELS, POINTS)).transpose(0, 1)  # [heads, queries, levels, points]
        counts = [rows * columns for rows, columns in sizes]
        levels = self.value_proj(cells)[0].split(counts)
        seen = 0
        for level, (values, (rows, columns)) in enumerate(zip(levels, sizes)):
            step = offsets[:, :, level].transpose(0, 1)  # [heads, queries, points, 2]
            if places.shape[-1] == 2:
                step = step / torch.stack([torch.as_tensor(columns), torch.as_tensor(rows)])
            else:
                step = step / POINTS * places[None, :, None, 2:] * 0.5
            at = 2 * (places[None, :, None, :2] + step) - 1
            values = values.transpose(0, 1).reshape(self.heads, -1, rows, columns)
            values = F.grid_sample(values, at, mode="bilinear", padding_mode="zeros", align_corners=False)
            seen = seen + (values * weights[:, None, :, level]).sum(-1)  # [heads, width of a head, queries]
        return self.output_proj(seen.flatten(0, 1).transpose(0, 1)[None])


class BothWays(nn.Module):
    """Attention from cells to tokens and from tokens to cells with the same scores."""

    def __init__(self, width, inner, heads):
        super().__init__()
        self.heads = heads
        self.v_proj, self.l_proj, self.values_v_proj, self.values_l_proj = (nn.Linear(width, inner) for _ in range(4))
        self.out_v_proj, self.out_l_proj = nn.Linear(inner, width), nn.Linear(inner, width)

    def forward(self, cells, tokens):
        split = lambda x: x.unflatten(-1, (self.heads, -1)).transpose(1, 2)  # noqa: E731
        joined = lambda x: x.transpose(1, 2).flatten(2)  # noqa: E731
        q, k = split(self.v_proj(cells)), split(self.l_proj(tokens))
        scores = (q * q.shape[-1] ** -0.5) @ k.transpose(-1, -2)
        told = scores.softmax(-1) @ split(self.values_l_proj(tokens))
        seen = scores.transpose(-1, -2).softmax(-1) @ split(self.values_v_proj(cells))
        return self.out_v_proj(joined(told)), self.out_l_proj(joined(seen))


class Fusion(nn.Module):
    def __init__(self, width, inner, heads):
        super().__init__()
        self.layer_norm_v, self.layer_norm_l = nn.LayerNorm(width), nn.LayerNorm(width)
        self.attn = BothWays(width, inner, heads)
        self.gamma_v, self.gamma_l = nn.Parameter(torch.ones(width)), nn.Parameter(torch.ones(width))

    def forward(self, cells, tokens):
        cells, tokens = self.layer_norm_v(cells), self.layer_norm_l(tokens)
        of_cells, of_tokens = self.attn(cells, tokens)
        return cells + self.gamma_v * of_cells, tokens + self.gamma_l * of_tokens


class TextLayer(nn.Module):
    def __init__(self, width, hidden, heads):
        super().__init__()
        self.self_attn = Attention(width, heads)
        self.linear1, self.linear2 = nn.Linear(width, hidden), nn.Linear(hidden, width)
        self.norm1, self.norm2 = nn.LayerNorm(width), nn.LayerNorm(width)

    def forward(self, x, places, barred):
        placed = x + places
        x = self.norm1(x + self.self_attn(placed, placed, x, barred))
        return self.norm2(x + self.linear2(F.relu(self.linear1(x))))


class CellLayer(nn.Module):
    def __init__(self, width, hidden, heads):
        super().__init__()
        self.self_attn = DeformableAttention(width, heads)
        self.linear1, self.linear2 = nn.Linear(width, hidden), nn.Linear(hidden, width)
        self.norm1, self.norm2 = nn.LayerNorm(width), nn.LayerNorm(width)

    def forward(self, x, embedded, places, sizes):
        x = self.norm1(x + self.self_attn(x + embedded, places, x, sizes))
        return self.norm2(x + self.linear2(F.relu(self.linear1(x))))


class Encoder(nn.Module):
    """Layers in which cells and tokens attend to each other, then each to its own kind."""

    def __init__(self, size):
        super().__init__()
        width, hidden, heads = size.width, size.hidden, size.heads
        self.layers = nn.ModuleList(CellLayer(width, hidden, heads) for _ in range(size.depth))
        self.text_layers = nn.ModuleList(TextLayer(width, hidden // 2, heads // 2) for _ in range(size.depth))
        self.fusion_layers = nn.ModuleList(Fusion(width, hidden // 2, heads // 2) for _ in range(size.depth))

    def forward(self, cells, embedded, places, sizes, tokens, positions, barred):
        of_text = sines(positions, tokens.shape[-1], 10000)
        for layer, text_layer, fusion in zip(self.layers, self.text_layers, self.fusion_layers):
            cells, tokens = fusion(cells, tokens)
            tokens = text_layer(tokens, of_text, barred)
            cells = layer(cells, embedded, places, sizes)
        return cells, tokens


class QueryLayer(nn.Module):
    def __init__(self, width, hidden, heads):
        super().__init__()
        self.cross_attn = DeformableAttention(width, heads)
        self.ca_text, self.self_attn = Attention(width, heads), Attention(width, heads)
        self.linear1, self.linear2 = nn.Linear(width, hidden), nn.Linear(hidden, width)
        self.norm1, self.catext_norm, self.norm2, self.norm3 = (nn.LayerNorm(width) for _ in range(4))

    def forward(self, x, embedded, boxes, cells, sizes, tokens):
        placed = x + embedded
        x = self.norm2(x + self.self_attn(placed, placed, x))
        x = self.catext_norm(x + self.ca_text(x + embedded, tokens, tokens))
        x = self.norm1(x + self.cross_attn(x + embedded, boxes, cells, sizes))
        return self.norm3(x + self.linear2(F.relu(self.linear1(x))))


class Decoder(nn.Module):
    """Layers in which queries attend to cells and tokens. Every layer refines the boxes."""

    def __init__(self, size, box_heads):
        super().__init__()
        self.layers = nn.ModuleList(QueryLayer(size.width, size.hidden, size.heads) for _ in range(size.depth))
        self.norm = nn.LayerNorm(size.width)
        self.ref_point_head = Mlp(2 * size.width, size.width, size.width)
        self.bbox_embed = box_heads

    def forward(self, x, boxes, cells, sizes, tokens):
        """Returns the queries [1, queries, width] and their boxes [queries, 4] after the last layer."""
        for layer, box_head in zip(self.layers, self.bbox_embed):
            around = sines(boxes, x.shape[-1] // 2, 10000)  # [queries, 4, width / 2]
            embedded = self.ref_point_head(around[:, [1, 0, 2, 3]].flatten(1))[None]
            x = layer(x, embedded, boxes, cells, sizes, tokens)
            before = boxes
            boxes = (inverse_sigmoid(before) + box_head(x)[0]).sigmoid()
        x = self.norm(x)
        return x, (inverse_sigmoid(before) + self.bbox_embed[-1](x)[0]).sigmoid()


def grid(rows, columns):
    """Returns the centres (x, y) of all cells as shares of the image, [rows · columns, 2]."""
    middles = [(torch.arange(count) + 0.5) / count for count in (rows, columns)]
    down, across = torch.meshgrid(*middles, indexing="ij")
    return torch.stack([across, down], -1).flatten(0, 1)


def embedding_of_grid(rows, columns, width):
    """Returns the position embeddings of all cells, [rows · columns, width]. Rows and columns count from one."""
    share = lambda count: (torch.arange(count) + 1) / (count + 1e-6)  # noqa: E731
    down, across = (sines(share(count), width // 2, 20) for count in (rows, columns))
    down = down[:, None].expand(-1, columns, -1)
    across = across[None].expand(rows, -1, -1)
    return torch.cat([down, across], -1).flatten(0, 1)


class Transformer(nn.Module):
    def __init__(self, size, box_heads):
        super().__init__()
        self.queries = size.queries
        self.encoder = Encoder(size)
        self.decoder = Decoder(size, box_heads)
        self.level_embed = nn.Parameter(torch.zeros(LEVELS, size.width))
        self.tgt_embed = nn.Embedding(size.queries, size.width)
        self.enc_output = nn.Linear(size.width, size.width)
        self.enc_output_norm = nn.LayerNorm(size.width)
        self.enc_out_bbox_embed = Mlp(size.width, size.width, size.width, 4)

    def forward(self, levels, tokens, positions, barred):
        """Returns the queries, their boxes and the tokens.

        `levels` holds features [1, width, rows, columns] from fine to coarse. `tokens` is [1, tokens, width].
        """
        sizes = [(level.shape[2], level.shape[3]) for level in levels]
        cells = torch.cat([level.flatten(2).transpose(1, 2) for level in levels], 1)
        embedded = [embedding_of_grid(*of, cells.shape[-1]) + own for of, own in zip(sizes, self.level_embed)]
        places = [grid(*of) for of in sizes]
        embedded = torch.cat(embedded)[None]
        cells, tokens = self.encoder(cells, embedded, torch.cat(places), sizes, tokens, positions, barred)
        boxes = self.chosen(cells, places, tokens)
        x, boxes = self.decoder(self.tgt_embed.weight[None], boxes, cells, sizes, tokens)
        return x, boxes, tokens

    def chosen(self, cells, places, tokens):
        """Returns the boxes [queries, 4] of the cells with the best score for any token, best first."""
        side = lambda at, level: torch.full_like(at, PROPOSED * 2**level)  # noqa: E731
        proposed = torch.cat([torch.cat([at, side(at, level)], -1) for level, at in enumerate(places)])
        is_within = ((proposed > MARGIN) & (proposed < 1 - MARGIN)).all(-1, keepdim=True)
        cells = self.enc_output_norm(self.enc_output(cells[0] * is_within))
        best = (cells @ tokens[0].transpose(0, 1)).max(-1).values.topk(self.queries).indices
        # For cells without a proposal, all four box values are 1: the centre is the lower right corner of the image.
        proposed = (proposed / (1 - proposed)).log().masked_fill(~is_within, math.inf)
        return (proposed[best] + self.enc_out_bbox_embed(cells[best])).sigmoid()

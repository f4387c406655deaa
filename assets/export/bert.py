"""BERT, the text encoder of Grounding DINO (see `grounding_dino.py`).

Devlin et al.: "BERT: Pre-training of Deep Bidirectional Transformers for Language Understanding", NAACL 2019.
"""

import torch.nn.functional as F
from torch import nn

NORM_EPSILON = 1e-12
KINDS = 2  # sentence types; a caption uses the first


class Embeddings(nn.Module):
    def __init__(self, width, vocabulary, places):
        super().__init__()
        self.word_embeddings = nn.Embedding(vocabulary, width)
        self.position_embeddings = nn.Embedding(places, width)
        self.token_type_embeddings = nn.Embedding(KINDS, width)
        self.LayerNorm = nn.LayerNorm(width, NORM_EPSILON)

    def forward(self, ids, positions):
        kind = self.token_type_embeddings.weight[0]
        return self.LayerNorm(self.word_embeddings(ids) + kind + self.position_embeddings(positions))


class SelfAttention(nn.Module):
    def __init__(self, width, heads):
        super().__init__()
        self.heads = heads
        self.query, self.key, self.value = (nn.Linear(width, width) for _ in range(3))

    def forward(self, x, barred):
        own = (self.query, self.key, self.value)
        q, k, v = (part(x).unflatten(-1, (self.heads, -1)).transpose(1, 2) for part in own)
        scores = (q @ k.transpose(-1, -2)) * q.shape[-1] ** -0.5 + barred
        return (scores.softmax(-1) @ v).transpose(1, 2).flatten(2)


class Residual(nn.Module):
    """Adds the output of a linear layer to the residual input and normalises the sum."""

    def __init__(self, width_in, width):
        super().__init__()
        self.dense = nn.Linear(width_in, width)
        self.LayerNorm = nn.LayerNorm(width, NORM_EPSILON)

    def forward(self, x, before):
        return self.LayerNorm(self.dense(x) + before)


class Attention(nn.Module):
    def __init__(self, width, heads):
        super().__init__()
        self.add_module("self", SelfAttention(width, heads))
        self.output = Residual(width, width)

    def forward(self, x, barred):
        return self.output(getattr(self, "self")(x, barred), x)


class Dense(nn.Module):
    def __init__(self, width_in, width):
        super().__init__()
        self.dense = nn.Linear(width_in, width)


class Layer(nn.Module):
    def __init__(self, width, heads, hidden):
        super().__init__()
        self.attention = Attention(width, heads)
        self.intermediate = Dense(width, hidden)
        self.output = Residual(hidden, width)

    def forward(self, x, barred):
        x = self.attention(x, barred)
        return self.output(F.gelu(self.intermediate.dense(x)), x)


class Encoder(nn.Module):
    def __init__(self, width, depth, heads, hidden):
        super().__init__()
        self.layer = nn.ModuleList(Layer(width, heads, hidden) for _ in range(depth))


class Pooler(Dense):
    """Unused head that is part of every checkpoint."""


class Bert(nn.Module):
    """Encodes tokens [1, tokens] as features [1, tokens, width].

    `barred` [1, 1, tokens, tokens] is added to the attention scores of each pair of tokens.
    """

    def __init__(self, width, depth, heads, hidden, vocabulary, places):
        super().__init__()
        self.embeddings = Embeddings(width, vocabulary, places)
        self.encoder = Encoder(width, depth, heads, hidden)
        self.pooler = Pooler(width, width)

    def forward(self, ids, positions, barred):
        x = self.embeddings(ids, positions)
        for layer in self.encoder.layer:
            x = layer(x, barred)
        return x

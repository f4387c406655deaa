#!/usr/bin/env python3
"""Writes `words.json`: tokens and captions of Grounding DINO from `transformers`, with a small vocabulary.

    pip install torch transformers
    python3 tests/parity/words.py
"""

import json
import tempfile
from pathlib import Path

import torch
from transformers import BertTokenizer
from transformers.models.grounding_dino import modeling_grounding_dino as reference

PIECES = """[PAD] [UNK] [CLS] [SEP] [MASK] . ? , - ' ! ( ) & · a b c d e r s t cat dog red rice panic un ##s ##le ##les
##d ##a ##able ##ni ##c the of left leaf naive cafe on stem 1 12 ##2 稻 ##穗 穗 ß ø""".split()
TEXTS = [
    "cat",
    "The Red cats",
    "panicle of rice",
    "panicles",
    "unable",
    "leaf-stem",
    "cat's",
    "naïve CAFÉ",
    "cafe\u0301",
    "  red\tcat \n",
    "dog\u200bdog",
    "稻穗 cat",
    "zebra",
    "12 122 1",
    "(red) dog, cat!",
    "a&b·c",
    "ß ø",
    "c" * 101,
    "",
]
CAPTIONS = [["cat"], ["the red cat", "panicle of rice", "zebra"], ["Cats.", "dog "]]


def attention(tokenizer, ids):
    """Returns the mask and positions of the reference, called with the special token ids of this vocabulary."""
    own = [tokenizer.convert_tokens_to_ids(token) for token in ("[CLS]", "[SEP]", ".", "?")]
    masks = reference.generate_masks_with_special_tokens_and_transfer_map
    mask, positions = masks(torch.tensor([ids]), torch.tensor(own))
    return mask[0].int().tolist(), positions[0].tolist()


def main():
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "vocab.txt"
        path.write_text("\n".join(PIECES) + "\n")
        tokenizer = BertTokenizer(vocab=str(path), vocab_file=str(path), do_lower_case=True)
    texts = [(text, tokenizer(text, add_special_tokens=False)["input_ids"]) for text in TEXTS]
    captions = []
    for phrases in CAPTIONS:
        caption = " ".join(phrase.strip().lower().rstrip(".") + "." for phrase in phrases)
        ids = tokenizer(caption)["input_ids"]
        mask, positions = attention(tokenizer, ids)
        captions.append({"phrases": phrases, "ids": ids, "positions": positions, "attention": mask})
    told = {"vocabulary": PIECES, "texts": texts, "captions": captions}
    Path(__file__).with_suffix(".json").write_text(json.dumps(told, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()

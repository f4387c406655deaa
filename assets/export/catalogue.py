#!/usr/bin/env python3
"""Writes addresses, sizes and digests of published files into the catalogue of networks.

    python3 assets/export/catalogue.py xmem OUT --release https://github.com/OWNER/REPO/releases/download/models-1

For each file of the entry, the catalogue gets the lines `url`, `bytes` and `sha256` of the file of that name in OUT.
They replace earlier ones. Of an entry with variants, the files of one variant are changed.

    --variant NAME       variant to change, `exported` by default
    --catalogue FILE     catalogue to change, assets/models.toml by default
    --print              only print the lines

All other lines, comments included, stay as they are.
"""

import argparse
import hashlib
import re
import sys
from pathlib import Path

CATALOGUE = Path(__file__).resolve().parent.parent / "models.toml"
REPLACED = ("url", "bytes", "sha256")


def blocks(lines):
    """Yields the header of each table and the range of its lines."""
    starts = [at for at, line in enumerate(lines) if line.startswith("[")]
    for at, end in zip(starts, [*starts[1:], len(lines)]):
        yield lines[at].strip(), at, end


def name_in(lines, start, end):
    """Returns the name of the table in these lines."""
    for line in lines[start + 1 : end]:
        found = re.match(r'name = "(.*)"', line)
        if found:
            return found[1]
    return None


def files_of(lines, entry, variant):
    """Returns the ranges of lines of the files of an entry, by file name."""
    found, in_entry, in_variant = {}, False, True
    for header, start, end in blocks(lines):
        if header == "[[entry]]":
            in_entry, in_variant = name_in(lines, start, end) == entry, True
        elif header == "[[entry.variant]]":
            in_variant = name_in(lines, start, end) == variant
        elif header in ("[[entry.file]]", "[[entry.variant.file]]") and in_entry and in_variant:
            found[name_in(lines, start, end)] = (start, end)
    return found


def described(path, release):
    """Returns the lines of a published file."""
    content = path.read_bytes()
    return [
        f'url = "{release.rstrip("/")}/{path.name}"\n',
        f"bytes = {len(content)}\n",
        f'sha256 = "{hashlib.sha256(content).hexdigest()}"\n',
    ]


def changed(lines, files, folder, release):
    """Returns the lines of the catalogue with the published files."""
    lines = list(lines)
    for name, (start, end) in sorted(files.items(), key=lambda file: -file[1][0]):
        kept = [line for line in lines[start:end] if line.split(" = ")[0] not in REPLACED]
        at = 1 + next(at for at, line in enumerate(kept) if line.startswith("name = "))
        lines[start:end] = [*kept[:at], *described(folder / name, release), *kept[at:]]
    return lines


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("entry")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--release", required=True)
    parser.add_argument("--variant", default="exported")
    parser.add_argument("--catalogue", type=Path, default=CATALOGUE)
    parser.add_argument("--print", action="store_true", dest="only_print")
    args = parser.parse_args()
    lines = args.catalogue.read_text(encoding="utf-8").splitlines(keepends=True)
    files = files_of(lines, args.entry, args.variant)
    if not files:
        sys.exit(f"{args.catalogue} has no files of '{args.entry}' (variant '{args.variant}')")
    missing = [name for name in files if not (args.folder / name).is_file()]
    if missing:
        sys.exit(f"{args.folder} lacks {', '.join(missing)}")
    for name in files:
        print(f"{args.entry}: {name}")
        print("".join(described(args.folder / name, args.release)), end="")
    if not args.only_print:
        args.catalogue.write_text("".join(changed(lines, files, args.folder, args.release)), encoding="utf-8")


if __name__ == "__main__":
    main()

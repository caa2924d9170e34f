"""Hand damaged files to the readers: `python -m tests.fuzz.run [--cases 400] [--salt 0] [--only scan-laz ...]`.

A reader may accept a file, or raise a child of AquanavError. All else is a fault: another exception, a crash, a hang.
"""

from __future__ import annotations

import argparse
import collections
import shutil
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

from tests.fuzz.mutate import write_case
from tests.fuzz.outcome import FINE, outcome
from tests.fuzz.readers import READERS
from tests.fuzz.seeds import write_seeds

DECODED = (".laz", ".e57", ".dae", ".3mf", ".usda", ".usdc", ".usdz")
"""Endings of files that a reader has decoded in a process of its own, which takes a second to start."""


def reader_of(seed: Path) -> Callable[[Path], object]:
    """Return the reader that a seed's name begins with."""
    return READERS[seed.stem.split("-")[0]]


def fuzz(seed: Path, cases: int, salt: int) -> collections.Counter[str]:
    """Return how often each outcome came, of so many cases of one seed."""
    reader = reader_of(seed)
    seen: collections.Counter[str] = collections.Counter()
    for number in range(cases):
        folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
        try:
            found = outcome(reader, write_case(seed, number, folder, salt))
        finally:
            shutil.rmtree(folder)
        if found not in FINE and found not in seen:
            print(f"FAULT {seed.name}, case {number} of salt {salt}: {found}", flush=True)
        seen[found] += 1
    return seen


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=400, help="of each seed")
    parser.add_argument("--decoder-cases", type=int, help="of each seed decoded in a process of its own; else as many")
    parser.add_argument("--salt", type=int, default=0, help="other numbers damage otherwise")
    parser.add_argument("--only", nargs="+", default=[""], help="beginnings of names of seeds")
    options = parser.parse_args()
    warnings.filterwarnings("ignore")
    total: collections.Counter[str] = collections.Counter()
    with tempfile.TemporaryDirectory() as folder:
        for seed in write_seeds(Path(folder)):
            if not seed.name.startswith(tuple(options.only)):
                continue
            is_slow = seed.suffix in DECODED and options.decoder_cases is not None
            seen = fuzz(seed, options.decoder_cases if is_slow else options.cases, options.salt)
            if (whole := outcome(reader_of(seed), seed)) != "accepted":
                seen[f"the seed itself: {whole}"] += 1
                print(f"FAULT {seed.name}, undamaged: {whole}")
            print(seed.name, dict(seen), flush=True)
            total += seen
    if not total:
        parser.error(f"no seed's name begins with {' or '.join(options.only)}")
    faults = sum(count for found, count in total.items() if found not in FINE)
    print(f"{total.total()} files: {total['accepted']} accepted, {total['refused']} refused, {faults} faults")
    sys.exit(faults > 0)


if __name__ == "__main__":
    main()

"""Hand damaged files to the readers: `python -m tests.fuzz.run [--cases 400] [--salt 0] [--only scan-laz ...]`.

Each case runs in a process of its own with 4 GiB of memory beyond the parent's and 20 s of processor time. A reader may
accept the file, or raise a child of AquanavError. All else is a fault: another exception, a crash, a hang.
"""

from __future__ import annotations

import argparse
import collections
import os
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path

from aquanav_tools.errors import AquanavError
from tests.fuzz.mutate import write_case
from tests.fuzz.readers import READERS
from tests.fuzz.seeds import write_seeds

MEMORY = 4 << 30
CPU_SECONDS, WALL_SECONDS = 20, 300
FINE = ("accepted", "refused")


def reader_of(seed: Path) -> Callable[[Path], object]:
    """Return the reader that a seed's name begins with."""
    return READERS[seed.stem.split("-")[0]]


def outcome(reader: Callable[[Path], object], path: Path) -> str:
    """Return "accepted" or "refused", or what went wrong."""
    trace = path.parent / "trace"
    child = os.fork()
    if child == 0:
        _read(reader, path, trace)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if status in (0, 1):
        return FINE[status]
    if status < 0:
        sign = signal.Signals(-status)
        return "hang" if sign in (signal.SIGXCPU, signal.SIGALRM) else f"ended by {sign.name}"
    lines = trace.read_text().strip().splitlines() if trace.exists() else [f"exit code {status}"]
    ours = [line.strip() for line in lines if "aquanav_tools" in line]
    return f"{lines[-1][:120]} @ {ours[-1][-90:] if ours else '?'}"


def _read(reader: Callable[[Path], object], path: Path, trace: Path) -> None:
    """Read a file and end this process."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS + 5))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.alarm(WALL_SECONDS)
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    try:
        reader(path)
        os._exit(0)
    except AquanavError:
        os._exit(1)
    except BaseException:
        trace.write_text(traceback.format_exc())
        os._exit(3)


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
    parser.add_argument("--salt", type=int, default=0, help="other numbers damage otherwise")
    parser.add_argument("--only", nargs="+", default=[""], help="beginnings of names of seeds")
    options = parser.parse_args()
    warnings.filterwarnings("ignore")
    total: collections.Counter[str] = collections.Counter()
    with tempfile.TemporaryDirectory() as folder:
        for seed in write_seeds(Path(folder)):
            if not seed.name.startswith(tuple(options.only)):
                continue
            seen = fuzz(seed, options.cases, options.salt)
            if (whole := outcome(reader_of(seed), seed)) != "accepted":
                seen[f"the seed itself: {whole}"] += 1
                print(f"FAULT {seed.name}, undamaged: {whole}")
            print(seed.name, dict(seen), flush=True)
            total += seen
    faults = sum(count for found, count in total.items() if found not in FINE)
    print(f"{total.total()} files: {total['accepted']} accepted, {total['refused']} refused, {faults} faults")
    sys.exit(faults > 0)


if __name__ == "__main__":
    main()

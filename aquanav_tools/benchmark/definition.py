"""Which caves a benchmark consists of, and under which rules they are dived: files in eval/sets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.protocol import Condition
from aquanav_tools.provenance import file_hash
from aquanav_tools.scenario.shipped import SETTINGS_FILE, named_folder, slot_names
from aquanav_tools.shipped import shipped_path
from aquanav_tools.tables import from_table, read_toml

SETS = "eval/sets"
"""Folder of the files."""
REAL_SUFFIX, REAL_TIER = "+real", "real caves"
"""What a name ends in when a user's own caves are dived as well, and the tier that they make."""


@dataclass(frozen=True, kw_only=True)
class TierRules:
    """What is harder or easier in a tier: options of the task (`aquanav_tools.task.TaskOptions`)."""

    current: str | None = None
    """A preset: still, half, full or flood."""
    randomisation: str | None = None
    """Ranges of the vehicle's dynamics: mild or wide."""
    sensor_noise: float = 0.0
    """Standard deviation of the error of each ray, m."""
    action_delay: int = 0
    """Decisions between choosing an action and its effect."""

    def changes(self) -> dict[str, object]:
        """Return the options that are not as usual."""
        usual = TierRules()
        return {name: value for name, value in vars(self).items() if value != getattr(usual, name)}


@dataclass(frozen=True)
class BenchmarkCave:
    """One cave, with what puts it into its tier."""

    scenario: str
    """A name, generated/STYLE/SEED, or a folder."""
    width: float | None = None
    """Of the narrowest place of the way, vehicle widths."""
    turn: float | None = None
    """Mean turn of the way, degrees per m."""
    length: float | None = None
    """Of the way, m."""
    sha256: str | None = None
    """Of its mesh when the set was drawn, as `mesh_hash` has it."""


@dataclass(frozen=True)
class Tier:
    """Caves that are about as hard, dived under the same rules."""

    name: str
    caves: tuple[BenchmarkCave, ...]
    rules: TierRules = field(default_factory=TierRules)

    @property
    def condition(self) -> Condition:
        """The rules as the condition of an evaluation."""
        return Condition(self.name, self.rules.changes())


@dataclass(frozen=True)
class Benchmark:
    """Tiers of caves."""

    episodes: int
    """In each cave, from as many of its starts."""
    seed: int
    """Episode i in a cave has seed + i."""
    tiers: tuple[Tier, ...]
    name: str = ""
    sha256: str = ""
    """Of the file."""

    def __post_init__(self) -> None:
        caves = [cave.scenario for tier in self.tiers for cave in tier.caves]
        twice = sorted({name for name in caves if caves.count(name) > 1})
        if not 1 <= self.episodes or self.seed < 0 or not caves:
            raise ValueError(f"{self.episodes} episodes from seed {self.seed} in {len(caves)} caves are no benchmark.")
        if twice:
            raise ValueError(f"{twice[0]} is in it twice.")

    @property
    def caves(self) -> tuple[tuple[Tier, BenchmarkCave], ...]:
        """All caves, each with its tier, in their order."""
        return tuple((tier, cave) for tier in self.tiers for cave in tier.caves)


@dataclass(frozen=True)
class _Part:
    """A benchmark that is the beginning of each tier of another."""

    part_of: str
    caves_per_tier: int


def read_benchmark(name: str, real: Sequence[Path] = ()) -> Benchmark:
    """Return a benchmark by its name, or by the path of a file like those in eval/sets that ends in .toml.

    Args:
        name: With "+real" at its end the user's own caves join as a tier of their own.
        real: Scenario folders of such caves, beside those in the slots cave-real-1 and so on.

    Raises:
        InputError: no such benchmark (with the closest name), a file that is none, or no cave of the user's own.
    """
    base = name.removesuffix(REAL_SUFFIX)
    path = Path(base) if base.endswith(".toml") else shipped_path(SETS, base)
    table = read_toml(path)
    if "part_of" in table:
        part = from_table(_Part, table, path.name)
        whole = read_benchmark(part.part_of)
        tiers = tuple(replace(tier, caves=tier.caves[: part.caves_per_tier]) for tier in whole.tiers)
        found = replace(whole, tiers=tiers, name=base)
    else:
        found = replace(from_table(Benchmark, table, path.name), name=path.stem, sha256=file_hash(path))
    if base != name:
        return replace(found, tiers=(*found.tiers, _real_tier(real)), name=found.name + REAL_SUFFIX)
    if real:
        raise InputError(f"Caves of your own join a benchmark whose name ends in {REAL_SUFFIX}: {name}{REAL_SUFFIX}.")
    return found


def _real_tier(folders: Sequence[Path]) -> Tier:
    filled = [name for name in slot_names() if (named_folder(name) / SETTINGS_FILE).is_file()]
    caves = [*filled, *map(str, folders)]
    if not caves:
        raise InputError(
            f"There is no cave of your own to dive in: the slots {', '.join(slot_names())} are empty. Build one with "
            "aquanav-build-cave and name its folder with --real."
        )
    return Tier(REAL_TIER, tuple(BenchmarkCave(cave) for cave in caves), TierRules(current="full"))

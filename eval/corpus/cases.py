"""The corpus: damaged synthetic caves, the original benchmark's caves, real scans, and inputs that are no caves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from aquanav_tools.synthetic import caves as synthetic
from aquanav_tools.synthetic.damage import (
    DamagedScan,
    add_debris,
    add_fins,
    add_noise,
    add_spikes,
    convert_unit,
    decimate,
    duplicate_shell,
    flip_faces,
    fold_wall,
    intact,
    move_away,
    punch_holes,
    repeat_faces,
    sample_cloud,
    solidify,
    split_parts,
    tear_ends,
    unweld,
)
from aquanav_tools.synthetic.rock import embed_in_rock

Make = Callable[[], DamagedScan]

NO_UNIT = "unit|millimet|centimet|--unit"
"""What the error asks for where a scan's unit cannot be told."""


@dataclass(frozen=True)
class Case:
    """One input of the corpus and how its build has to end."""

    name: str
    group: str
    make: Make
    flags: tuple[str, ...] = ()
    """For aquanav-build-cave."""
    error: str = ""
    """Regular expression of the sentence it must end with; empty when it must end proven."""
    max_volume_error: float = 0.03
    """The issue's bound."""
    min_covered: float = 0.85
    """Share of the diveable path that must be in the water; the rest is lost where flat cuts take ragged ends away."""
    has_fit: bool = True
    """Whether the cavity should lie near all of the scan; not where a wall was scanned twice."""
    keeps_handles: bool = True
    """Whether a lost handle is a fault; not where some are thinner than a voxel, as Han-sur-Lesse's two are."""
    is_quick: bool = field(default=False, kw_only=True)


def tube() -> DamagedScan:
    """Return a straight tube of 2.4 m diameter."""
    return intact(synthetic.tube(radius=1.2, length=10.0, sections=48, rings=81))


def bend() -> DamagedScan:
    """Return a tube of 2.4 m diameter that turns by 90 degrees."""
    return intact(synthetic.bend(radius=1.2, bend_radius=6.0, sections=48, rings=81))


def demo(seed: int) -> DamagedScan:
    """Return a rough winding passage."""
    return intact(synthetic.demo_cave(synthetic.CaveOptions(seed=seed, voxel=0.08)))


def phone(seed: int) -> DamagedScan:
    """Return what a phone makes of a rough passage: holes, noise, drift, debris and ragged ends at once."""
    scan = punch_holes(demo(seed), number=30, radius=0.2, seed=seed)
    scan = tear_ends(scan, length=0.6, seed=seed)
    scan = split_parts(scan, parts=3, shift=0.02, seed=seed)
    scan = add_debris(scan, number=20, size=0.12, seed=seed)
    return add_noise(scan, sigma=0.008, seed=seed)


def _chain(base: Make, *steps: Callable[[DamagedScan], DamagedScan]) -> Make:
    def make() -> DamagedScan:
        scan = base()
        for step in steps:
            scan = step(scan)
        return scan

    return make


def _in_rock(scan: DamagedScan) -> DamagedScan:
    return embed_in_rock(scan, margin=1.0)


def _demo(seed: int) -> Make:
    return partial(demo, seed)


def generated_cases() -> list[Case]:
    """Return the caves whose truth is known exactly."""
    return [
        *_cases_of_gaps(),
        *_cases_of_walls(),
        *_cases_of_scans(),
        *_cases_of_faults(),
        *_cases_of_clouds(),
    ]


def _case(name: str, group: str, base: Make, *steps: Callable[[DamagedScan], DamagedScan], **more: object) -> Case:
    return Case(name, group, _chain(base, *steps), **more)  # type: ignore[arg-type]


def _cases_of_gaps() -> list[Case]:
    """Intact walls, and such with holes and noise."""
    return [
        _case("tube", "intact", tube, is_quick=True),
        _case("bend", "intact", bend),
        *[_case(f"demo-{seed}", "intact", _demo(seed), is_quick=seed == 0) for seed in range(4)],
        _case("tube-holes-20x30cm", "holes", tube, lambda s: punch_holes(s, 20, 0.3, 1), is_quick=True),
        _case("bend-holes-10x40cm", "holes", bend, lambda s: punch_holes(s, 10, 0.4, 2)),
        _case("demo-0-holes-40x15cm", "holes", _demo(0), lambda s: punch_holes(s, 40, 0.15, 3)),
        _case("demo-1-holes-8x60cm", "holes", _demo(1), lambda s: punch_holes(s, 8, 0.6, 4)),
        _case("demo-2-holes-100x10cm", "holes", _demo(2), lambda s: punch_holes(s, 100, 0.1, 5)),
        _case("tube-noise-2cm", "noise", tube, lambda s: add_noise(s, 0.02, 1)),
        _case("bend-noise-5cm", "noise", bend, lambda s: add_noise(s, 0.05, 2)),
        _case("demo-0-noise-1cm", "noise", _demo(0), lambda s: add_noise(s, 0.01, 3), is_quick=True),
        _case("demo-1-noise-3cm", "noise", _demo(1), lambda s: add_noise(s, 0.03, 4, along_normals=True)),
    ]


def _cases_of_walls() -> list[Case]:
    """Walls that were scanned twice, turned inside out, or fell into triangles."""
    return [
        _case("tube-shell-3cm", "shells", tube, lambda s: duplicate_shell(s, 0.03, 0.5, 1), has_fit=False),
        _case(
            "demo-0-shell-5cm",
            "shells",
            _demo(0),
            lambda s: duplicate_shell(s, 0.05, 0.6, 2),
            has_fit=False,
            is_quick=True,
        ),
        _case("demo-1-shell-10cm", "shells", _demo(1), lambda s: duplicate_shell(s, 0.1, 0.4, 3), has_fit=False),
        _case("tube-flipped-30", "flips", tube, lambda s: flip_faces(s, 0.3, 1)),
        _case("demo-0-flipped-10", "flips", _demo(0), lambda s: flip_faces(s, 0.1, 2), is_quick=True),
        _case("demo-1-flipped-50", "flips", _demo(1), lambda s: flip_faces(s, 0.5, 3)),
        _case("demo-2-parts-flipped", "flips", _demo(2), lambda s: split_parts(s, 4, 0.005, 4, flip=True)),
        _case("demo-0-soup", "soup", _demo(0), lambda s: unweld(s, 1)),
        _case("demo-1-soup-2mm", "soup", _demo(1), lambda s: unweld(s, 2, 0.002)),
        _case("bend-soup-1cm", "soup", bend, lambda s: unweld(s, 3, 0.01), is_quick=True),
        _case("demo-3-soup-flipped", "soup", _demo(3), lambda s: flip_faces(unweld(s, 4, 0.003), 0.5, 4)),
    ]


def _cases_of_scans() -> list[Case]:
    """What comes with scanning: debris, ragged ends, units, outliers, uneven density."""
    return [
        _case("demo-0-debris-20", "debris", _demo(0), lambda s: add_debris(s, 20, 0.15, 1)),
        _case("demo-3-debris-60", "debris", _demo(3), lambda s: add_debris(s, 60, 0.1, 2)),
        _case("tube-torn-1m", "ends", tube, lambda s: tear_ends(s, 1.0, 1), min_covered=0.6),
        _case("bend-torn-1m", "ends", bend, lambda s: tear_ends(s, 1.0, 2), min_covered=0.6),
        _case("demo-0-torn-1m", "ends", _demo(0), lambda s: tear_ends(s, 1.0, 3), min_covered=0.6),
        _case("demo-1-torn-2m", "ends", _demo(1), lambda s: tear_ends(s, 2.0, 4), min_covered=0.4),
        _case("demo-0-mm", "units", _demo(0), lambda s: convert_unit(s, "mm"), flags=("--unit", "mm")),
        _case("demo-1-cm", "units", _demo(1), lambda s: convert_unit(s, "cm"), flags=("--unit", "cm")),
        _case("demo-2-feet", "units", _demo(2), lambda s: convert_unit(s, "ft"), flags=("--unit", "ft")),
        _case("demo-0-mm-unsaid", "units", _demo(0), lambda s: convert_unit(s, "mm"), error=NO_UNIT, is_quick=True),
        _case("tube-mm-unsaid", "units", tube, lambda s: convert_unit(s, "mm"), error=NO_UNIT),
        _case("demo-1-cm-unsaid", "units", _demo(1), lambda s: convert_unit(s, "cm"), error=NO_UNIT),
        _case("demo-2-km-unsaid", "units", _demo(2), lambda s: convert_unit(s, "km"), error=NO_UNIT),
        _case("demo-0-far", "units", _demo(0), lambda s: move_away(s, (432_000.0, 5_481_000.0, 210.0))),
        _case("tube-spikes-1", "outliers", tube, lambda s: add_spikes(s, 0.01, 1.0, 1)),
        _case("demo-0-spikes-1", "outliers", _demo(0), lambda s: add_spikes(s, 0.01, 1.0, 2)),
        _case("demo-0-half-coarse", "density", _demo(0), lambda s: decimate(s, 0.05, 0.5)),
        _case("demo-2-half-coarse", "density", _demo(2), lambda s: decimate(s, 0.2, 0.5)),
        _case("demo-0-decimated-10", "density", _demo(0), lambda s: decimate(s, 0.1), is_quick=True),
        _case("demo-1-decimated-3", "density", _demo(1), lambda s: decimate(s, 0.03)),
    ]


def _cases_of_faults() -> list[Case]:
    """Faces that no solid has, parts that do not fit, and rock with a back."""
    return [
        _case("demo-0-fins", "non-manifold", _demo(0), lambda s: add_fins(s, 60, 0.1, 1)),
        _case("demo-1-repeated-faces", "non-manifold", _demo(1), lambda s: repeat_faces(s, 0.05, 2)),
        _case("tube-fins", "non-manifold", tube, lambda s: add_fins(s, 40, 0.3, 3), is_quick=True),
        _case("demo-0-folds", "crossings", _demo(0), lambda s: fold_wall(s, 20, 0.25, 1)),
        _case("tube-folds", "crossings", tube, lambda s: fold_wall(s, 12, 0.3, 2)),
        _case("demo-0-parts-2cm", "parts", _demo(0), lambda s: split_parts(s, 4, 0.02, 1)),
        _case("tube-parts-5cm", "parts", tube, lambda s: split_parts(s, 3, 0.05, 2)),
        _case("tube-shell-of-rock", "thick", tube, lambda s: solidify(s, 0.2), has_fit=False),
        _case("demo-0-shell-of-rock", "thick", _demo(0), lambda s: solidify(s, 0.15), has_fit=False, is_quick=True),
        _case("tube-in-rock", "rock", tube, _in_rock, flags=("--inside", "5", "0", "0"), is_quick=True),
        _case("demo-0-in-rock", "rock", _demo(0), _in_rock, flags=("--inside", "4.5", "0.7", "0.8")),
        _case("tube-in-rock-unsaid", "rock", tube, _in_rock, error=r"block of rock.*--inside \d", is_quick=True),
        _case("demo-1-in-rock-unsaid", "rock", _demo(1), _in_rock, error=r"block of rock.*--inside \d"),
    ]


def _cases_of_clouds() -> list[Case]:
    """Points without triangles, and all faults of a phone at once."""
    return [
        _case("tube-cloud", "clouds", tube, lambda s: sample_cloud(s, 0.05, "none", 1)),
        _case("bend-cloud-normals", "clouds", bend, lambda s: sample_cloud(s, 0.05, "true", 2)),
        _case("demo-0-cloud", "clouds", _demo(0), lambda s: sample_cloud(s, 0.04, "none", 3), is_quick=True),
        _case("demo-0-cloud-normals", "clouds", _demo(0), lambda s: sample_cloud(s, 0.04, "true", 4), is_quick=True),
        _case("demo-1-cloud-mixed", "clouds", _demo(1), lambda s: sample_cloud(s, 0.04, "mixed", 5)),
        _case("demo-2-cloud-inverted", "clouds", _demo(2), lambda s: sample_cloud(s, 0.04, "inverted", 6)),
        _case("demo-1-cloud-thinning", "clouds", _demo(1), lambda s: sample_cloud(s, 0.025, "none", 7, fall_off=2.0)),
        _case("demo-2-cloud-thinning", "clouds", _demo(2), lambda s: sample_cloud(s, 0.025, "true", 7, fall_off=2.0)),
        _case(
            "demo-0-cloud-outliers",
            "clouds",
            _demo(0),
            lambda s: add_spikes(sample_cloud(s, 0.04, "none", 8), 0.01, 1.0, 8),
        ),
        _case(
            "demo-3-cloud-noise-2cm", "clouds", _demo(3), lambda s: add_noise(sample_cloud(s, 0.04, "none", 9), 0.02, 9)
        ),
        _case(
            "demo-3-cloud-holes",
            "clouds",
            _demo(3),
            lambda s: sample_cloud(punch_holes(s, 20, 0.25, 10), 0.04, "true", 10),
        ),
        *[Case(f"demo-{seed}-phone", "phone", partial(phone, seed), min_covered=0.7) for seed in range(4)],
    ]


def all_cases(data_dir: Path) -> list[Case]:
    """Return the whole corpus but the bad inputs; caves of `data_dir` only where it exists."""
    from eval.corpus.networks import network_cases
    from eval.corpus.scanned import original_cases, scan_cases

    return [*generated_cases(), *network_cases(), *original_cases(data_dir), *scan_cases(data_dir)]

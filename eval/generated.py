"""Measure the styles of drawn caves beside real ones, and write eval/results/generated.md with its plots.

    python eval/generated.py [--seeds 4] [--real FOLDER] [--smoke]

Real caves are scenario folders in FOLDER, built before with the commands that the page names. Those that are not there
are left out with that reason. Drawn caves are built into the cache. Needs the data folder only for building real caves.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # eval is no part of the package

from aquanav_tools.build.generated import build_generated
from aquanav_tools.cave.measure.sections import cross_sections
from aquanav_tools.errors import AquanavError
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.synthetic.styles.catalogue import VEHICLE_WIDTH
from aquanav_tools.synthetic.styles.names import STYLE_NAMES
from aquanav_tools.types import Array
from eval.smoke import parser_of

RESULTS = Path(__file__).parent / "results"
REAL = {
    "han-sur-lesse": "aquanav-build-cave scan_han_sur_lesse/cave.stl",
    "finnish-cave-1": "aquanav-build-cave scan_finnish_cave1/cave1.stl",
    **{
        name: f"aquanav-build-cave survey_tatra_jaskinie/Surveys/Jaskinia_{folder}.svx"
        for name, folder in (
            ("mietusia-wyznia", "Mietusia_Wyznia/mietusia_wyznia"),
            ("mylna-rura", "Mietusia_Wyznia/mylna_rura"),
            ("trzy-syfony", "Mietusia_Wyznia/trzy_syfony"),
            ("perystaltyka", "Mietusia_Wyznia/perystaltyka"),
            ("obejscie", "Mietusia_Wyznia/obejscie"),
            ("mietusia-rura", "Mietusia/rura"),
        )
    },
    **{
        name: "aquanav import-original saferlauv_unity --vehicle bluerov2"
        for name in ("cave-easy", "cave-easy-1", "cave-easy-2", "cave-easy-3", "cave-eval1")
    },
}
"""Scenario folders of real caves and what builds each from the data folder, without its -o."""
SPACING = 0.5
"""Between places of the way that are measured, m."""
TURN_LENGTH = 1.0
"""Turns and slopes are measured over this length of the way, m."""
FAR = 3.0
"""From the way's end, m."""
NUM_RAYS, RAY_RANGE = 64, 10.0
"""Rays from each place, over all directions, and how far each sees, m; one that meets no wall there is open."""
SMOOTH = 6.0
"""Points of the way, a decimetre each, over which it is smoothed where profiles are taken: more would cut corners."""
BANDS = ((0.25, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 4.0))
"""Wavelengths along the wall whose roughness is told apart, m."""
PANELS = (
    ("width", "narrowest sphere around the way (vehicle widths)"),
    ("curvature", "turn of the way (degrees per m)"),
    ("slope", "slope of the way (degrees)"),
    ("bearing", "way off the bearing of its end, in plan (degrees)"),
    ("shape", "width / height of sections"),
    ("ray", "length of rays (m)"),
    ("filled", "section area / its box"),
)


@dataclass(frozen=True, eq=False)
class Measured:
    """What was measured along the ways of some caves."""

    values: dict[str, Array]
    """Of each of PANELS, all places of all caves."""
    roughness: Array
    """(len(BANDS),) root mean square height of the wall per band of wavelengths, m."""
    open_share: float
    """Of the rays."""
    lengths: Array
    """Of the ways, m."""


def measure(scenarios: list[Scenario]) -> Measured:
    """Return the measures of some caves together."""
    parts = [_measure_one(scenario) for scenario in scenarios]
    values = {name: np.concatenate([part.values[name] for part in parts]) for name, _ in PANELS}
    roughness = np.sqrt(np.mean([part.roughness**2 for part in parts], axis=0))
    open_share = float(np.mean([part.open_share for part in parts]))
    return Measured(values, roughness, open_share, np.concatenate([part.lengths for part in parts]))


def _measure_one(scenario: Scenario) -> Measured:
    line = scenario.guide.centreline
    sections = cross_sections(scenario.cavity, line, SPACING)
    step = float(np.linalg.norm(line[1] - line[0]))
    places = line[:: max(1, round(SPACING / step))]
    ends = line[:: max(1, round(TURN_LENGTH / step))]
    ahead = np.diff(ends, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    turns = np.degrees(np.arccos(np.clip((ahead[1:] * ahead[:-1]).sum(axis=1), -1.0, 1.0))) / TURN_LENGTH
    rays = _rays(scenario, places)
    boxes = np.array([section.width * section.height for section in sections])
    values = {
        "width": 2.0 * scenario.field.clearance(places) / VEHICLE_WIDTH,
        "curvature": turns,
        "slope": np.degrees(np.arcsin(np.clip(np.abs(ahead[:, 2]), 0.0, 1.0))),
        "bearing": _off_bearing(ends),
        "shape": np.array([section.width / section.height for section in sections]),
        "ray": np.minimum(rays, RAY_RANGE),
        "filled": np.array([section.area for section in sections]) / boxes,
    }
    return Measured(values, _roughness(scenario), float((rays >= RAY_RANGE).mean()), np.array([scenario.guide.length]))


def _off_bearing(places: Array) -> Array:
    """Return by how much the way leads off the straight line to its end, in plan, at all but the last places, degrees.

    Within FAR of the end, that line says nothing.
    """
    ahead, to_end = np.diff(places, axis=0), places[-1] - places[:-1]
    headings, bearings = (np.arctan2(one[:, 1], one[:, 0]) for one in (ahead, to_end))
    off = np.degrees(np.abs((headings - bearings + np.pi) % (2.0 * np.pi) - np.pi))
    return np.asarray(off[np.linalg.norm(to_end, axis=1) > FAR])


def _rays(scenario: Scenario, places: Array) -> Array:
    """Return the lengths of rays from places to the rock, m; portals are no rock."""
    return _cast(scenario, np.repeat(places, NUM_RAYS, axis=0), np.tile(_directions(NUM_RAYS), (len(places), 1)))


def _directions(count: int) -> Array:
    """Return (count, 3) unit vectors spread evenly over the sphere (Fibonacci)."""
    n = np.arange(count) + 0.5
    z, angle = 1.0 - 2.0 * n / count, np.pi * (1.0 + np.sqrt(5.0)) * n
    flat = np.sqrt(1.0 - z**2)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)


def _cast(scenario: Scenario, origins: Array, directions: Array) -> Array:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene()
    TriangleMesh(scene, scenario.cavity.walls.triangles.astype(np.float32))
    found = scene.run(origins.astype(np.float32), directions.astype(np.float32), query="DISTANCE")
    return np.asarray(found, dtype=np.float64)


def _roughness(scenario: Scenario) -> Array:
    """Return the root mean square height of the wall along the way, per band of wavelengths, m.

    A profile is the distance across the passage at one angle around the way, every 5 cm: where the way winds, one wall
    is nearer by as much as the other is farther. Two walls that differ at random make twice the variance of one. Bends
    and chambers are longer waves than the bands. Side passages, columns and what lies behind an edge make jumps, which
    are in every band: they are cut at half a metre from what is around them, and the median of twelve angles counts.
    """
    from scipy.ndimage import gaussian_filter1d, median_filter

    line = gaussian_filter1d(scenario.guide.centreline, SMOOTH, axis=0, mode="nearest")
    ways = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    stations = np.arange(0.0, ways[-1], 0.05)
    points = np.stack([np.interp(stations, ways, column) for column in line.T], axis=1)
    ahead = np.gradient(points, axis=0)
    side = np.stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(ahead))], axis=1)
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    up = np.cross(ahead / np.linalg.norm(ahead, axis=1, keepdims=True), side)
    powers = []
    for angle in np.arange(0.0, np.pi, np.pi / 12.0):
        across = np.cos(angle) * side + np.sin(angle) * up
        width = np.minimum(_cast(scenario, points, across), 5.0) + np.minimum(_cast(scenario, points, -across), 5.0)
        around = median_filter(width, 41, mode="nearest")
        width = np.clip(width, around - 0.5, around + 0.5)
        spectrum = np.abs(np.fft.rfft((width - width.mean()) * np.hanning(len(width)))) ** 2
        spectrum *= 2.0 / (len(width) * (np.hanning(len(width)) ** 2).sum())  # Parseval: sums to the variance
        waves = 1.0 / np.maximum(np.fft.rfftfreq(len(width), 0.05), 1e-9)
        powers.append([spectrum[(waves >= low) & (waves < high)].sum() for low, high in BANDS])
    return np.asarray(np.sqrt(0.5 * np.median(powers, axis=0)))


def draw(found: dict[str, Measured], num_styles: int, path: Path) -> None:
    """Draw the spread of every measure, and the roughness spectrum, into a PNG; real caves are the last rows."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 3, figsize=(17, 14), layout="constrained")
    names = list(found)
    colours = ["tab:blue"] * num_styles + ["tab:red"] * (len(names) - num_styles)
    for (name, title), axis in zip(PANELS, axes.ravel(), strict=False):
        boxes = axis.boxplot(
            [found[one].values[name] for one in names], whis=(5, 95), showfliers=False, orientation="horizontal",
            patch_artist=True,
        )  # fmt: skip
        for box, colour in zip(boxes["boxes"], colours, strict=True):
            box.set_facecolor(colour)
        axis.set_yticks(range(1, len(names) + 1), names, fontsize=8)
        axis.set_title(title, fontsize=10)
        axis.invert_yaxis()
        if name in ("width", "shape", "ray"):
            axis.set_xscale("log")
            _label(axis.xaxis)
    spectrum, shares = axes.ravel()[len(PANELS) :]
    for one, colour in zip(names, colours, strict=True):
        middles = [np.sqrt(low * high) for low, high in BANDS]
        spectrum.loglog(middles, 100.0 * found[one].roughness, "o-", color=colour, label=one, alpha=0.7)
    _label(spectrum.xaxis)
    _label(spectrum.yaxis)
    spectrum.set_title("roughness of the wall (cm, RMS) by wavelength (m)", fontsize=10)
    shares.barh(names, [100.0 * found[one].open_share for one in names], color=colours)
    shares.set_title(f"rays that see farther than {RAY_RANGE:g} m (%)", fontsize=10)
    shares.invert_yaxis()
    figure.savefig(path, dpi=70)


def _label(axis: Any) -> None:
    """Label the ticks of a log axis at 1, 2 and 5 times powers of ten, as plain numbers: more would overlap."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def page(found: dict[str, Measured], num_styles: int, left_out: dict[str, str], seeds: int) -> str:
    """Return the page: medians with 5 and 95 %, and what was left out and why."""
    names = list(found)
    lines = [
        "# Drawn caves beside real ones",
        "",
        f"`python eval/generated.py --seeds {seeds}` wrote this page. Each style is {seeds} caves, seeds 0 to "
        f"{seeds - 1}. Places stand every {SPACING} m along the way; numbers are the median (5 % to 95 %).",
        "",
        "![Measures of all styles, real caves in red](generated.png)",
        "",
        "| cave | length (m) | " + " | ".join(title for _, title in PANELS) + " | open rays |",
        "|---" * (len(PANELS) + 3) + "|",
    ]
    for name in names:
        one = found[name]
        cells = [_spread(one.values[key]) for key, _ in PANELS]
        reach = (
            f"{one.lengths.min():.0f} to {one.lengths.max():.0f}" if len(one.lengths) > 1 else f"{one.lengths[0]:.0f}"
        )
        lines.append(f"| {name} | {reach} | {' | '.join(cells)} | {one.open_share:.0%} |")
    bands = [f"{low:g} to {high:g} m" for low, high in BANDS]
    lines += ["", "Roughness of the wall, RMS in cm, by wavelength:", "", "| cave | " + " | ".join(bands) + " |"]
    lines.append("|---" * (len(BANDS) + 1) + "|")
    lines += [f"| {name} | " + " | ".join(f"{100 * r:.1f}" for r in found[name].roughness) + " |" for name in names]
    lines += ["", *_coverage(found, num_styles), ""]
    lines += [f"- Left out: {name}: {reason}" for name, reason in left_out.items()]
    return "\n".join(lines) + "\n"


def _spread(values: Array) -> str:
    low, middle, high = np.percentile(values, [5, 50, 95])
    return f"{_short(middle)} ({_short(low)} to {_short(high)})"


def _short(value: float) -> str:
    """Return two digits of a number, and no power of ten where it has three before the point."""
    return f"{value:.0f}" if abs(value) >= 99.5 else f"{value:.2g}"


def _coverage(found: dict[str, Measured], num_styles: int) -> list[str]:
    """Return which share of each real cave's places lies within the 1 to 99 % of all styles together."""
    names = list(found)
    lines = []
    for name in names[num_styles:]:
        shares = []
        for key, title in PANELS:
            low, high = np.percentile(np.concatenate([found[one].values[key] for one in names[:num_styles]]), [1, 99])
            inside = np.mean((found[name].values[key] >= low) & (found[name].values[key] <= high))
            shares.append(f"{title} {inside:.0%}")
        lines.append(f"Within the 1 to 99 % range of all styles lie, of {name}: {', '.join(shares)}.")
    return [*lines, "", *_coverage_together(found, num_styles)]


def _coverage_together(found: dict[str, Measured], num_styles: int) -> list[str]:
    """Return the least share and the mean over all real caves, of each measure."""
    names = list(found)
    drawn, real = names[:num_styles], names[num_styles:]
    lines = []
    for key, title in PANELS if real else ():
        low, high = np.percentile(np.concatenate([found[one].values[key] for one in drawn]), [1, 99])
        shares = [np.mean((found[one].values[key] >= low) & (found[one].values[key] <= high)) for one in real]
        share = f"{np.mean(shares):.0%} of real caves' places, {min(shares):.0%} at least"
        lines.append(f"- {title}: {_short(low)} to {_short(high)}; {share}.")
    return lines


def main() -> None:
    """Measure, draw, write."""
    parser = parser_of(__doc__)
    parser.add_argument("--seeds", type=int, default=4, help="caves of each style")
    parser.add_argument("--real", type=Path, help="folder of scenario folders of real caves")
    given = parser.parse_args()
    seeds, styles = (1, STYLE_NAMES[:1]) if given.smoke else (given.seeds, STYLE_NAMES)
    found, left_out = {}, {}
    for style in styles:
        found[style] = measure([read_scenario(build_generated(style, seed)) for seed in range(seeds)])
        print(style, flush=True)
    for name, command in REAL.items():
        folder = None if given.real is None else given.real / name
        if folder is None or not folder.is_dir():
            left_out[name] = (
                f"there is no scenario of it; build it with `{command}`, -o FOLDER/{name}, and give --real."
            )
            continue
        try:
            found[name] = measure([read_scenario(folder)])
        except AquanavError as error:
            left_out[name] = str(error).replace(str(given.real), "FOLDER")
    if not given.smoke:
        draw(found, len(styles), RESULTS / "generated.png")
        (RESULTS / "generated.md").write_text(page(found, len(styles), left_out, seeds), encoding="utf-8")


if __name__ == "__main__":
    main()

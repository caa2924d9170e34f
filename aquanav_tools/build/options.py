"""What a build can be told. Light to import: the command line is made from it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from aquanav_tools.cave.options import (
    ClosingOptions,
    PanelOptions,
    RouteOptions,
    ScanOptions,
    StartOptions,
    WaterOptions,
)
from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.georeference.options import ScaleSources
from aquanav_tools.reconstruct.intake.options import VIDEO_SUFFIXES, IntakeOptions, Quality
from aquanav_tools.scenario.limits import MAX_DECISIONS, ORIGINAL_DECISIONS
from aquanav_tools.tables import from_table, read_toml

SURVEY_SUFFIXES = (".svx", ".3d", ".th")
"""Survex and Therion; the same that cave.survey reads, which is not imported for a command's --help."""


@dataclass(frozen=True)
class PhotoScaleOptions(ScaleSources):
    """Where the metres come from when the input is photos."""

    passage_height: float | None = None
    """Typical height of the passage, m. A rough scale when nothing better is known; up is taken from the cameras."""

    @property
    def scaling(self) -> tuple[str, ...]:
        """The options given that can tell the size of what the photos show."""
        return super().scaling + (() if self.passage_height is None else ("passage_height",))

    @property
    def knows_north(self) -> bool:
        """Whether a source is given whose y is north: positions from satellites, or a survey."""
        return self.gps or (self.stations is not None and self.stations.suffix.lower() in SURVEY_SUFFIXES)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.passage_height is not None and not self.passage_height > 0.0:
            raise ValueError(f"passage_height = {self.passage_height} must be positive.")


@dataclass(frozen=True)
class BuildOptions:
    """One build, from input to scenario folder."""

    input: Path
    """Folder of photos, or a video (.mp4, .mov, .avi, .mkv); or a scan: a mesh (.ply, .obj, .stl, .off, .glb, .gltf,
    .dae, .3mf, .fbx, .usdz, .usd, .usda, .usdc) or a point cloud (.ply, .las, .laz, .e57, .ptx, .pts, .pcd, .xyz,
    .csv); or a survey: Survex (.svx, .3d) or Therion (.th)."""
    output: Path
    """Scenario folder to write."""
    name: str = ""
    """Name of the scenario; the output folder's by default."""
    vehicle: str = "bluerov2"
    """Vehicle that must be able to pass; a shipped name or a .toml file."""
    decisions: int = ORIGINAL_DECISIONS
    """Longest episode, in decisions of 0.1 s. The default is the original's and grows where the way is long for the
    vehicle; any other number is the limit."""
    further: tuple[Path, ...] = ()
    """More scans of the same cave, in the same coordinates: scan-1.e57 scan-2.e57 and so on."""
    seed: int = 0
    """Seed of every random draw."""
    quality: Quality = "standard"
    """Of photos: draft to see whether they are enough, high where time does not matter. The forecast tells what each
    takes."""
    overwrite: bool = False
    """Replace another scenario in the output folder, once the new one is complete. (Of photos, what was finished is
    taken up without it.)"""
    survey: Path | None = None
    """Survey of the same cave in the coordinates of the scan: its legs are kept open, and the scan is checked."""
    cave: str = ""
    """Cave of a survey file that holds several, or one of its surveys, such as "mietusia" or "mietusia.rura"."""
    recipe: Path | None = None
    """TOML file with settings for the stages, as in pipelines/build; flags given here win over it."""
    scan: ScanOptions = field(default_factory=ScanOptions)
    scale: PhotoScaleOptions = field(default_factory=PhotoScaleOptions)
    closing: ClosingOptions = field(default_factory=ClosingOptions)
    route: RouteOptions = field(default_factory=RouteOptions)
    panels: PanelOptions = field(default_factory=PanelOptions)
    starts: StartOptions = field(default_factory=StartOptions)
    water: WaterOptions = field(default_factory=WaterOptions)
    intake: IntakeOptions = field(default_factory=IntakeOptions)

    def __post_init__(self) -> None:
        if not 1 <= self.decisions <= MAX_DECISIONS:
            raise InputError(
                f"--decisions is {self.decisions}; an episode has 1 to {MAX_DECISIONS}. Choose a number there."
            )
        if self.further and self.kind != "scan":
            raise InputError(
                f"{self.input} is of {self.kind}, and {len(self.further)} more files are given with it. Only scans of "
                "one cave are built together. Give one input."
            )

    @property
    def title(self) -> str:
        """The name that was given, or the output folder's."""
        return self.name or self.output.resolve().name

    @property
    def kind(self) -> Literal["photos", "scan", "survey"]:
        """Way to build it: photos when the input is a folder or a video, a survey by the ending of the file's name."""
        if self.input.is_dir() or self.input.suffix.lower() in VIDEO_SUFFIXES:
            return "photos"
        return "survey" if self.input.suffix.lower() in SURVEY_SUFFIXES else "scan"


@dataclass(frozen=True)
class RecipeStages:
    """What a recipe file may hold apart from [photos], which the photo stages read."""

    quality: Quality = "standard"
    scan: ScanOptions = field(default_factory=ScanOptions)
    closing: ClosingOptions = field(default_factory=ClosingOptions)
    route: RouteOptions = field(default_factory=RouteOptions)
    panels: PanelOptions = field(default_factory=PanelOptions)
    starts: StartOptions = field(default_factory=StartOptions)
    intake: IntakeOptions = field(default_factory=IntakeOptions)
    water: WaterOptions = field(default_factory=WaterOptions)


def read_recipe(path: Path) -> RecipeStages:
    """Return the settings of the stages in a recipe file.

    Raises:
        InputError: there is no such file, or it has an unknown key or a senseless value.
    """
    tables: dict[str, Any] = {name: table for name, table in read_toml(path).items() if name != "photos"}
    return from_table(RecipeStages, tables, path.name)

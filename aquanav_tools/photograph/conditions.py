"""Named conditions to photograph a cave in, from a clear spring to what makes reconstruction fail."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from aquanav_tools.photograph.options import JERLOV, CameraOptions, CaptureOptions, DiveOptions, Lamp

ConditionName = Literal["clear", "poor-texture", "turbid", "dark", "loop", "forward-only", "wide-steps", "three-passes"]


@dataclass(frozen=True)
class Condition:
    """A cave's length and a dive in it."""

    explanation: str
    cave_length: float = 9.0
    """m."""
    dive: DiveOptions = field(default_factory=DiveOptions)


CONDITIONS: dict[ConditionName, Condition] = {
    "clear": Condition("clear spring water, textured limestone, five photos per station: the demo"),
    "poor-texture": Condition(
        "mud on the walls and a noisy sensor",
        dive=DiveOptions(texture=0.25, camera=CameraOptions(noise=3.0)),
    ),
    "turbid": Condition(
        "coastal water (Jerlov 1C): backscatter, and contrast gone within 4 m",
        dive=DiveOptions(water=JERLOV["1C"], camera=CameraOptions(exposure_spread_ev=0.3)),
    ),
    "dark": Condition(
        "a weak lamp: long exposures that blur, noise, far walls black",
        dive=DiveOptions(
            lamp=Lamp(power=0.008), camera=CameraOptions(exposure_s=0.03, exposure_spread_ev=0.5, quality=85)
        ),
    ),
    "loop": Condition(
        "out along one wall, back along the other, to the first view",
        cave_length=12.0,
        dive=DiveOptions(capture=CaptureOptions("loop", 100)),
    ),
    "forward-only": Condition(
        "swims through looking ahead, four photos per metre",
        cave_length=17.0,
        dive=DiveOptions(capture=CaptureOptions("forward", 60, end_margin=3.0)),
    ),
    "wide-steps": Condition(
        "stations 1.5 m apart",
        cave_length=31.5,
        dive=DiveOptions(capture=CaptureOptions("stations", 110)),
    ),
    "three-passes": Condition(
        "three separate dives looking left, right and up",
        cave_length=12.0,
        dive=DiveOptions(capture=CaptureOptions("passes", 105, end_margin=2.0)),
    ),
}

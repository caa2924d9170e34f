"""What `aquanav info` says of a built cave: the numbers of its report, under the same names."""

from __future__ import annotations

from pathlib import Path

from aquanav_tools.errors import InputError
from aquanav_tools.text_files import read_json

REPORT_FILE = "report.json"


def is_built_cave(path: Path) -> bool:
    """Return whether a path is a folder that a build left."""
    return (path / REPORT_FILE).is_file()


def cave_facts(folder: Path) -> list[tuple[str, str]]:
    """Return names and values of what a cave's report says about its size and about what gets through.

    Raises:
        InputError: the build stopped, or is of a version that did not measure this.
    """
    report = read_json(folder / REPORT_FILE)
    if "error" in report:
        raise InputError(f"The build in {folder} stopped: {report['error']}")
    if "passability" not in report:
        raise InputError(f"{folder} was built by an older version of aquanav, without these numbers. Build it again.")
    numbers, found = report["statistics"], report["passability"]
    near, places = found["clearance"], found["narrow_places"]
    way = "on another way than the route" if found["has_wider_way"] else "at the narrowest place"
    return [
        ("cave", str(folder)),
        ("route", f"{numbers['route_length']:.1f} m, {numbers['total_length']:.1f} m with all passages"),
        ("water", f"{numbers['volume']:.1f} m3 behind {numbers['num_portals']} portals"),
        ("vehicle", f"{found['vehicle_width']:.2f} m wide"),
        ("largest vehicle", f"{found['largest_vehicle']:.2f} m wide, {way}"),
        ("narrowest place", found["narrowest"]["text"]),
        ("narrow places", f"{len(places)} below {found['narrow_below']:.2f} m"),
        *(("", place["text"]) for place in places),
        ("least clearance", f"{near['least']:.2f} m at {near['arc_length']:.1f} m of the route, where the passage is "
                            f"{near['width']:.2f} m wide"),
        ("north", "is y" if report["has_north"] else "not known"),
    ]  # fmt: skip

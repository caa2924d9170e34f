"""The water volume of a passage and everything measured in it.

The functions below are for cavers and roboticists who want a cave and no scenario; each is loaded when it is first
asked for. All lengths are in metres, in one frame with z up. `docs/cave.md` shows them at work.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from aquanav_tools.cave.api import centreline as centreline
    from aquanav_tools.cave.api import close as close
    from aquanav_tools.cave.api import largest_vehicle as largest_vehicle
    from aquanav_tools.cave.api import read_scan as read_scan
    from aquanav_tools.cave.api import sections as sections
    from aquanav_tools.cave.api import write as write

from aquanav_tools.lazy import offer_functions

__all__ = ["centreline", "close", "largest_vehicle", "read_scan", "sections", "write"]

offer_functions(__name__, dict.fromkeys(__all__, "aquanav_tools.cave.api"))

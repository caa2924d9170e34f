"""A dive while it happens: the viewer shows decision after decision, and episode after episode on one time line."""

from __future__ import annotations

import os
import socket
import sys
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from aquanav_tools.errors import ResourceError
from aquanav_tools.libraries import require
from aquanav_tools.report.dynamics import dynamics_document
from aquanav_tools.report.recording.cave import CaveModel, log_cave, log_route
from aquanav_tools.report.recording.episode import (
    NEAR_WALL,
    RAY_RADIUS,
    TIMELINE,
    TRAIL_RADIUS,
    distance_colours,
    dive_blueprint,
    log_state_colours,
    log_vehicle,
    states_of,
)
from aquanav_tools.report.recording.stream import APPLICATION
from aquanav_tools.types import Array, Mesh

if TYPE_CHECKING:
    from aquanav_tools.scenario.schema import Scenario

PORT = 9876
"""Where rerun's viewer listens unless told otherwise."""
LISTENS_WITHIN = 0.5
"""A viewer that is there answers a connection within this time, s: many times what one on another machine needs."""
TRAIL_STATES = 300
"""The trail shows so many states, half a minute: it is sent anew each time, at 12 bytes each."""
REWARD_PREFIX, DRAWN_PREFIX = "reward/", "dynamics/"


class LiveDive:
    """Shows one vehicle's episodes in the viewer."""

    def __init__(
        self, scenario: Scenario, vehicle: Mesh, ray_directions: Array, seconds: float, has_dynamics: bool = False
    ) -> None:
        """Open the viewer and show the cave.

        Args:
            scenario: Where the vehicle dives.
            vehicle: How it looks, body frame, m, with colours.
            ray_directions: (R, 3) unit vectors in the body frame.
            seconds: Between two states, s.
            has_dynamics: Whether episodes draw their vehicle's dynamics, which are then told beside the plots.

        Raises:
            ResourceError: there is no viewer, and none can be started.
        """
        cave = CaveModel(scenario)
        self._stream = _open_viewer(dive_blueprint(cave, is_live=True, has_dynamics=has_dynamics))
        self._directions, self._seconds = ray_directions, seconds
        self._time, self._state = 0.0, ""
        self._trail: deque[Array] = deque(maxlen=TRAIL_STATES)
        log_cave(self._stream, cave)
        log_route(self._stream, scenario)
        log_vehicle(self._stream, vehicle)
        log_state_colours(self._stream)

    def show(self, info: dict[str, Any], is_first: bool) -> None:
        """Show the state that an environment's `info` tells of, the first of an episode or a later one."""
        import rerun as rr

        self._stream.set_time(TIMELINE, duration=self._time)
        self._time += self._seconds
        if is_first:
            self._trail.clear()
            drawn = {key.removeprefix(DRAWN_PREFIX): info[key] for key in info if key.startswith(DRAWN_PREFIX)}
            if drawn:
                self._log("dynamics", rr.TextDocument(dynamics_document(drawn), media_type=rr.MediaType.MARKDOWN))
        self._trail.append(info["position"])
        w, x, y, z = info["orientation"]
        self._log("vehicle", rr.Transform3D(translation=info["position"], quaternion=rr.Quaternion(xyzw=[x, y, z, w])))
        colour = distance_colours(np.array([info["clearance"]]), NEAR_WALL * 4)
        self._log("trail", rr.LineStrips3D([np.array(self._trail)], colors=colour, radii=TRAIL_RADIUS))
        self._show_rays(info["rays"])
        terms = {name: value for name, value in info.items() if name.startswith(REWARD_PREFIX)}
        for name, value in {**{name: info[name] for name in ("clearance", "progress", "cost")}, **terms}.items():
            self._log(f"plots/{name}", rr.Scalars(value))
        self._show_state(info)

    def close(self) -> None:
        """Send what is under way and let go of the viewer, which stays open."""
        self._stream.disconnect()

    def _show_rays(self, ranges: Array) -> None:
        import rerun as rr

        strips = np.zeros((len(ranges), 2, 3), dtype=np.float32)
        strips[:, 1] = ranges[:, None] * self._directions
        colours = distance_colours(ranges, float(ranges.max()))
        self._log("vehicle/rays", rr.LineStrips3D(strips, colors=colours, radii=RAY_RADIUS))

    def _show_state(self, info: dict[str, Any]) -> None:
        import rerun as rr

        is_over = info["outcome"] != "running"
        state = info["outcome"] if is_over else str(states_of(info["collision"], info["clearance"]))
        if state != self._state:
            self._state = state
            self._log("state", rr.StateChange(state=state))

    def _log(self, entity: str, what: Any) -> None:
        self._stream.log(entity, what, strict=True)


def _open_viewer(blueprint: Any) -> Any:
    """Return a stream to the viewer that listens at PORT, or to one that is started; its layout is replaced."""
    require("The view of render_mode='human'", "rerun", otherwise=", or take pictures with render_mode='rgb_array'")
    import rerun as rr

    stream = rr.RecordingStream(APPLICATION)
    if _is_listening():
        stream.connect_grpc(f"rerun+http://127.0.0.1:{PORT}/proxy")
    elif not _has_screen():
        raise ResourceError(
            "No viewer can be started for render_mode='human': this machine has no screen (neither DISPLAY nor "
            f"WAYLAND_DISPLAY is set), and no viewer listens at port {PORT}. Start rerun where there is a screen and "
            f"bring its port here (ssh -R {PORT}:localhost:{PORT}), or take pictures with render_mode='rgb_array'."
        )
    else:
        try:
            stream.spawn(port=PORT)
        except RuntimeError as cause:
            raise ResourceError(
                f"rerun's viewer could not be started for render_mode='human': {cause}. Try the command rerun by "
                "itself, or take pictures with render_mode='rgb_array'."
            ) from cause
    stream.send_blueprint(blueprint)
    return stream


def _is_listening() -> bool:
    try:
        with socket.create_connection(("localhost", PORT), timeout=LISTENS_WITHIN):
            return True
    except OSError:
        return False


def _has_screen() -> bool:
    is_x11_or_wayland = sys.platform.startswith("linux")
    return not is_x11_or_wayland or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))

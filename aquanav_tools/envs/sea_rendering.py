"""Pictures of a boat in its bay by daylight: sea, rocks, reefs, the goal's buoy, and the beams of its sensor."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import InputError
from aquanav_tools.photograph.scene import RayScene
from aquanav_tools.sea.sea_map import SeaMap, rock_solid
from aquanav_tools.sim.boat import Boat
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.sea_water import SeaWater
from aquanav_tools.types import Array, Mesh, rotation_matrix

MIN_SIDE = 64
"""px."""
FIELD_OF_VIEW = float(np.radians(62.0))
"""Across the picture."""
BEHIND, ABOVE, AHEAD = 3.2, 1.9, 2.5
"""Where the camera is, and the place before the boat that it looks at, in lengths of the boat."""
FARTHEST = 600.0
"""The sea ends here, m."""
ROUNDS = 2
"""Of finding where a line of sight meets the waves, each from the height of the last; the waves are never steep."""
CALM_FROM = 20.0
"""Waves farther off are finer than the picture's pixels: they fade over this distance, m."""
NEAR_WAVES, CELL = 60.0, 0.4
"""How far from the camera the waves are summed up, on squares of this side, m: a twentieth of them is left there."""
SUN = np.array([-0.45, 0.35, 0.82]) / np.linalg.norm([-0.45, 0.35, 0.82])
GLITTER = 180.0
"""Exponent of the sun's reflection."""
SEEN_DEPTH = 1.2
"""Way through water on which light falls to a third, m: reefs shimmer through."""
REFRACTION = 1.34
HAZE = 350.0
"""Distance on which what is far fades into the sky, m."""
BUOY_RADIUS, BUOY_HEIGHT = 0.6, 4.0
"""Of the goal, m."""
BEAM_WIDTH, BEAM_RISE = 2, 0.4
"""Of a beam's line, px, and its height over the water, m."""
ZENITH, HORIZON, DEEP, SHALLOW = (
    np.array(rgb) for rgb in ((0.25, 0.47, 0.75), (0.78, 0.86, 0.92), (0.02, 0.13, 0.19), (0.10, 0.35, 0.38))
)
ROCK, BOAT, BUOY, CLEAR, NEAR = (
    np.array(rgb)
    for rgb in ((0.42, 0.35, 0.29), (0.95, 0.42, 0.08), (0.10, 0.62, 0.32), (0.70, 1.00, 0.95), (0.95, 0.16, 0.14))
)


class SeaCamera:
    """Looks at a boat from behind and above."""

    def __init__(self, boat: Boat | OriginalVehicle, size: tuple[int, int], beams: Array, beam_lengths: Array) -> None:
        """Prepare the camera.

        Args:
            boat: Whose hull is shown.
            size: Width and height of the pictures, px.
            beams: (7, 3) directions of the sensor's beams, body frame.
            beam_lengths: (7,) m.

        Raises:
            InputError: the size is below 64 px.
        """
        if min(size) < MIN_SIDE:
            raise InputError(f"Pictures of {size[0]} x {size[1]} px cannot be taken; choose at least {MIN_SIDE} px.")
        self.size = size
        """Width and height of the pictures, px."""
        hull = _joined([hull_of(boat)])
        self._hull, self._length = RayScene(hull), float(np.ptp(hull.vertices[:, 0]))
        self._beams, self._beam_lengths = beams, beam_lengths
        self._focal = 0.5 * size[0] / np.tan(0.5 * FIELD_OF_VIEW)
        columns, rows = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
        x, y = (columns - 0.5 * size[0]) / self._focal, (rows - 0.5 * size[1]) / self._focal
        self._pixels = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
        self._bay: SeaMap | None = None

    def look_at(self, bay: SeaMap) -> None:
        """Show another bay from now on."""
        self._bay = bay
        parts = [rock_solid(rock, bay.depth) for rock in bay.rocks]
        self._rocks = RayScene(_joined(parts)) if parts else None
        buoy = _joined([_cylinder(corner, BUOY_RADIUS, -1.0, BUOY_HEIGHT) for corner in bay.goal.corners])
        self._buoys = RayScene(buoy)

    def picture(self, state: Array, water: SeaWater, ranges: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
        """Return the (H, W, 3) picture, RGB.

        Args:
            state: The boat's; its position, m, and quaternion come first.
            water: The sea as it is now.
            ranges: (7,) what the beams measure, m.
        """
        assert self._bay is not None, "look_at comes first"
        turn = rotation_matrix(state[3:7])
        centre, camera = self._pose(state[:3], turn)
        rays = self._pixels @ camera
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        shown, far = self._world(centre, rays, water)
        shown, far = self._with_boat(shown, far, centre, rays, state[:3], turn)
        haze = 1.0 - np.exp(-np.minimum(far, FARTHEST) / HAZE)[:, None]
        shown = shown * (1.0 - haze) + _sky(rays) * haze
        image = np.clip(shown, 0.0, 1.0).reshape(self.size[1], self.size[0], 3) ** (1.0 / 1.4)
        picture = (255.0 * image).astype(np.uint8)
        return self._with_beams(picture, centre, camera, state[:3], turn, ranges)

    def _pose(self, position: Array, turn: Array) -> tuple[Array, Array]:
        """Return where the camera is and its (3, 3) axes: right, down, ahead."""
        ahead = np.array([turn[0, 0], turn[1, 0], 0.0]) / np.hypot(turn[0, 0], turn[1, 0])
        up = np.array([0.0, 0.0, 1.0])
        centre = position * [1.0, 1.0, 0.0] + self._length * (ABOVE * up - BEHIND * ahead)
        look = position * [1.0, 1.0, 0.0] + AHEAD * self._length * ahead - centre
        look /= np.linalg.norm(look)
        right = np.cross(look, up)
        right /= np.linalg.norm(right)
        return centre, np.stack([right, np.cross(look, right), look])

    def _world(self, centre: Array, rays: Array, water: SeaWater) -> tuple[Array, Array]:
        """Return (N, 3) colours of sky, sea, rocks and buoys along rays, and (N,) how far they are, m."""
        shown, far = _sky(rays), np.full(len(rays), np.inf)
        waves = _Waves(centre, water)
        sea = _to_sea(centre, rays, waves)
        is_sea = sea < FARTHEST
        shown[is_sea] = self._sea(centre, rays[is_sea], sea[is_sea], waves)
        far[is_sea] = sea[is_sea]
        for scene, colour in ((self._rocks, ROCK), (self._buoys, BUOY)):
            if scene is None:
                continue
            distance, normals = scene.cast(centre, rays)
            is_nearer = np.nan_to_num(distance, nan=np.inf) < far
            shown[is_nearer] = _lit(colour, normals[is_nearer])
            far[is_nearer] = distance[is_nearer]
        return shown, far

    def _sea(self, centre: Array, rays: Array, distance: Array, waves: _Waves) -> Array:
        """Return (N, 3) colours of the water: the sky's reflection, the sun's, and what lies below."""
        places = centre + rays * distance[:, None]
        _, east, north = waves.at(places)
        normals = np.stack([-east, -north, np.ones(len(places))], axis=1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        facing = np.clip(-np.einsum("ij,ij->i", rays, normals), 0.0, 1.0)
        mirrored = rays + 2.0 * facing[:, None] * normals
        mirrored[:, 2] = np.abs(mirrored[:, 2])
        fresnel = (0.02 + 0.98 * (1.0 - facing) ** 5)[:, None]
        glitter = np.clip(mirrored @ SUN, 0.0, 1.0)[:, None] ** GLITTER
        below = self._below(places, rays, normals, facing)
        found: Array = (1.0 - fresnel) * below + fresnel * _sky(mirrored) + 1.5 * glitter
        return found

    def _below(self, places: Array, rays: Array, normals: Array, facing: Array) -> Array:
        """Return (N, 3) colours under the surface: deep water, paler where a reef or a rock's foot comes near."""
        light = DEEP * (0.75 + 0.5 * facing)[:, None]
        if self._rocks is None:
            return light
        straight = facing / REFRACTION - np.sqrt(1.0 - (1.0 - facing**2) / REFRACTION**2)
        bent = rays / REFRACTION + straight[:, None] * normals
        seen = np.exp(-np.nan_to_num(self._through(places, bent), nan=np.inf) / SEEN_DEPTH)[:, None]
        found: Array = (1.0 - seen) * light + seen * 1.6 * SHALLOW
        return found

    def _through(self, places: Array, rays: Array) -> Array:
        """Return (N,) the way from places on the surface through the water to rock, NaN without any."""
        assert self._rocks is not None
        return self._rocks.cast(places, rays)[0]

    def _with_boat(
        self, shown: Array, far: Array, centre: Array, rays: Array, position: Array, turn: Array
    ) -> tuple[Array, Array]:
        distance, normals = self._hull.cast((centre - position) @ turn, rays @ turn)
        is_boat = np.nan_to_num(distance, nan=np.inf) < far
        shown[is_boat] = _lit(BOAT, normals[is_boat] @ turn.T)
        far[is_boat] = distance[is_boat]
        return shown, far

    def _with_beams(
        self,
        picture: npt.NDArray[np.uint8],
        centre: Array,
        camera: Array,
        position: Array,
        turn: Array,
        ranges: npt.NDArray[Any],
    ) -> npt.NDArray[np.uint8]:
        """Return the picture with a line along each beam, the redder the nearer its echo."""
        import cv2

        start = np.array([position[0], position[1], BEAM_RISE])
        layer = picture.copy()
        for beam, reach, length in zip(self._beams @ turn.T, ranges, self._beam_lengths, strict=True):
            way = beam * [1.0, 1.0, 0.0]
            points = start + np.linspace(0.0, float(reach), 40)[:, None] * way
            seen = (points - centre) @ camera.T
            seen = seen[seen[:, 2] > 0.5]
            if len(seen) < 2:
                continue
            pixels = seen[:, :2] / seen[:, 2:] * self._focal + 0.5 * np.array(self.size)
            share = float(reach) / float(length)
            colour: Any = (255.0 * (share * CLEAR + (1.0 - share) * NEAR)).tolist()
            cv2.polylines(layer, [np.round(8.0 * pixels).astype(np.int32)], False, colour, BEAM_WIDTH, cv2.LINE_AA, 3)
            if reach < length:
                end = np.round(8.0 * pixels[-1]).astype(int).tolist()
                cv2.circle(layer, end, 8 * 2 * BEAM_WIDTH, colour, -1, cv2.LINE_AA, 3)
        return np.asarray(cv2.addWeighted(layer, 0.75, picture, 0.25, 0.0), np.uint8)


class _Waves:
    """The sea around a camera, summed up once for a picture."""

    def __init__(self, centre: Array, water: SeaWater) -> None:
        self._corner = centre[:2] - NEAR_WAVES
        count = int(2.0 * NEAR_WAVES / CELL) + 1
        along = CELL * np.arange(count)
        east, north = np.meshgrid(along, along)
        far = np.hypot(east - NEAR_WAVES, north - NEAR_WAVES)
        places = np.stack([east, north], axis=-1).reshape(-1, 2) + self._corner
        heights = np.exp(-far / CALM_FROM) * water.rise(places).reshape(count, count)
        slopes = np.gradient(heights, CELL)
        self._grid = np.stack([heights, slopes[1], slopes[0]], axis=-1)

    def at(self, places: Array) -> tuple[Array, Array, Array]:
        """Return the (N,) height over still water, m, and slope eastwards and northwards; none of them far off."""
        at = (places[:, :2] - self._corner) / CELL
        last = len(self._grid) - 1
        is_near = np.all((at >= 0.0) & (at < last), axis=1, keepdims=True)
        at = np.where(is_near, at, 0.0)
        column, row = at.astype(np.int64).T
        right, up = (at % 1.0).T[..., None]
        grid = self._grid
        lower = (1.0 - right) * grid[row, column] + right * grid[row, column + 1]
        upper = (1.0 - right) * grid[row + 1, column] + right * grid[row + 1, column + 1]
        height, east, north = np.where(is_near, (1.0 - up) * lower + up * upper, 0.0).T
        return height, east, north


def _to_sea(centre: Array, rays: Array, waves: _Waves) -> Array:
    """Return (N,) distances at which rays meet the waves, m; infinite for those that do not."""
    is_down = rays[:, 2] < -1e-4
    found = np.full(len(rays), np.inf)
    down = rays[is_down]
    distance = -centre[2] / down[:, 2]
    for _ in range(ROUNDS):
        height, *_ = waves.at(centre + down * distance[:, None])
        distance = (height - centre[2]) / down[:, 2]
    found[is_down] = np.where(distance < FARTHEST, distance, FARTHEST - 1.0)
    return found


def _sky(rays: Array) -> Array:
    height = np.clip(rays[:, 2], 0.0, 1.0)[:, None] ** 0.5
    found: Array = (1.0 - height) * HORIZON + height * ZENITH
    return found


def _lit(colour: Array, normals: Array) -> Array:
    sun = np.clip(normals @ SUN, 0.0, 1.0)[:, None]
    found: Array = colour * (0.35 + 0.15 * normals[:, 2:] + 0.75 * sun)
    return found


def hull_of(boat: Boat | OriginalVehicle) -> Mesh:
    """Return the hulls' triangles, body frame; those of the original's boat are its capsule's."""
    import trimesh

    if isinstance(boat, Boat):
        return Mesh(boat.surface.vertices, boat.surface.faces)
    hull = boat.capsule
    solid = trimesh.creation.capsule(height=hull.axis_length, radius=hull.radius)
    solid.apply_transform(trimesh.geometry.align_vectors([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    solid.apply_translation(-solid.bounds.mean(axis=0))
    return Mesh(np.asarray(solid.vertices, dtype=np.float64), np.asarray(solid.faces, dtype=np.int64))


def _cylinder(place: Array, radius: float, low: float, high: float) -> Mesh:
    import trimesh

    solid = trimesh.creation.cylinder(radius=radius, height=high - low, sections=16)
    solid.apply_translation([place[0], place[1], 0.5 * (low + high)])
    return Mesh(np.asarray(solid.vertices, dtype=np.float64), np.asarray(solid.faces, dtype=np.int64))


def _joined(meshes: list[Mesh]) -> Mesh:
    """Return meshes as one whose triangles share no corner, so that their edges show."""
    corners = np.concatenate([mesh.triangles.reshape(-1, 3) for mesh in meshes])
    return Mesh(corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3))

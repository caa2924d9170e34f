"""How far the picture has moved since a frame, by corners followed from look to look."""

from __future__ import annotations

import numpy as np

from aquanav_tools.reconstruct.intake.decode import GreyImage

_NUM_CORNERS = 200
_MIN_CORNERS = 10
_MIN_FOLLOWED = 0.4
"""Share of the corners that must still be in sight, or the picture has moved on farther than can be told."""
_MAX_RETURN_PX = 1.0
"""A corner followed there and back again must come back this close (Kalal et al., ICPR 2010)."""


class Flow:
    """Follows the corners of one frame through later ones by optical flow (Lucas and Kanade, in a pyramid)."""

    def __init__(self, first: GreyImage) -> None:
        import cv2

        corners = cv2.goodFeaturesToTrack(first, _NUM_CORNERS, 0.01, 8)
        self._start = np.zeros((0, 1, 2), np.float32) if corners is None else corners
        self._now = self._start
        self._num_corners = len(self._start)
        self._last = first

    @property
    def is_blind(self) -> bool:
        """Whether the frame it began with shows too little to follow: it is dark, or plain."""
        return self._num_corners < _MIN_CORNERS

    def motion_to(self, frame: GreyImage) -> float:
        """Return the median displacement of the corners up to the next frame, as a share of the width.

        It is infinite once most corners are lost.
        """
        import cv2

        if len(self._now):
            there, found, _ = cv2.calcOpticalFlowPyrLK(self._last, frame, self._now, None)
            back, returned, _ = cv2.calcOpticalFlowPyrLK(frame, self._last, there, None)
            astray = np.linalg.norm(back - self._now, axis=-1).ravel()
            is_same = (found & returned).ravel().astype(bool) & (astray < _MAX_RETURN_PX)
            self._start, self._now = self._start[is_same], there[is_same]
        self._last = frame
        if len(self._now) < _MIN_FOLLOWED * self._num_corners:
            return float("inf")
        return float(np.median(np.linalg.norm(self._now - self._start, axis=-1))) / frame.shape[1]

"""Where a frame of a ROS robot was at given times: the tree of tf, and tracks of odometry."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

MOST_GAP = 1.0
"""Between two different transforms farther apart than this (seconds), a pose is not interpolated."""
_SAME = 1e-6
MOST_BEYOND = 0.1
"""Before the first transform and after the last one, and inside such a gap, a pose holds this long (seconds)."""


@dataclass(slots=True)
class Track:
    """The poses of a child frame in its parent over time; one that is static has one pose for ever."""

    parent: str
    is_static: bool
    times: list[float] = field(default_factory=list)
    """Seconds."""
    quats_xyzw: list[tuple[float, float, float, float]] = field(default_factory=list)
    places: list[tuple[float, float, float]] = field(default_factory=list)
    """Metres."""

    def add(self, time: float, transform: tuple[tuple[float, float, float], tuple[float, float, float, float]]) -> None:
        """Adds a (place, quaternion) at a time; a quaternion of length 0 is left out."""
        if np.isfinite([*transform[0], *transform[1]]).all() and any(transform[1]):
            self.times.append(time)
            self.places.append(transform[0])
            self.quats_xyzw.append(transform[1])

    def at(self, times: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """(N, 4, 4) poses T_parent_child at these times (N,), and (N,) whether each is known."""
        Ts = np.broadcast_to(np.eye(4), (len(times), 4, 4)).copy()
        if not self.times:
            return Ts, np.zeros(len(times), np.bool_)
        order = np.argsort(self.times, kind="stable")
        own, keep = np.unique(np.array(self.times)[order], return_index=True)
        rotations = Rotation.from_quat(np.array(self.quats_xyzw)[order][keep])
        places = np.array(self.places)[order][keep]
        if self.is_static or len(own) == 1:
            Ts[:, :3, :3], Ts[:, :3, 3] = rotations[-1].as_matrix(), places[-1]
            return Ts, np.full(len(times), self.is_static) | (np.abs(times - own[-1]) <= MOST_BEYOND)
        after = np.clip(np.searchsorted(own, times), 1, len(own) - 1)
        before = after - 1
        nearest = np.where(times - own[before] < own[after] - times, own[before], own[after])
        quats = rotations.as_quat(canonical=True)
        is_moved = np.abs(np.hstack([places[after] - places[before], quats[after] - quats[before]])).max(axis=1) > _SAME
        has_gap = is_moved & (own[after] - own[before] > MOST_GAP)
        is_inside = (own[0] <= times) & (times <= own[-1]) & ~has_gap
        asked = np.where(is_inside, times, nearest)
        Ts[:, :3, :3] = Slerp(own, rotations)(asked).as_matrix()
        Ts[:, :3, 3] = np.column_stack([np.interp(asked, own, column) for column in places.T])
        return Ts, is_inside | (np.abs(times - nearest) <= MOST_BEYOND)


class TransformTree:
    """The transforms of tf: each frame has one parent."""

    def __init__(self) -> None:
        """Starts empty."""
        self._tracks: dict[str, Track] = {}

    def add(
        self,
        parent: str,
        child: str,
        time: float,
        transform: tuple[tuple[float, float, float], tuple[float, float, float, float]],
        *,
        is_static: bool,
    ) -> None:
        """Adds one (place, quaternion) of a child in its parent at a time in seconds; frames lose a leading `/`."""
        parent, child = parent.lstrip("/"), child.lstrip("/")
        track = self._tracks.setdefault(child, Track(parent, is_static))
        if track.parent == parent:
            track.add(time, transform)

    def chain(self, frame: str) -> list[str]:
        """The frame, its parent, and so on up to the root."""
        names = [frame.lstrip("/")]
        while names[-1] in self._tracks and self._tracks[names[-1]].parent not in names:
            names.append(self._tracks[names[-1]].parent)
        return names

    def moves(self, frame: str) -> bool:
        """Whether any transform between the frame and its root is not static."""
        return any(name in self._tracks and not self._tracks[name].is_static for name in self.chain(frame))

    def Ts(
        self, frame: str, ancestor: str, times: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """(N, 4, 4) poses T_ancestor_frame at these times (N,), and (N,) whether each is known."""
        Ts, is_known = np.broadcast_to(np.eye(4), (len(times), 4, 4)), np.ones(len(times), np.bool_)
        chain = self.chain(frame)
        for name in chain[: chain.index(ancestor.lstrip("/"))]:
            parts, are_known = self._tracks[name].at(times)
            Ts, is_known = parts @ Ts, is_known & are_known
        return Ts, is_known

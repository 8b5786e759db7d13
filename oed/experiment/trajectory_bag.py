"""Bags of ROS 2 with ``trajectory_msgs/msg/JointTrajectory``, through rosbags."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.data_files.file_guard import library_errors
from robotmodels.logs.bag_messages import bag_messages
from robotmodels.logs.message_types import standard_types
from robotmodels.logs.optional_library import optional_library

_TOPIC, _TYPE = "/joint_trajectory", "trajectory_msgs/msg/JointTrajectory"
_SECOND = 1_000_000_000
_VERSION = 8
"""Of the bag's metadata: what ROS 2 Humble and later read."""


def write_trajectories(
    folder: Path,
    joints: Sequence[str],
    sample_time: float,
    trajectories: Iterable[tuple[str, Array, Array]],
) -> None:
    """Write a new bag; each trajectory is a message, at the time at which it begins.

    Parameters
    ----------
    folder : Path
        Of the bag; it must not exist.
    joints : sequence of str
        Names of the n joints.
    sample_time : float, s
        Between points.
    trajectories : iterable of tuple of (str, ndarray, ndarray)
        Name, positions and velocities (K, n).
    """
    writer = optional_library("rosbags.rosbag2", "trajectory").Writer
    store = standard_types()
    types, begin = store.types, 0
    with writer(folder, version=_VERSION) as bag:
        connection = bag.add_connection(_TOPIC, _TYPE, typestore=store)
        for name, positions, velocities in trajectories:
            times = [round(k * sample_time * _SECOND) for k in range(len(positions) + 1)]
            duration, point = (
                types["builtin_interfaces/msg/Duration"],
                types["trajectory_msgs/msg/JointTrajectoryPoint"],
            )
            points = [
                point(p, v, np.zeros(0), np.zeros(0), duration(*divmod(t, _SECOND)))
                for p, v, t in zip(positions, velocities, times, strict=False)
            ]
            stamp = types["builtin_interfaces/msg/Time"](*divmod(begin, _SECOND))
            header = types["std_msgs/msg/Header"](stamp, name)
            message = types[_TYPE](header, list(joints), points)
            bag.write(connection, begin, store.serialize_cdr(message, _TYPE))
            begin += times[-1]


def read_trajectories(folder: Path) -> Iterator[tuple[str, Array, Array, Array]]:
    """Yield name, times (K,) [s], positions and velocities (K, n) of each trajectory of a bag.

    Raises
    ------
    InvalidInput
        If it is no such bag.
    """
    with library_errors(folder, "a bag of joint trajectories", Exception):
        for message in bag_messages(folder, {}, None):
            content = message.type.decode(message.raw)
            points = content.points
            times = [p.time_from_start.sec + p.time_from_start.nanosec / _SECOND for p in points]
            positions, velocities = (
                np.array([getattr(p, key) for p in points]) for key in ("positions", "velocities")
            )
            yield content.header.frame_id, np.array(times), positions, velocities

"""The scene as Mitsuba sees it: triangle meshes and the rays between samples and antennas."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.runtime import activate

# Shadow rays start this far above the surface, or they hit the facet they leave.
SHADOW_RAY_OFFSET_M = 1e-4
_LANES_PER_LAUNCH = 1 << 22

BACK_FACING, BLOCKED, VISIBLE = 0, 1, 2


def build_scene(meshes: Sequence[tuple[NDArray[np.float64], NDArray[np.int64]]]) -> Any:
    """A Mitsuba scene of triangle meshes.

    Args:
        meshes: (vertices in the radar frame (V, 3), faces (F, 3)) of every target.

    Returns:
        mi.Scene, for `sample_states`.
    """
    activate()
    import mitsuba as mi

    shapes = {}
    for index, (vertices, faces) in enumerate(meshes):
        mesh = mi.Mesh(f"target_{index}", vertex_count=len(vertices), face_count=len(faces))
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = np.ascontiguousarray(vertices, dtype=np.float32).ravel()
        parameters["faces"] = np.ascontiguousarray(faces, dtype=np.uint32).ravel()
        parameters.update()
        shapes[f"target_{index}"] = mesh
    return mi.load_dict({"type": "scene", **shapes})


class SampleTable:
    """Samples on the device, uploaded once for all launches.

    Args:
        points_m, normals: shape (S, 3).
    """

    def __init__(self, points_m: NDArray[np.float64], normals: NDArray[np.float64]) -> None:
        from waveformer.simulator.device import to_device

        self.count = len(points_m)
        self.points, self.normals = to_device(points_m), to_device(normals)


def sample_states(
    scene: Any,
    samples: SampleTable,
    two_sided: bool,
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64] | None,
    *,
    members: NDArray[np.int64] | None = None,
    pairs: tuple[NDArray[Any], ...] | None = None,
) -> NDArray[np.uint8]:
    """BACK_FACING, BLOCKED or VISIBLE for pairs of antenna position and sample.

    Args:
        scene: from `build_scene`.
        samples: S samples.
        two_sided: a two-sided sample never faces away.
        tx_m, rx_m: positions (P, 3); rx_m None means monostatic.
        members: rows of `samples` to test, (M,); None means all.
        pairs: row of `tx_m` and entry of `members` of the pairs to test, (L,) each; None tests all.

    Returns:
        Shape (P, M), or (L,) for given pairs.
    """
    if pairs is not None:
        parts = []
        for start in range(0, len(pairs[0]), _LANES_PER_LAUNCH):
            row, column = (part[start:][:_LANES_PER_LAUNCH] for part in pairs)
            sample = column if members is None else members[column]
            parts.append(_launch(scene, samples, two_sided, tx_m, rx_m, row, sample))
        return np.concatenate(parts) if parts else np.empty(0, dtype=np.uint8)
    count = samples.count if members is None else len(members)
    states = np.empty((len(tx_m), count), dtype=np.uint8)
    rows_per_launch = max(1, _LANES_PER_LAUNCH // max(1, count))
    for start in range(0, len(tx_m) if states.size else 0, rows_per_launch):
        rows = slice(start, start + rows_per_launch)
        receivers = None if rx_m is None else rx_m[rows]
        flat = _launch(scene, samples, two_sided, tx_m[rows], receivers, None, members)
        states[rows] = flat.reshape(count, -1).T
    return states


def _launch(
    scene: Any,
    samples: SampleTable,
    two_sided: bool,
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64] | None,
    row: NDArray[Any] | None,
    sample: NDArray[Any] | None,
) -> NDArray[np.uint8]:
    """States in one launch, a lane a pair; without rows all pairs, sample by sample."""
    import drjit as dr
    import mitsuba as mi

    from waveformer.simulator.device import to_device, to_device_index

    chosen = None if sample is None else to_device_index(sample)
    if row is None:
        # rays that leave one sample side by side traverse the same nodes
        columns = samples.count if sample is None else len(sample)
        lane = dr.arange(mi.UInt32, len(tx_m) * columns)
        column = lane // dr.opaque(mi.UInt32, len(tx_m))
        lane_row = lane - column * dr.opaque(mi.UInt32, len(tx_m))
        lane_sample = column if chosen is None else dr.gather(mi.UInt32, chosen, column)
    else:
        lane_row, lane_sample = to_device_index(row), chosen
    point = dr.gather(mi.Point3f, samples.points, lane_sample)
    normal = dr.gather(mi.Vector3f, samples.normals, lane_sample)
    facing, free, side = mi.Bool(True), mi.Bool(True), None
    for positions in (tx_m,) if rx_m is None else (tx_m, rx_m):
        antenna = dr.gather(mi.Point3f, to_device(positions), lane_row)
        towards = dr.dot(normal, antenna - point)
        if side is None:
            side = dr.select(towards < 0, -1.0, 1.0) if two_sided else mi.Float(1.0)
        facing &= towards * side > 0
        origin = point + normal * (side * SHADOW_RAY_OFFSET_M)
        distance = dr.norm(antenna - origin)
        ray = mi.Ray3f(origin, (antenna - origin) / distance)
        ray.maxt = distance
        free &= ~scene.ray_test(ray, facing)
    state = dr.select(facing, dr.select(free, mi.UInt32(VISIBLE), BLOCKED), BACK_FACING)
    return np.asarray(state.numpy(), dtype=np.uint8)

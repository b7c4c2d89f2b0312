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


def sample_states(
    scene: Any,
    points_m: NDArray[np.float64],
    normals: NDArray[np.float64],
    two_sided: bool,
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64] | None,
    sample_row: NDArray[np.int64] | None = None,
    position_row: NDArray[np.int64] | None = None,
) -> NDArray[np.uint8]:
    """BACK_FACING, BLOCKED or VISIBLE for pairs of samples and antenna positions.

    Args:
        scene: from `build_scene`.
        points_m, normals: samples, (S, 3).
        two_sided: a two-sided sample never faces away.
        tx_m, rx_m: positions (P, 3); rx_m None means monostatic.
        sample_row, position_row: the pairs to test, (L,) each; None tests all of them.

    Returns:
        Shape (L,), or (P, S) when all pairs are tested.
    """
    if sample_row is None or position_row is None:
        states = np.empty((len(tx_m), len(points_m)), dtype=np.uint8)
        rows_per_launch = max(1, _LANES_PER_LAUNCH // max(1, len(points_m)))
        every_sample = np.arange(len(points_m))
        for start in range(0, len(tx_m), rows_per_launch):
            rows = np.arange(start, min(start + rows_per_launch, len(tx_m)))
            states[rows] = _pair_states(
                scene,
                points_m,
                normals,
                two_sided,
                tx_m,
                rx_m,
                np.tile(every_sample, len(rows)),
                np.repeat(rows, len(points_m)),
            ).reshape(len(rows), -1)
        return states
    parts = [
        _pair_states(
            scene,
            points_m,
            normals,
            two_sided,
            tx_m,
            rx_m,
            sample_row[start : start + _LANES_PER_LAUNCH],
            position_row[start : start + _LANES_PER_LAUNCH],
        )
        for start in range(0, len(sample_row), _LANES_PER_LAUNCH)
    ]
    return np.concatenate(parts) if parts else np.empty(0, dtype=np.uint8)


def _pair_states(
    scene: Any,
    points_m: NDArray[np.float64],
    normals: NDArray[np.float64],
    two_sided: bool,
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64] | None,
    sample_row: NDArray[np.int64],
    position_row: NDArray[np.int64],
) -> NDArray[np.uint8]:
    import drjit as dr
    import mitsuba as mi

    from waveformer.simulator.device import to_device, to_device_index

    sample, row = to_device_index(sample_row), to_device_index(position_row)
    point = dr.gather(mi.Point3f, to_device(points_m), sample)
    normal = dr.gather(mi.Vector3f, to_device(normals), sample)
    facing, free, side = mi.Bool(True), mi.Bool(True), None
    for positions in (tx_m,) if rx_m is None else (tx_m, rx_m):
        antenna = dr.gather(mi.Point3f, to_device(positions), row)
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

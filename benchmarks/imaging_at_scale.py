"""Imaging at scale: the merged sub-apertures against the direct sum, at the twin's and at MITO's density, and the chain."""

from __future__ import annotations

import resource
import sys
import time
from typing import Any

import numpy as np
from scenes import bumpy_ellipsoid, measure, report

from waveformer.model.imaging_volume import Volume
from waveformer.model.proposal import propose_surfaces
from waveformer.simulator import Aperture, Chirp, Grid, Measurement, simulate
from waveformer.simulator.direct_image import direct_image
from waveformer.simulator.focusing import Focus, focus
from waveformer.simulator.mesh import SurfaceMesh, load_mesh

CHIRP = Chirp(start_hz=77.5001e9, bandwidth_hz=3.0009e9, num_samples=64)
TWIN = Aperture.planar_grid(76, 101, 0.004)
# 44,000 places, along robot rows 2 mm apart, and four receivers beside the transmitter
MITO_PLACES = Aperture.planar_grid(220, 200, (0.0014, 0.002))
RECEIVERS_M = np.array(
    [[-0.010802, 0.0, 0.0], [-0.008868, 0.0, 0.0], [-0.006934, 0.0, 0.0], [-0.005, 0.0, 0.0]]
)
MARGIN_M = np.array([0.03, 0.03, 0.045])
EXTENT_M = 0.1


def resting_object() -> SurfaceMesh:
    """The benchmarks' object, 10 cm long, resting at z = -0.45 m."""
    mesh = bumpy_ellipsoid()
    points = mesh.vertices_m * (EXTENT_M / np.ptp(mesh.vertices_m, axis=0).max())
    points = points - 0.5 * (points.min(axis=0) + points.max(axis=0))
    points[:, 2] -= 0.45 + points[:, 2].min()
    import trimesh

    return load_mesh(trimesh.Trimesh(points, mesh.faces, process=False))


def crop(mesh: SurfaceMesh) -> Volume:
    """What is imaged of a twin's scan."""
    return Volume(mesh.vertices_m.min(axis=0) - MARGIN_M, mesh.vertices_m.max(axis=0) + MARGIN_M)


def largest_error(found: Focus, expected: Focus) -> float:
    """Largest relative error where the image is above 0.2 of its maximum."""
    strong = np.abs(expected.image) > 0.2 * np.abs(expected.image).max()
    return float((np.abs(found.image - expected.image)[strong] / np.abs(expected.image[strong])).max())


def compare(name: str, scan: Measurement, grid: Grid, part: Grid, runs: int) -> dict[str, Any]:
    """Rates of both programs; the direct one over a part of the grid."""
    pairs, part_pairs = (
        float(np.prod(grid.shape)) * len(scan.aperture),
        float(np.prod(part.shape)) * len(scan.aperture),
    )
    merged = measure(lambda: focus(scan, grid), runs)
    plain = measure(lambda: focus(scan, grid, normals=False), runs)
    direct = measure(lambda: direct_image(scan, part, normals=False), 2)
    merged_rate, plain_rate, direct_rate = merged.rate(pairs), plain.rate(pairs), direct.rate(part_pairs)
    return {
        "name": name,
        "voxels": int(np.prod(grid.shape)),
        "channels": len(scan.aperture),
        "image_wall_s": sorted(merged.wall_s)[len(merged.wall_s) // 2],
        "direct_per_cpu_s": direct_rate["pairs_per_cpu_s"],
        "focus_per_cpu_s": plain_rate["pairs_per_cpu_s"],
        "faster_than_direct": plain_rate["pairs_per_cpu_s"] / direct_rate["pairs_per_cpu_s"],
        "normals_add": plain_rate["pairs_per_cpu_s"] / merged_rate["pairs_per_cpu_s"] - 1.0,
        "largest_error": largest_error(focus(scan, part), direct_image(scan, part)),
        "peak_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
    }


def middle_of(grid: Grid, count: int) -> Grid:
    """The middle voxels of a grid."""
    axes = (grid.x, grid.y, grid.z)
    return Grid(*(axis[max(0, (len(axis) - count) // 2) :][:count] for axis in axes))


def main(quick: bool) -> None:
    mesh = resting_object()
    volume = crop(mesh)
    twin = simulate(mesh, CHIRP, TWIN)
    grid = Grid.box(volume.min_m, volume.max_m, 0.003)
    rows = [compare("twin's scan, 3 mm", twin, grid, grid, 2 if quick else 5)]

    seconds = []
    for _ in range(2 if quick else 5):
        started = time.perf_counter()
        propose_surfaces(twin, crop=volume, rng=np.random.default_rng(0))
        seconds.append(time.perf_counter() - started)
    rows.append(
        {
            "name": "from H to candidates and choice",
            "chain_wall_s": sorted(seconds[1:])[(len(seconds) - 1) // 2],
        }
    )

    places = MITO_PLACES.tx_m[:: 8 if quick else 1]
    tx = np.repeat(places, 4, axis=0)
    dense = simulate(mesh, CHIRP, Aperture(tx, tx + np.tile(RECEIVERS_M, (len(places), 1))))
    fine = Grid.box(volume.min_m, volume.max_m, 0.001)
    rows.append(compare("MITO's density, 1 mm", dense, fine, middle_of(fine, 30), 1))
    report(rows)


if __name__ == "__main__":
    main("--quick" in sys.argv)

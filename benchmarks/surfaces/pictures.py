"""The picture of docs/surfaces.md: where balls and a plate shine."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from waveformer.simulator import Aperture, Chirp, Grid, focus, primitives, simulate

CHIRP = Chirp(77.5001e9, 3.0009e9, 64)
APERTURE = Aperture.planar_grid(76, 101, 0.004)
TOP_M = -0.36


def main(path: Path) -> None:
    """Slices through the middle, x to the right, z up."""
    figure, panels = plt.subplots(1, 3, figsize=(12, 4.2), layout="constrained", sharey=True)
    grid = Grid.box((-0.06, 0.0, TOP_M - 0.11), (0.06, 0.0, TOP_M + 0.05), 0.001)
    for panel, radius_m in zip(panels, (0.02, 0.045, None), strict=True):
        shape = primitives.plate(0.08, 0.08) if radius_m is None else primitives.sphere(radius_m)
        shape.apply_translation([0.0, 0.0, TOP_M - (radius_m or 0.0)])
        image = np.abs(focus(simulate(shape, CHIRP, APERTURE), grid, normals=False).image[:, 0])
        level_db = 20.0 * np.log10(np.maximum(image / image.max(), 1e-3))
        extent = 100.0 * np.array([grid.x[0], grid.x[-1], grid.z[0], grid.z[-1]])
        drawn = panel.imshow(
            level_db.T, origin="lower", extent=tuple(extent), cmap="inferno", vmin=-25.0, vmax=0.0
        )
        if radius_m is None:
            panel.plot([-4.0, 4.0], [100.0 * TOP_M] * 2, color="#7fd4ff")
            panel.set(title="plate: on the surface", xlabel="x (cm)")
        else:
            turn = np.linspace(0.0, 2.0 * np.pi, 200)
            center_cm = 100.0 * (TOP_M - radius_m)
            panel.plot(
                100.0 * radius_m * np.cos(turn), center_cm + 100.0 * radius_m * np.sin(turn), color="#7fd4ff"
            )
            panel.plot(0.0, center_cm, "+", color="#7fd4ff", ms=10)
            panel.set(title=f"ball of {100 * radius_m:g} cm radius: inside", xlabel="x (cm)")
    panels[0].set_ylabel("z (cm), the radar is above")
    figure.colorbar(drawn, ax=panels, label="|S| in dB")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]))

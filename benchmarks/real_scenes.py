"""What matter, sheets, a box, receivers and the front end cost, over a perfect conductor in free space."""

from __future__ import annotations

import statistics
import sys
from typing import Any

from scenes import APERTURE, CHIRP, bumpy_ellipsoid, measure, report

from waveformer.simulator import Antenna, Aperture, Box, FrontEnd, Material, Sheet, Target, simulate

SHEET = Sheet((0.0, 0.0, -0.15), (0.0, 0.0, 1.0), 0.004, "cardboard")
BOX = Box((-0.16, -0.13, -0.45), (0.16, 0.13, -0.2), 0.004, "cardboard")
# a quarter of the positions with four receivers each: as many pairs as the others
RECEIVERS_M = [[-0.0108, 0.0, 0.0], [-0.0089, 0.0, 0.0], [-0.0069, 0.0, 0.0], [-0.005, 0.0, 0.0]]


def scenes() -> dict[str, tuple[Material, Aperture, dict[str, Any]]]:
    """Name -> (material, aperture, other arguments of `simulate`)."""
    from waveformer.simulator.arrays import with_receivers

    conductor, thin = Material.pec(), Material.named("abs", thickness_m=0.003)
    rows = with_receivers(Aperture.planar_grid(num_x=30, num_y=30, spacing_m=0.006), RECEIVERS_M)
    return {
        "conductor in free space": (conductor, APERTURE, {}),
        "rough conductor": (Material.pec(roughness_m=2e-4), APERTURE, {}),
        "dielectric body": (Material.named("rubber"), APERTURE, {}),
        "thin plastic wall": (thin, APERTURE, {}),
        "antenna pattern": (conductor, APERTURE, {"antenna": Antenna.from_preset("iwr1443")}),
        "behind a cardboard sheet": (conductor, APERTURE, {"sheets": (SHEET,)}),
        "in a cardboard box": (conductor, APERTURE, {"box": BOX}),
        "900 positions, 4 receivers": (conductor, rows, {}),
        "front end of the IWR1443": (conductor, APERTURE, {"front_end": FrontEnd.from_preset("iwr1443")}),
    }


def main(quick: bool) -> None:
    mesh = bumpy_ellipsoid()
    rows: list[dict[str, Any]] = []
    for name, (material, aperture, arguments) in scenes().items():
        target = Target(mesh, material)
        timing = measure(lambda: simulate(target, CHIRP, aperture, **arguments), 1 if quick else 3)  # noqa: B023
        rows.append(
            {
                "name": name,
                "scene_wall_s": statistics.median(timing.wall_s),
                "scene_cpu_s": statistics.median(timing.cpu_s),
            }
        )
        rows[-1]["over_conductor"] = rows[-1]["scene_cpu_s"] / rows[0]["scene_cpu_s"]
    report(rows)


if __name__ == "__main__":
    main("--quick" in sys.argv)

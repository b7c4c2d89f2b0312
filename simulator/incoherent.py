"""Mean echo power by an ordinary Mitsuba render: intensities only, no phase, no interference.

The counterpart of `simulate` where positions, band or poses are averaged over, so that interference cancels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.bsdf import register_bsdfs
from waveformer.simulator.bsdf_parameters import DEFAULT_LOBE_WIDTH_DEG, SPECULAR
from waveformer.simulator.errors import RadarError
from waveformer.simulator.mesh import SurfaceMesh, load_mesh
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.target import Target, as_targets, rotate

# The pinhole camera sees at most a cone of this half angle.
_MAX_HALF_ANGLE_DEG = 75.0


def mean_echo_power(
    scene: Any,
    position_m: ArrayLike,
    frequency_hz: float,
    *,
    pixels: int = 512,
    samples_per_pixel: int = 4,
    seed: int = 0,
) -> float:
    """Received over transmitted power of an isotropic monostatic radar, single bounce, incoherently summed.

    1. A point light of intensity 1 / (4 pi) W/sr at the radar sends 1 W.
    2. A pinhole camera at the same place renders the radiance L, one bounce, the light's shadow included.
    3. An isotropic antenna has the area lambda^2 / (4 pi), so |h|^2 = lambda^2 / (4 pi) int L domega.

    With L = f_r cos / (4 pi R^2) and domega = cos dA / R^2 this is the radar equation
    lambda^2 sigma / ((4 pi)^3 R^4) with sigma = 4 pi int f_r cos^2 dA, as long as R is the same all over the target;
    where it is not, every point keeps its own.

    Args:
        scene: mi.Scene whose shapes have the plugin radar_specular (its emitters and sensors play no part), or
            targets as for `simulate`.
        position_m: of the radar, shape (3,).
        frequency_hz: for lambda, and for the materials of targets; a mi.Scene's plugins have their own.
        pixels: of the square image; the lobe on the smallest highlight should cover some dozens.
        samples_per_pixel: rays.
        seed: of the rays.

    Raises:
        RadarError: the scene reaches around the radar.
        MeshError: a mesh cannot be used.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    register_bsdfs()
    import mitsuba as mi

    if not isinstance(scene, mi.Scene):
        scene = incoherent_scene(scene, frequency_hz)
    position = np.asarray(position_m, dtype=np.float64)
    axis, half_width = _view(scene, position)
    lit = mi.load_dict(
        {
            "type": "scene",
            "light": {
                "type": "point",
                "position": position.tolist(),
                "intensity": {"type": "spectrum", "value": 1.0 / (4.0 * math.pi)},
            },
            **{f"shape_{index}": shape for index, shape in enumerate(scene.shapes())},
        }
    )
    camera = mi.load_dict(
        {
            "type": "perspective",
            "to_world": mi.ScalarTransform4f().look_at(
                position.tolist(), (position + axis).tolist(), _across(axis).tolist()
            ),
            "fov": math.degrees(2.0 * math.atan(half_width)),
            "near_clip": 1e-3,
            "film": {
                "type": "hdrfilm",
                "width": pixels,
                "height": pixels,
                "pixel_format": "luminance",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "stratified", "sample_count": samples_per_pixel},
        }
    )
    integrator = mi.load_dict({"type": "direct", "emitter_samples": 1, "bsdf_samples": 0})
    radiance = np.array(mi.render(lit, sensor=camera, integrator=integrator, seed=seed), dtype=np.float64)
    wavelength_m = SPEED_OF_LIGHT_M_PER_S / frequency_hz
    solid_angles = _pixel_solid_angles(pixels, half_width)
    return float(wavelength_m**2 / (4.0 * math.pi) * (radiance[:, :, 0] * solid_angles).sum())


def incoherent_scene(
    targets: Any, frequency_hz: float, *, lobe_width_deg: float = DEFAULT_LOBE_WIDTH_DEG
) -> Any:
    """Targets as a mi.Scene of meshes with the plugin radar_specular.

    Facets stay flat, so the lobe should be wider than the angle between neighbours on a curved surface.

    Args:
        targets: as for `simulate`.
        frequency_hz: at which the materials are evaluated.
        lobe_width_deg: see `bsdf_parameters.BsdfParameters`.

    Raises:
        MeshError: a mesh cannot be used.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    register_bsdfs()
    import mitsuba as mi

    shapes = {}
    for index, target in enumerate(as_targets(targets)):
        mesh = target.mesh if isinstance(target.mesh, SurfaceMesh) else load_mesh(target.mesh)
        properties = mi.Properties()
        properties["mesh_bsdf"] = mi.load_dict(_plugin(target, frequency_hz, lobe_width_deg))
        shape = mi.Mesh(f"target_{index}", len(mesh.vertices_m), len(mesh.faces), props=properties)
        vertices = rotate(mesh.vertices_m, target.pose) + target.pose[:3, 3]
        parameters = mi.traverse(shape)
        parameters["vertex_positions"] = np.ascontiguousarray(vertices, dtype=np.float32).ravel()
        parameters["faces"] = np.ascontiguousarray(mesh.faces, dtype=np.uint32).ravel()
        parameters.update()
        shapes[f"target_{index}"] = shape
    return mi.load_dict({"type": "scene", **shapes})


def _plugin(target: Target, frequency_hz: float, lobe_width_deg: float) -> dict[str, Any]:
    """The material of a target as a dictionary for mi.load_dict."""
    material = target.material
    plugin: dict[str, Any] = {
        "type": SPECULAR,
        "roughness": material.roughness_m,
        "frequency": frequency_hz,
        "lobe_width": lobe_width_deg,
    }
    if material.permittivity is None:
        return plugin | {"material": "pec"}
    value = material.permittivity.at(frequency_hz)
    plugin |= {"permittivity": value.real, "loss": -value.imag}
    return plugin if material.thickness_m is None else plugin | {"thickness": material.thickness_m}


def _view(scene: Any, position: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Direction to the middle of the scene, and the tangent of half the field of view that holds all of it."""
    box = scene.bbox()
    bounds = np.array([box.min, box.max], dtype=np.float64)
    axis = bounds.mean(axis=0) - position
    axis /= np.linalg.norm(axis) or 1.0
    corners = np.stack(np.meshgrid(*bounds.T, indexing="ij"), axis=-1).reshape(-1, 3) - position
    along = corners @ axis
    across = np.linalg.norm(corners - along[:, None] * axis, axis=1)
    if not (along > 0.0).all() or (widest := float((across / along).max())) > math.tan(
        math.radians(_MAX_HALF_ANGLE_DEG)
    ):
        raise RadarError(
            f"the radar at {position.tolist()} m stands in or too near the scene, which reaches from "
            f"{bounds[0].tolist()} to {bounds[1].tolist()} m: move it away"
        )
    return axis, widest


def _across(axis: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Some direction across an axis, for the camera's up."""
    return np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])


def _pixel_solid_angles(pixels: int, half_width: float) -> NDArray[np.float64]:
    """Solid angles of the pixels of a pinhole camera, shape (pixels, pixels)."""
    centers = ((np.arange(pixels) + 0.5) / pixels * 2.0 - 1.0) * half_width
    square = 1.0 + centers[:, None] ** 2 + centers[None, :] ** 2
    return np.asarray((2.0 * half_width / pixels) ** 2 / square**1.5)

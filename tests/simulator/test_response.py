"""The factor W in both kernels equals its NumPy twin, pair by pair and summed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from waveformer.simulator import primitives
from waveformer.simulator.antenna import Antenna
from waveformer.simulator.materials import Material
from waveformer.simulator.occluders import Box, Sheet
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.reference import dense_echo
from waveformer.simulator.reference_response import pair_response
from waveformer.simulator.response_plan import Crossings, ResponsePlan, plan_response
from waveformer.simulator.surroundings import Surroundings

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77.5001e9, 3.0009e9, 16)
SLANTED = Sheet((0.0, 0.0, -0.15), (0.2, -0.3, 1.0), 0.004, 1.5 - 0.05j)
LEVEL = Sheet((0.0, 0.0, -0.12), (0.0, 0.0, 1.0), 0.003, 2.6 - 0.02j)
BOX = Box((-0.08, -0.07, -0.42), (0.08, 0.07, -0.2), 0.004, "cardboard")
GAIN, BEAM = Antenna.isotropic(10.0), Antenna.cosine_power(10.0, 60.0, 40.0)
Case = tuple[Material, Surroundings, Crossings]
CASES: dict[str, Case] = {
    "rough conductor": (Material.pec(roughness_m=3e-4), Surroundings(), "none"),
    "half space": (Material.dielectric(2.6 - 0.3j), Surroundings(polarization=(1.0, 0.3, 0.2)), "none"),
    "wall of a box": (Material.dielectric(2.6 - 0.3j, thickness_m=0.004), Surroundings(), "none"),
    "thin wall": (Material.dielectric(2.6 - 0.02j, thickness_m=0.003), Surroundings(), "none"),
    "two sheets": (Material.pec(), Surroundings(sheets=(SLANTED, LEVEL)), "none"),
    "inside a box": (Material.pec(), Surroundings(box=BOX), "leaving"),
    "beyond a box": (Material.dielectric(4.0), Surroundings(box=BOX, sheets=(LEVEL,)), "any"),
    "pattern": (Material.pec(), Surroundings(antenna=Antenna.from_preset("iwr1443")), "none"),
    "gain on matter": (Material.dielectric(2.6 - 0.3j), Surroundings(GAIN), "none"),
    "gain through a sheet": (Material.dielectric(2.6 - 0.3j), Surroundings(GAIN, sheets=(LEVEL,)), "none"),
    "gain in a box": (Material.pec(roughness_m=3e-4), Surroundings(GAIN, box=BOX), "leaving"),
    "pattern on matter": (Material.dielectric(2.6 - 0.3j), Surroundings(BEAM), "none"),
    "pattern through a sheet": (Material.dielectric(2.6 - 0.3j), Surroundings(BEAM, sheets=(LEVEL,)), "none"),
}


def planned(name: str) -> ResponsePlan:
    facet_m = np.array([0.004, 0.003, 0.002]) if name == "wall of a box" else None
    below = -0.25 if CASES[name][2] == "any" else 0.0
    bounds_m = np.array([[-0.07, -0.06, -0.41 + below], [0.07, 0.06, -0.21 + below]])
    antennas_m = np.array([[-0.22, -0.22, 0.0], [0.22, 0.22, 0.0]])
    return plan_response(*CASES[name], CHIRP, 1e-3, bounds_m, antennas_m, facet_m)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("is_bistatic", [False, True])
def test_every_pair_equals_the_twin(rng: np.random.Generator, name: str, is_bistatic: bool) -> None:
    import drjit as dr

    from waveformer.simulator.backend import UInt32
    from waveformer.simulator.device import to_device, to_device_vectors
    from waveformer.simulator.echo_terms import echo, leg
    from waveformer.simulator.response import Response

    plan = planned(name)
    count = 500
    points = rng.uniform((-0.07, -0.06, -0.41), (0.07, 0.06, -0.21), (count, 3))
    if plan.crossings == "any":
        points += np.array([0.0, 0.0, -0.25])
    normals = rng.normal(size=(count, 3)) + [0, 0, 2.0]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    if plan.facet_m is not None:  # rectangles lie along the axes
        normals = np.eye(3)[rng.integers(3, size=count)] * rng.choice([-1.0, 1.0], (count, 1))
    tx = rng.uniform((-0.2, -0.2, -0.001), (0.2, 0.2, 0.001), (count, 3))
    rx = tx + rng.uniform(-0.02, 0.02, (count, 3)) if is_bistatic else tx
    ways: list[Any] = []
    for antenna in (tx, rx) if is_bistatic else (tx,):
        nothing = to_device_vectors(np.zeros((count, 3)))
        length = to_device(np.linalg.norm(antenna - points, axis=1))
        ways.append(leg(to_device_vectors(antenna - points), length, nothing, to_device_vectors(normals)))
    one, zero = to_device(np.ones(count)), to_device(np.zeros(count))
    amplitude, _, cosine = echo(ways[0], ways[-1] if is_bistatic else None, one, zero, False)
    lit = amplitude.numpy() > 0
    assert lit.sum() > 150
    frequency = len(plan.frequencies_hz) - 1
    response = Response(plan)
    entry = dr.full(UInt32, frequency, count)
    surface = response.surface(ways, cosine, to_device_vectors(normals), entry)
    weight = (surface * response.path(to_device_vectors(points), ways, entry)).numpy()
    twin = pair_response(
        plan, float(plan.frequencies_hz[frequency]), points, normals, tx, rx,
    )  # fmt: skip
    # rectangles are expanded to first order in their curvature, 0.03 rad at 0.2 m, and in the slope of the amplitude
    tolerance = 2e-4 if plan.facet_m is None else 5e-3
    # float32: walls of 12 mm are 30 rad thick there and back, cosines good to 1e-7; the pattern's table 1e-4
    assert np.abs(weight - twin)[lit].max() < tolerance * max(1.0, np.abs(twin).max())


@pytest.mark.parametrize("name", CASES)
def test_between_its_frequencies_the_response_is_interpolated_to_the_tolerance(
    rng: np.random.Generator, name: str
) -> None:
    plan = planned(name)
    points = rng.uniform((-0.07, -0.06, -0.41), (0.07, 0.06, -0.21), (200, 3))
    normal = np.array([0.0, 0.0 if plan.facet_m is not None else 0.1, 1.0])
    normals = np.tile(normal / np.linalg.norm(normal), (200, 1))
    antenna = np.array([0.05, -0.1, 0.0])

    def at(frequency_hz: float) -> np.ndarray:
        return pair_response(plan, frequency_hz, points, normals, antenna, antenna)

    nodes = np.stack([at(float(f)) for f in plan.frequencies_hz])
    exact = np.stack([at(float(f)) for f in CHIRP.frequencies_hz])
    # the tolerance given to plan_response
    assert np.abs(plan.to_samples.T @ nodes - exact).max() < 1e-3 * np.abs(exact).max()


@pytest.mark.parametrize("name", [name for name in CASES if name != "wall of a box"])
def test_both_modes_equal_the_dense_sum(name: str) -> None:
    from waveformer.simulator.echo_source import EchoSource
    from waveformer.simulator.exact_echo import exact_echo
    from waveformer.simulator.factorisation import taper_scale
    from waveformer.simulator.fast_echo import fast_echo
    from waveformer.simulator.mesh import load_mesh
    from waveformer.simulator.numerics import EXACT, FAST
    from waveformer.simulator.quadrature import sample_surface
    from waveformer.simulator.scene import VISIBLE, SampleTable, build_scene, sample_states

    plan = planned(name)
    mesh = primitives.sphere(0.02, 0.003)
    mesh.apply_translation([0.02, 0.01, -0.5 if plan.crossings == "any" else -0.3])
    surface = load_mesh(mesh)
    samples = sample_surface(surface, np.eye(4), 0.0013)
    scene = build_scene([(surface.vertices_m, surface.faces)])
    grid = Aperture.planar_grid(10, 10, 0.006, center_m=(0.04, 0.0, 0.0))
    aperture = Aperture(grid.tx_m, grid.tx_m + [-0.008, 0.0, 0.0])
    rows = np.arange(0, 100, 19)
    some = Aperture(aperture.tx_m[rows], aperture.receivers_m[rows])
    states = sample_states(scene, SampleTable(samples.points_m, samples.normals), False, some.tx_m, some.rx_m)
    taper = taper_scale(samples, CHIRP.wavelengths_m.mean(), True)
    expected = dense_echo(samples, taper, CHIRP, some, states == VISIBLE, False, plan)
    for kernel, numerics, tolerance in ((fast_echo, FAST, 6e-3), (exact_echo, EXACT, 3e-4)):
        h = np.zeros((100, 16), dtype=complex)

        def add(part: Any, echo: Any, h: np.ndarray = h) -> None:
            h[part] += echo

        kernel(scene, EchoSource(samples, False, 0.25, plan), CHIRP, aperture, numerics, None, add)
        # fast: 3e-3 from the limb of a 2 cm sphere seen by pairs, as without a response, and as much for the
        # interpolations; exact: float32
        error = np.linalg.norm(h[rows] - expected) / np.linalg.norm(expected)
        assert error < tolerance, (kernel.__name__, error)


def test_with_no_thickness_of_matter_nothing_changes() -> None:
    plain, empty = Surroundings(), Surroundings(sheets=(replace(LEVEL, permittivity=1.0),))
    points, normals = np.array([[0.01, 0.0, -0.3]]), np.array([[0.0, 0.0, 1.0]])
    antenna = np.array([0.05, 0.02, 0.0])
    plans = [
        plan_response(Material.pec(), s, "none", CHIRP, 1e-3, points, antenna[None]) for s in (plain, empty)
    ]
    values = [pair_response(plan, 78e9, points, normals, antenna, antenna) for plan in plans]
    assert np.allclose(values[0], values[1], atol=1e-14)
    assert np.allclose(values[0], -1.0, atol=1e-14)


CHANGES = [
    ("half space", None, "real"), ("half space", None, "imaginary"), ("thin wall", None, "real"),
    ("thin wall", None, "imaginary"), ("thin wall", None, "thickness"), ("rough conductor", None, "roughness"),
    ("two sheets", 0, "real"), ("two sheets", 1, "imaginary"), ("two sheets", 1, "thickness"),
    ("inside a box", 0, "real"), ("inside a box", 0, "thickness"), ("beyond a box", 0, "imaginary"),
    ("beyond a box", 1, "thickness"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "wall", "component"), CHANGES)
def test_along_a_number_the_response_changes_as_its_central_difference(
    rng: np.random.Generator, name: str, wall: int | None, component: Any
) -> None:
    import drjit as dr

    from waveformer.simulator.backend import Float, UInt32
    from waveformer.simulator.device import to_device, to_device_vectors
    from waveformer.simulator.echo_terms import echo, leg
    from waveformer.simulator.matter_parameters import changed
    from waveformer.simulator.response import Response
    from waveformer.simulator.response_plan import WallChange

    plan, change, count = planned(name), WallChange(wall, component), 100
    if plan.surroundings.box is not None:  # of constant permittivity: what may change is one number
        box = replace(plan.surroundings.box, permittivity=1.8 - 0.05j)
        plan = replace(plan, surroundings=replace(plan.surroundings, box=box))
    points = rng.uniform((-0.07, -0.06, -0.41), (0.07, 0.06, -0.21), (count, 3))
    points[:, 2] -= 0.25 * (plan.crossings == "any")
    normals = rng.normal(size=(count, 3)) * 0.3 + [0.0, 0.0, 1.0]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    tx = rng.uniform((-0.2, -0.2, -0.001), (0.2, 0.2, 0.001), (count, 3))
    rx = tx + rng.uniform(-0.02, 0.02, (count, 3))
    ways = [
        leg(to_device_vectors(antenna - points), to_device(np.linalg.norm(antenna - points, axis=1)),
            to_device_vectors(np.zeros((count, 3))), to_device_vectors(normals))
        for antenna in (tx, rx)
    ]  # fmt: skip
    one, zero = to_device(np.ones(count)), to_device(np.zeros(count))
    amplitude, _, cosine = echo(ways[0], ways[1], one, zero, False)
    frequency = len(plan.frequencies_hz) // 2
    entry, seed = dr.full(UInt32, frequency, count), dr.opaque(Float, 0.0)
    dr.enable_grad(seed)
    response = Response(plan).along(seed, ((change, 2.0),))
    weight = response.surface(ways, cosine, to_device_vectors(normals), entry)
    weight = weight * response.path(to_device_vectors(points), ways, entry)
    dr.forward(seed)
    slope = dr.grad(weight).numpy()
    ends, step = [], 0.0
    for sign in (-0.1, 0.1):
        material, surroundings, step = changed(plan.material, plan.surroundings, change, sign)
        near = replace(plan, material=material, surroundings=surroundings)
        ends.append(pair_response(near, float(plan.frequencies_hz[frequency]), points, normals, tx, rx))
    lit = amplitude.numpy() > 0
    assert lit.sum() > 50
    expected = (2.0 * (ends[1] - ends[0]) / (2.0 * step))[lit]
    # float32 of cosines, and tables that are linear between entries, as for the values; walls turn many radians
    assert np.abs(slope[lit] - expected).max() < 1e-3 * np.abs(expected).max()

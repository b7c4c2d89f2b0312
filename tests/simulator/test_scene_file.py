"""Mitsuba scenes as input: the same targets, sheets and box as written in Python, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from waveformer.simulator import (
    Aperture,
    Box,
    Chirp,
    Material,
    Sheet,
    Target,
    load_mesh,
    primitives,
    simulate,
)
from waveformer.simulator.bsdf import register_bsdfs
from waveformer.simulator.errors import MeshError, RadarError
from waveformer.simulator.scene_file import LoadedScene, load_scene
from waveformer.simulator.scene_shapes import CURVED_EDGE_M

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

PEC = {"type": "radar_specular", "material": "pec"}
PLASTIC = '<bsdf type="radar_specular"><float name="permittivity" value="2.8123456789012"/></bsdf>'


def write(folder: Path, body: str) -> Path:
    path = folder / "scene.xml"
    path.write_text(f'<scene version="3.0.0">{body}</scene>')
    return path


def only(scene: Any) -> Target:
    loaded = load_scene(scene)
    assert len(loaded.targets) == 1
    return loaded.targets[0]


def placed(target: Target) -> np.ndarray:
    mesh = load_mesh(target.mesh)
    return np.asarray(mesh.vertices_m @ target.pose[:3, :3].T + target.pose[:3, 3])


def pose(angle_deg: float, axis: str, position_m: tuple[float, float, float]) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler(axis, angle_deg, degrees=True).as_matrix()
    matrix[:3, 3] = position_m
    return matrix


def test_three_objects_in_a_cardboard_box(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    primitives.mug(6e-3).export(tmp_path / "meshes" / "mug.ply")
    path = write(
        tmp_path,
        """
        <default name="height" value="-0.41"/>
        <integrator type="path"/>
        <emitter type="constant"/>
        <sensor type="perspective"/>
        <bsdf type="radar_specular" id="china">
            <string name="material" value="ceramic"/><float name="roughness" value="2e-5"/>
        </bsdf>
        <shape type="ply" id="mug">
            <string name="filename" value="meshes/mug.ply"/>
            <transform name="to_world"><rotate x="1" angle="30"/><translate x="0.0123456789012" z="$height"/></transform>
            <ref id="china"/>
        </shape>
        <shape type="sphere">
            <point name="center" x="0.06" y="0.05" z="-0.4"/><float name="radius" value="0.0212345678901"/>
            <bsdf type="radar_specular"><string name="material" value="pec"/></bsdf>
        </shape>
        <shape type="cube" id="shell">
            <transform name="to_world"><scale x="0.02" y="0.015" z="0.01"/><rotate z="1" angle="20"/>
                <translate x="-0.06" z="-0.42"/></transform>
            <bsdf type="radar_specular">
                <float name="permittivity" value="2.8"/><float name="loss" value="0.03"/>
                <float name="thickness" value="0.002"/><float name="frequency" value="79e9"/>
            </bsdf>
        </shape>
        <shape type="cube" id="carton">
            <transform name="to_world"><scale x="0.15" y="0.12" z="0.1"/><translate z="-0.4"/></transform>
            <bsdf type="radar_sheet"><string name="material" value="cardboard"/>
                <float name="thickness" value="0.004"/></bsdf>
        </shape>
        <shape type="rectangle" id="cloth">
            <transform name="to_world"><rotate y="1" angle="10"/><translate z="-0.2"/></transform>
            <bsdf type="radar_sheet"><float name="permittivity" value="1.4"/><float name="loss" value="0.02"/>
                <float name="thickness" value="0.001"/><boolean name="echo" value="true"/></bsdf>
        </shape>
        """,
    )
    python = LoadedScene(
        [
            Target(
                tmp_path / "meshes" / "mug.ply",
                Material.named("ceramic", roughness_m=2e-5),
                pose(30, "x", (0.0123456789012, 0, -0.41)),
            ),
            Target(
                primitives.sphere(0.0212345678901, CURVED_EDGE_M),
                Material.pec(),
                pose(0, "x", (0.06, 0.05, -0.4)),
            ),
            Target(
                primitives.box(0.04, 0.03, 0.02),
                Material.dielectric(2.8 - 0.03j, 0.002),
                pose(20, "z", (-0.06, 0, -0.42)),
            ),
        ],
        [Sheet((0, 0, -0.2), pose(10, "y", (0, 0, 0))[:3, 2], 0.001, 1.4 - 0.02j, echo=True)],
        Box((-0.15, -0.12, -0.5), (0.15, 0.12, -0.3), 0.004, "cardboard"),
    )
    assert_same(load_scene(path), python)
    radar = Chirp(77e9, 4e9, 16), Aperture.planar_grid(3, 2, 0.01)
    signal = simulate(path, *radar).h
    built = simulate(python.targets, *radar, sheets=python.sheets, box=python.box).h
    # asked 1e-6
    assert np.abs(signal - built).max() <= 1e-6 * np.abs(built).max()
    # and Mitsuba renders the same file
    import mitsuba as mi

    register_bsdfs()
    assert len(mi.load_file(str(path)).shapes()) == 5


def test_xml_and_python_give_the_same_signal(tmp_path: Path) -> None:
    primitives.mug(6e-3).export(tmp_path / "mug.ply")
    loaded = load_scene(
        write(
            tmp_path,
            f"""<shape type="ply"><string name="filename" value="mug.ply"/>
            <transform name="to_world"><rotate x="1" angle="33"/><translate x="0.0123456789012" z="-0.45"/></transform>
            {PLASTIC}</shape>
            <shape type="sphere"><float name="radius" value="0.01"/><point name="center" x="0.07" y="0.03" z="-0.4"/>
            {PLASTIC}</shape>""",
        )
    )
    plastic = Material.dielectric(2.8123456789012)
    targets = [
        Target(tmp_path / "mug.ply", plastic, pose(33, "x", (0.0123456789012, 0, -0.45))),
        Target(primitives.sphere(0.01, CURVED_EDGE_M), plastic, pose(0, "x", (0.07, 0.03, -0.4))),
    ]
    radar = Chirp(77e9, 4e9, 16), Aperture.planar_grid(3, 2, 0.01)
    one, other = simulate(loaded.targets, *radar).h, simulate(targets, *radar).h
    # asked 1e-6
    assert np.abs(one - other).max() <= 1e-6 * np.abs(other).max()


def assert_same(one: LoadedScene, other: LoadedScene) -> None:
    """Equal to a few roundings of float64: far below the 1e-6 of the echo, which is 3e-10 m of range."""
    close: dict[str, float] = {"rtol": 0.0, "atol": 1e-15}
    for left, right in zip(one.targets, other.targets, strict=True):
        assert left.material == right.material
        np.testing.assert_allclose(left.pose, right.pose, **close)
        meshes = load_mesh(left.mesh), load_mesh(right.mesh)
        np.testing.assert_array_equal(meshes[0].faces, meshes[1].faces)
        np.testing.assert_allclose(meshes[0].vertices_m, meshes[1].vertices_m, **close)
    for left, right in zip(one.sheets, other.sheets, strict=True):
        np.testing.assert_allclose([left.point_m, left.normal], [right.point_m, right.normal], **close)
        assert (left.material, left.thickness_m, left.echo) == (right.material, right.thickness_m, right.echo)
    assert one.box is not None
    assert other.box is not None
    np.testing.assert_allclose([one.box.min_m, one.box.max_m], [other.box.min_m, other.box.max_m], **close)
    assert (one.box.material, one.box.thickness_m) == (other.box.material, other.box.thickness_m)


def test_a_dictionary_says_the_same_as_xml(tmp_path: Path) -> None:
    import mitsuba as mi

    transform = mi.ScalarTransform4d().translate([0.0123456789012, 0, -0.4]).rotate([0, 1, 0], 25)
    described = {
        "type": "scene",
        "plastic": {"type": "radar_specular", "permittivity": 2.8123456789012},
        "light": {"type": "point"},
        "disc": {"type": "disk", "to_world": transform.scale(0.05), "bsdf": {"type": "ref", "id": "plastic"}},
        "tube": {
            "type": "cylinder",
            "radius": 0.01,
            "p1": [0, 0.03, 0],
            "bsdf": {"type": "ref", "id": "plastic"},
        },
        "box": {"type": "cube", "to_world": transform.scale(0.1 / 8), "bsdf": PEC},
        "carton": {
            "type": "cube",
            "to_world": mi.ScalarTransform4d().scale(0.2),
            "bsdf": {"type": "radar_sheet", "material": "cardboard", "thickness": 3e-3},
        },
    }
    turned = '<rotate y="1" angle="25"/><translate x="0.0123456789012" z="-0.4"/></transform>'
    path = write(
        tmp_path,
        f"""
        <shape type="disk"><transform name="to_world"><scale value="0.05"/>{turned}{PLASTIC}</shape>
        <shape type="cylinder"><float name="radius" value="0.01"/><point name="p1" x="0" y="0.03" z="0"/>
            {PLASTIC}</shape>
        <shape type="cube"><transform name="to_world"><scale value="0.0125"/>{turned}
            <bsdf type="radar_specular"><string name="material" value="pec"/></bsdf></shape>
        <shape type="cube"><transform name="to_world"><scale value="0.2"/></transform>
            <bsdf type="radar_sheet"><string name="material" value="cardboard"/>
                <float name="thickness" value="0.003"/></bsdf></shape>
        """,
    )
    assert_same(load_scene(described), load_scene(path))


def test_analytic_shapes_lie_where_mitsuba_puts_them() -> None:
    import mitsuba as mi

    register_bsdfs()
    turn = mi.ScalarTransform4d().translate([0.01, -0.02, -0.4]).rotate([0.6, 0, 0.8], 40)
    mirror = turn @ mi.ScalarTransform4d().scale([0.02, -0.02, 0.02])
    shapes: list[dict[str, Any]] = [
        {"type": "sphere", "center": [0.1, 0.2, -0.3], "radius": 0.7, "to_world": mirror},
        {"type": "cylinder", "p0": [0.3, 0, 1], "p1": [1, 2, 0], "radius": 0.4, "to_world": mirror},
        {"type": "disk", "to_world": mirror},
        {"type": "rectangle", "to_world": turn.scale([0.02, 0.03, 1.0])},
        {"type": "cube", "to_world": turn.scale([0.02, -0.03, 0.01])},
    ]
    for shape in shapes:
        target = only({"type": "scene", "shape": {**shape, "bsdf": PEC}})
        corners, mesh = placed(target), load_mesh(target.mesh)
        box = mi.load_dict({**shape, "to_world": mi.ScalarTransform4f(shape["to_world"].matrix)}).bbox()
        # every corner lies within the bounding box, and every facet on the surface but for its sagitta
        scene = mi.load_dict(
            {"type": "scene", "s": {**shape, "to_world": mi.ScalarTransform4f(shape["to_world"].matrix)}}
        )
        assert (corners > np.array(box.min) - 1e-5).all()
        assert (corners < np.array(box.max) + 1e-5).all()
        centers = corners[mesh.faces].mean(axis=1)
        normals = np.cross(*(corners[mesh.faces[:, i]] - corners[mesh.faces[:, 0]] for i in (1, 2)))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        ray = mi.Ray3f(
            mi.Point3f(*np.float32(centers + 2e-3 * normals).T), mi.Vector3f(*np.float32(-normals).T)
        )
        distance_m = np.array(scene.ray_intersect_preliminary(ray).t)
        assert distance_m == pytest.approx(2e-3, abs=1e-4), shape["type"]
        assert mesh.two_sided == (shape["type"] in ("cylinder", "disk", "rectangle"))


def test_curved_shapes_are_fine_enough_for_80_ghz() -> None:
    wavelength_m = 299_792_458.0 / 80e9
    for shape in (
        {"type": "sphere", "radius": 0.02},
        {"type": "cylinder", "radius": 0.02, "p1": [0, 0, 0.05]},
    ):
        mesh = only({"type": "scene", "s": {**shape, "bsdf": PEC}}).mesh
        assert mesh.edges_unique_length.max() <= 0.27 * wavelength_m  # type: ignore[union-attr]


def test_a_mesh_file_is_scaled_and_mirrored_in_float64(tmp_path: Path) -> None:
    hammer = primitives.hammer_head(6e-3)
    hammer.apply_scale(1000.0)
    hammer.export(tmp_path / "millimetres.ply")
    path = write(
        tmp_path,
        f"""<shape type="ply"><string name="filename" value="millimetres.ply"/>
        <transform name="to_world"><scale x="-0.001" y="0.001" z="0.001"/><translate z="-0.4"/></transform>{PLASTIC}
        </shape>""",
    )
    target = only(path)
    original = load_mesh(tmp_path / "millimetres.ply", unit_m=1e-3)
    np.testing.assert_allclose(
        load_mesh(target.mesh).vertices_m, original.vertices_m * [-1, 1, 1] + [0, 0, -0.4], rtol=0, atol=1e-15
    )
    np.testing.assert_array_equal(load_mesh(target.mesh).faces, original.faces[:, ::-1])
    assert not load_mesh(target.mesh).two_sided


def test_an_obj_file_has_the_faces_of_load_mesh(tmp_path: Path) -> None:
    primitives.box(0.05, 0.04, 0.03).export(tmp_path / "box.obj")
    target = only(
        write(tmp_path, f'<shape type="obj"><string name="filename" value="box.obj"/>{PLASTIC}</shape>')
    )
    np.testing.assert_array_equal(load_mesh(target.mesh).faces, load_mesh(tmp_path / "box.obj").faces)
    assert target.mesh == tmp_path / "box.obj"


def shape(**values: Any) -> dict[str, Any]:
    return {"type": "scene", "thing": {"type": "sphere", "radius": 0.02, "bsdf": PEC} | values}


def matrix(rows: Any) -> Any:
    import mitsuba as mi

    return mi.ScalarTransform4d(rows)


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (
            lambda: shape(bsdf={"type": "diffuse"}),
            "sphere 'thing': .* no BSDF 'diffuse'; known: radar_sheet, radar_spec",
        ),
        (lambda: shape(bsdf={"type": "radar_spectacular"}), "sphere 'thing': .* no BSDF 'radar_spectacular'"),
        (lambda: shape(bsdf={"type": "twosided", "b": PEC}), "sphere 'thing': .* no BSDF 'twosided'"),
        (lambda: {"type": "scene", "thing": {"type": "sphere"}}, "sphere 'thing' has no BSDF"),
        (lambda: shape(other=PEC), "sphere 'thing' has 2 BSDFs"),
        (
            lambda: shape(bsdf=PEC | {"rougness": 1e-4}),
            "radar_specular has no parameter 'rougness'; known: .*roughness",
        ),
        (
            lambda: shape(bsdf={"type": "radar_specular", "material": "gold"}),
            "unknown material 'gold'; known: .*wood",
        ),
        (lambda: shape(bsdf=PEC | {"map": {"type": "checkerboard"}}), "no nested plugins"),
        (
            lambda: shape(diameter=0.1),
            "sphere has no parameter 'diameter'; known: center, .*radius, to_world",
        ),
        (lambda: shape(type="sphre"), "Mitsuba knows no plugin 'sphre'"),
        (lambda: shape(type="sdfgrid"), "no shape 'sdfgrid'; known: cube, .*sphere"),
        (lambda: shape(radius=-1.0), "radius must be a positive number"),
        (lambda: shape(center="middle"), "center must be three finite numbers"),
        (
            lambda: shape(to_world=matrix(np.diag([1.0, 2, 1, 1]))),
            "'thing': to_world stretches a sphere unevenly",
        ),
        (
            lambda: shape(
                type="disk", to_world=matrix([[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
            ),
            "'thing'",
        ),
        (lambda: {"type": "scene", "thing": {"type": "ply", "bsdf": PEC}}, "ply needs filename"),
        (
            lambda: shape(bsdf={"type": "radar_sheet", "material": "wood", "thickness": 0.001}),
            "radar_sheet belongs on a rectangle .* not on a sphere",
        ),
        (lambda: {"type": "sphere", "radius": 0.02}, "must have the type 'scene'"),
        (lambda: {"type": "scene", "thing": {"radius": 0.02}}, "cannot be parsed: .*missing 'type'"),
        (lambda: shape(bsdf={"type": "ref", "id": "nothing"}), "cannot be parsed: .*nothing"),
        (lambda: "nowhere.xml", "nowhere.xml: no such scene file"),
    ],
)
def test_refusals(scene: Any, message: str) -> None:
    with pytest.raises(RadarError, match=message) as refusal:
        load_scene(scene())
    assert "\n" not in str(refusal.value)


def test_refusals_of_xml_and_boxes(tmp_path: Path) -> None:
    carton = '<bsdf type="radar_sheet"><string name="material" value="wood"/><float name="thickness" value="0.01"/></bsdf>'
    cube = '<shape type="cube">{}' + carton + "</shape>"
    turned = '<transform name="to_world"><rotate z="1" angle="10"/></transform>'
    for body, message in (
        ("<shape>", "cannot be parsed"),
        (
            '<shape type="sphere"><bsdf type="radar_glass"/></shape>',
            "sphere at .*scene.xml.* no BSDF 'radar_glass'",
        ),
        (cube.format("") * 2, "at most one box"),
        (cube.format(turned), "edges along the axes"),
    ):
        with pytest.raises(RadarError, match=message) as refusal:
            load_scene(write(tmp_path, body))
        assert "\n" not in str(refusal.value)
    missing = '<shape type="ply"><string name="filename" value="no.ply"/><transform name="to_world"><scale value="2"/></transform>'
    with pytest.raises(MeshError, match=r"no\.ply: no such mesh file"):
        load_scene(write(tmp_path, missing + PLASTIC + "</shape>"))

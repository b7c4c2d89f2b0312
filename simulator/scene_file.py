"""A Mitsuba scene, dictionary or XML file, as input of the coherent sum.

Mitsuba's own parser reads it, so references, default values and includes work as usual; nothing is instantiated, and
numbers stay float64. Shapes carry the plugins `radar_specular` (targets) or `radar_sheet` (an infinite sheet from
a rectangle, a closed box from a cube). Emitters, sensors, integrators and their like are ignored: a scene that is also
rendered has them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from waveformer.simulator.bsdf_parameters import PARAMETERS, SHEET, BsdfParameters, parse_bsdf
from waveformer.simulator.errors import RadarError
from waveformer.simulator.mesh_formats import one_line
from waveformer.simulator.occluders import Box, Sheet
from waveformer.simulator.runtime import activate
from waveformer.simulator.scene_shapes import Shape, axis_aligned_bounds, principal_axes, shape_target
from waveformer.simulator.target import Target


@dataclass(frozen=True, eq=False)
class LoadedScene:
    """What the radar makes of a Mitsuba scene; the arguments of `simulate`.

    Attributes:
        targets: one for every shape with radar_specular, in the order of the scene.
        sheets: one for every rectangle with radar_sheet; the rectangle lies on the face towards the radar.
        box: of the cube with radar_sheet, its outer faces; None without one.
    """

    targets: list[Target]
    sheets: list[Sheet]
    box: Box | None


def is_scene(targets: Any) -> bool:
    """Whether the targets of `simulate` are a Mitsuba scene: a dictionary, or the path of an XML file."""
    if isinstance(targets, dict):
        return True
    return isinstance(targets, (str, os.PathLike)) and Path(targets).suffix.lower() == ".xml"


def load_scene(scene: dict[str, Any] | str | os.PathLike[str]) -> LoadedScene:
    """Read a Mitsuba scene.

    Shapes: ply and obj files, sphere, cylinder (a tube, open as Mitsuba's), disk, rectangle, cube; curved ones are
    tessellated with edges of at most `scene_shapes.CURVED_EDGE_M`. Lengths are metres in the radar frame. A to_world
    in a dictionary keeps float64 if it is a mi.ScalarTransform4d; XML always does.

    Args:
        scene: a dictionary as for mi.load_dict, or the path of an XML file.

    Raises:
        RadarError: the scene cannot be parsed, a shape has no BSDF, or a shape, a BSDF or a parameter is none that
            the radar knows; the message names it and the known ones.
        MeshError: a mesh file that must be transformed cannot be read.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    nodes, folder = _parse(scene)
    targets: list[Target] = []
    sheets: list[Sheet] = []
    boxes: list[Box] = []
    for node in _shapes(nodes):
        shape, bsdf = node.shape(folder), node.bsdf()
        if bsdf.plugin != SHEET:
            targets.append(shape_target(shape, bsdf.material))
        elif shape.plugin == "rectangle":
            sheets.append(_sheet(shape, bsdf))
        elif shape.plugin == "cube":
            boxes.append(_box(shape, bsdf))
        else:
            raise RadarError(
                f"{shape.label}: {SHEET} belongs on a rectangle (a sheet) or a cube (a box), not on a {shape.plugin}"
            )
    if len(boxes) > 1:
        raise RadarError(f"a scene has at most one box (a cube with {SHEET}), this one has {len(boxes)}")
    return LoadedScene(targets, sheets, boxes[0] if boxes else None)


def _parse(scene: dict[str, Any] | str | os.PathLike[str]) -> tuple[list[_Node], Path]:
    """Nodes of a scene, the root first, and the folder of its files."""
    activate()
    import mitsuba as mi
    from mitsuba import parser

    config = parser.ParserConfig(mi.variant())
    path = None if isinstance(scene, dict) else Path(scene)
    if path is not None and not path.is_file():
        raise RadarError(f"{one_line(path)}: no such scene file; check the path")
    try:
        state = parser.parse_dict(config, scene) if path is None else parser.parse_file(config, str(path))
        parser.transform_upgrade(config, state)
        parser.transform_resolve(config, state)
    except RuntimeError as error:
        raise RadarError(f"the scene cannot be parsed: {one_line(error)}") from error
    nodes: list[_Node] = []
    nodes += [_Node(node, parser.file_location(state, node), nodes) for node in state.nodes]
    if nodes[0].kind != "Scene":
        raise RadarError(f"a scene must have the type 'scene', this one is a {nodes[0].plugin!r}")
    return nodes, Path() if path is None else path.parent


class _Node:
    """A plugin of the scene as Mitsuba parsed it."""

    def __init__(self, node: Any, location: str, nodes: list[_Node]) -> None:
        properties = node.props
        self.kind = node.type.name
        self.plugin = properties.plugin_name()
        name = properties.id()
        self.label = f"{self.plugin} {name!r}" if name else f"{self.plugin} at {one_line(location)}"
        self._nodes = nodes
        self._references: list[int] = []
        self.values: dict[str, Any] = {}
        for key in properties.keys():  # noqa: SIM118 - not a mapping
            if properties.type(key).name == "ResolvedReference":
                self._references.append(properties[key].index())
            else:
                self.values[key] = properties[key]

    @property
    def children(self) -> list[_Node]:
        return [self._nodes[index] for index in self._references]

    def shape(self, folder: Path) -> Shape:
        values = dict(self.values)
        transform = values.pop("to_world", None)
        try:
            to_world = np.eye(4) if transform is None else np.array(transform.matrix, dtype=np.float64)
        except (AttributeError, TypeError, ValueError):
            to_world = np.empty(0)
        if to_world.shape != (4, 4) or not np.isfinite(to_world).all():
            raise RadarError(f"{self.label}: to_world must be a finite transform")
        return Shape(self.label, self.plugin, values, to_world, folder)

    def bsdf(self) -> BsdfParameters:
        found = [child for child in self.children if child.kind not in ("Emitter", "Sensor")]
        known = ", ".join(sorted(PARAMETERS))
        if not found:
            raise RadarError(
                f"{self.label} has no BSDF; give it one of {known}, as a nested plugin or a reference"
            )
        for child in found:
            if child.plugin not in PARAMETERS:
                raise RadarError(f"{self.label}: the radar knows no BSDF {child.plugin!r}; known: {known}")
        if len(found) > 1:
            raise RadarError(f"{self.label} has {len(found)} BSDFs; leave one")
        if found[0].children:
            raise RadarError(f"{self.label}: {found[0].plugin} takes numbers and names, no nested plugins")
        return parse_bsdf(found[0].plugin, found[0].values)


def _shapes(nodes: list[_Node]) -> Iterator[_Node]:
    for node in nodes[0].children:
        if node.kind == "Shape":
            yield node
        elif node.kind == "Unknown" and node.plugin not in PARAMETERS:
            raise RadarError(f"{node.label}: Mitsuba knows no plugin {node.plugin!r}")


def _sheet(shape: Shape, bsdf: BsdfParameters) -> Sheet:
    rotation, _ = principal_axes(shape)
    assert bsdf.thickness_m is not None
    return Sheet(shape.position_m, rotation[:, 2], bsdf.thickness_m, bsdf.permittivity, bsdf.echo)


def _box(shape: Shape, bsdf: BsdfParameters) -> Box:
    low, high = axis_aligned_bounds(shape)
    assert bsdf.thickness_m is not None
    return Box(low, high, bsdf.thickness_m, bsdf.permittivity)

"""The matter of the radar as Mitsuba BSDFs: `radar_specular` reflects, `radar_sheet` also lets through.

Both ask `reflection` what a surface sends back, as the coherent sum does. Classes that inherit from Mitsuba's exist
only once a variant is chosen, so they are made inside functions.
"""

from __future__ import annotations

from functools import cache, reduce
from operator import or_
from typing import Any

import drjit as dr

from waveformer.simulator.bsdf_lobe import MirrorLobe
from waveformer.simulator.bsdf_parameters import SHEET, SPECULAR, parse_bsdf
from waveformer.simulator.runtime import activate


def register_bsdfs() -> None:
    """Make `radar_specular` and `radar_sheet` known to Mitsuba; calling it again does nothing.

    Parameters of the plugins: `bsdf_parameters.BsdfParameters`. Both sides of a surface are alike, as for the open
    meshes of the coherent sum. What a radar_specular surface does not reflect it absorbs.

    Raises:
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    activate()
    _register()


@cache
def _register() -> None:
    import mitsuba as mi

    mi.register_bsdf(SPECULAR, _specular_class())
    mi.register_bsdf(SHEET, _sheet_class())


def property_values(properties: Any) -> dict[str, Any]:
    """Names and values of a mi.Properties."""
    return {name: properties[name] for name in properties.keys()}  # noqa: SIM118 - not a mapping


@cache
def _base_class() -> Any:
    import mitsuba as mi

    class RadarBsdf(mi.BSDF):  # type: ignore[misc]
        """A lobe around the mirror direction, from both sides; subclasses name their plugin."""

        plugin: str
        lets_through = False

        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            self.parameters = parse_bsdf(self.plugin, property_values(properties))
            self.lobe = MirrorLobe(self.parameters)
            both_sides = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
            self.m_components = [mi.BSDFFlags.GlossyReflection | both_sides]
            if self.lets_through:
                self.m_components.append(mi.BSDFFlags.Null | both_sides)
            self.m_flags = reduce(or_, self.m_components)

        def sample(
            self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True
        ) -> tuple[Any, Any]:
            """A direction with its density, and BRDF times cosine over the density."""
            sample = dr.zeros(mi.BSDFSample3f)
            side = _upper_side(si)
            sample.wo = side * self.lobe.sample(side * si.wi, sample1, sample2)
            sample.eta = 1.0
            sample.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
            value, sample.pdf = self.eval_lobe(ctx, si, sample.wo, active)
            return sample, dr.select(sample.pdf > 0.0, value / sample.pdf, 0.0)

        def eval_lobe(self, ctx: Any, si: Any, wo: Any, active: Any) -> tuple[Any, Any]:
            """BRDF times cosine and density of the lobe, zero unless both directions lie on one side."""
            if not self.reflects(ctx):
                return mi.Color3f(0.0), mi.Float(0.0)
            side = _upper_side(si)
            wi, wo = side * si.wi, side * wo
            active = active & (wi.z > 0.0) & (wo.z > 0.0)
            value, density = self.lobe.eval(wi, wo), self.lobe.pdf(wi, wo)
            return mi.Color3f(dr.select(active, value, 0.0)), dr.select(active, density, 0.0)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
            """BRDF times cosine, and the density of `sample` per solid angle."""
            return self.eval_lobe(ctx, si, wo, active)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            """BRDF times cosine."""
            return self.eval_pdf(ctx, si, wo, active)[0]

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            """Density of `sample` per solid angle."""
            return self.eval_pdf(ctx, si, wo, active)[1]

        def reflects(self, ctx: Any) -> bool:
            """Whether the surface reflects and the caller wants to know."""
            return self.parameters.echo and bool(ctx.is_enabled(mi.BSDFFlags.GlossyReflection, 0))

        def to_string(self) -> str:
            """Plugin and material."""
            return f"{self.plugin}[material = {self.parameters.material.name}]"

    return RadarBsdf


def _specular_class() -> Any:
    class RadarSpecular(_base_class()):  # type: ignore[misc]
        """A surface that reflects."""

        plugin = SPECULAR

    return RadarSpecular


def _sheet_class() -> Any:
    import mitsuba as mi

    class RadarSheet(_base_class()):  # type: ignore[misc]
        """A thin wall: it lets power straight through, and reflects if its echo is asked for."""

        plugin = SHEET
        lets_through = True

        def sample(
            self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True
        ) -> tuple[Any, Any]:
            """The way straight on, or a direction of the lobe."""
            sample, weight = super().sample(ctx, si, sample1, sample2, active)
            through, chance = self._through(ctx, si)
            passes = active & (sample1 < chance)
            sample.wo = dr.select(passes, -si.wi, sample.wo)
            sample.pdf = dr.select(passes, chance, sample.pdf * (1.0 - chance))
            sample.sampled_component = dr.select(passes, mi.UInt32(1), 0)
            sample.sampled_type = dr.select(passes, mi.UInt32(+mi.BSDFFlags.Null), sample.sampled_type)
            reflected = dr.select(chance < 1.0, weight / (1.0 - chance), 0.0)
            return sample, dr.select(passes, mi.Color3f(through / chance), reflected)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
            """BRDF times cosine and density of the reflected part; what passes straight on has none."""
            value, density = self.eval_lobe(ctx, si, wo, active)
            return value, density * (1.0 - self._through(ctx, si)[1])

        def eval_null_transmission(self, si: Any, active: Any = True) -> Any:
            """Power let straight through."""
            return mi.Color3f(dr.select(active, self.lobe.transmittance(dr.abs(si.wi.z)), 0.0))

        def _through(self, ctx: Any, si: Any) -> tuple[Any, Any]:
            """Power let through, and the chance with which `sample` lets through."""
            cosine = dr.abs(si.wi.z)
            through = self.lobe.transmittance(cosine)
            if not ctx.is_enabled(mi.BSDFFlags.Null, 1):
                return through, dr.zeros(mi.Float, dr.width(through))
            if not self.reflects(ctx):
                return through, dr.full(mi.Float, 1.0, dr.width(through))
            return through, through / (through + self.lobe.reflectance(cosine))

    return RadarSheet


def _upper_side(si: Any) -> Any:
    """-1 where the surface is met from below: both sides are alike."""
    return dr.select(si.wi.z < 0.0, -1.0, 1.0)

"""The numerical settings of the forward model: one frozen object, two named choices."""

from __future__ import annotations

import math

from pydantic import BaseModel, ConfigDict, Field

from waveformer.simulator.errors import RadarError

# Mean area of a well-shaped piece over its longest edge squared: 0.7 of an equilateral triangle's.
_PIECE_AREA = 0.3
_LONGEST_GROWN_WAVELENGTHS = 0.5


class Numerics(BaseModel):
    """How finely and by which kernel the surface integral is summed.

    Attributes:
        spacing_wavelengths: longest edge of a surface piece, in wavelengths at the centre frequency.
        most_samples: pieces grow, up to half a wavelength, where a target would have more of them; None lets
            no piece grow.
        facet_wavelengths: longest edge of the rectangles into which flat box walls are cut.
        facet_taper: weigh every piece with the form factor of its own size, exp(-x/2) with
            x = (2 k sin theta)^2 times its variance: a centroid alone over-counts a piece that the
            phase crosses obliquely. It cuts the quadrature error two- to threefold at the same count.
        direct: sum every pair of sample and antenna exactly, with ray-traced visibility per antenna
            position; otherwise the factorised kernel with visibility per sub-aperture.
        cell_wavelengths: edge of the cells of samples that the factorised kernel sums as one.
        bin_wavelengths: width of its range bins.
        tolerance: bound on the relative error of every interpolation in the factorised kernel.
        interpolate_shadows: evaluate cells that a tile sees in part at its nodes too, each sample weighted by what
            the node sees of it; otherwise such samples are summed pair by pair. The edge of a shadow that crosses a
            cell changes its moments smoothly, though not within `tolerance`.
        probe_spacing_deg: angle between neighbouring sub-apertures of the first visibility pass, seen
            from the object.
        leaf_spacing_deg: the same where the first pass saw visibility change.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    spacing_wavelengths: float = Field(default=1.0 / 3.0, gt=0.0, le=0.75)
    most_samples: int | None = Field(default=None, gt=0)
    facet_wavelengths: float = Field(default=0.8, gt=0.0, le=1.5)
    facet_taper: bool = True
    direct: bool = False
    cell_wavelengths: float = Field(default=2.0, gt=0.0, le=4.0)
    bin_wavelengths: float = Field(default=1.0, gt=0.0, le=2.0)
    tolerance: float = Field(default=1e-3, gt=0.0, lt=0.1)
    interpolate_shadows: bool = False
    probe_spacing_deg: float = Field(default=5.0, gt=0.0)
    leaf_spacing_deg: float = Field(default=1.0, gt=0.0)

    def spacing_m(self, area_m2: float, wavelength_m: float) -> float:
        """Longest edge of the pieces of a target.

        Args:
            area_m2: of the faces to be cut.
            wavelength_m: at the centre frequency.
        """
        shortest_m = self.spacing_wavelengths * wavelength_m
        if self.most_samples is None:
            return shortest_m
        grown_m = math.sqrt(area_m2 / (_PIECE_AREA * self.most_samples))
        return min(max(shortest_m, grown_m), max(shortest_m, _LONGEST_GROWN_WAVELENGTHS * wavelength_m))


FAST = Numerics()
EXACT = Numerics(spacing_wavelengths=0.25, facet_wavelengths=0.5, direct=True, tolerance=1e-5)
# For datasets: interpolations to 4 %, edges of shadows interpolated too, shadows from coarser sub-apertures, and larger
# pieces of large objects, whose glints are strong. It differs from FAST by less than FAST from the limit of small pieces.
DRAFT = Numerics(
    cell_wavelengths=1.5,
    tolerance=4e-2,
    interpolate_shadows=True,
    probe_spacing_deg=8.0,
    leaf_spacing_deg=3.0,
    most_samples=100_000,
)
# Where derivatives are taken: four moments of range carry smaller cells and bins thirty times more exactly. Shadows are
# found once for many evaluations; a first look every 5 degrees leaves 1 % of level where few antennas look into a mug.
DIFFERENTIABLE = Numerics(cell_wavelengths=0.8, bin_wavelengths=0.5, tolerance=1e-4, probe_spacing_deg=2.5)
# The same where walls or an antenna's pattern are on the way: what they do is taken as exponential over a cell.
DIFFERENTIABLE_THROUGH_WALLS = DIFFERENTIABLE.model_copy(update={"cell_wavelengths": 0.6})
NUMERICS_BY_MODE = {"fast": FAST, "exact": EXACT, "draft": DRAFT}


def resolve_numerics(mode: str | Numerics) -> Numerics:
    """The settings of a named mode; a Numerics passes through."""
    if isinstance(mode, Numerics):
        return mode
    if mode not in NUMERICS_BY_MODE:
        raise RadarError(f"unknown mode {mode!r}; known: {', '.join(NUMERICS_BY_MODE)}")
    return NUMERICS_BY_MODE[mode]

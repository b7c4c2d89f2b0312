import numpy as np
import pytest

from waveformer.model.threshold import EXPONENTS, Background, li_threshold, specular_mask
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid


def slow_li(values):
    """Li & Tam by the book: start at the mean, split the values themselves, log mean of the class means."""
    shifted = np.asarray(values, dtype=np.float64) - np.min(values)
    threshold, previous = shifted.mean(), np.inf
    while abs(threshold - previous) > 1e-15:
        previous = threshold
        above, below = shifted[shifted > threshold].mean(), shifted[shifted <= threshold].mean()
        threshold = (below - above) / (np.log(below) - np.log(above))
    return threshold + np.min(values)


def cross_entropy(values, threshold):
    """What Li's threshold minimises, for values counted from the least one."""
    shifted = values - values.min()
    below, above = shifted[values <= threshold], shifted[values > threshold]
    return -(below.sum() * np.log(below.mean()) + above.sum() * np.log(above.mean()))


def two_classes(rng, count=4000):
    return np.concatenate([rng.rayleigh(0.02, count), rng.normal(0.8, 0.05, count // 10)])


def test_agrees_with_the_slow_threshold(rng):
    values = two_classes(rng)
    assert li_threshold(values) == pytest.approx(slow_li(values), rel=1e-12)
    assert values.max() > li_threshold(values) > 0.1


def test_minimises_cross_entropy(rng):
    values = two_classes(rng)
    tried = np.linspace(values.min() + 1e-3, values.max() - 1e-3, 500)
    best = min(cross_entropy(values, threshold) for threshold in tried)
    # The grid of tried thresholds may miss the minimum; it cannot lie below it.
    assert cross_entropy(values, li_threshold(values)) <= best + 1e-9 * abs(best)


def test_scales_and_shifts_with_the_values(rng):
    values = two_classes(rng)
    assert li_threshold(7 * values + 3) == pytest.approx(7 * li_threshold(values) + 3, rel=1e-12)


def test_a_weight_is_a_repetition(rng):
    values, counts = two_classes(rng, 400), rng.integers(0, 5, 440)
    assert li_threshold(values, counts) == pytest.approx(slow_li(np.repeat(values, counts)), rel=1e-12)


@pytest.mark.parametrize("values", [[2.0], [0.0, 0.0, 0.0], [3.0, 3.0]])
def test_equal_values_are_their_own_threshold(values):
    assert li_threshold(values) == values[0]


def test_one_bright_value_among_zeros():
    threshold = li_threshold([0.0] * 99 + [5.0])
    assert 0 <= threshold < 5


@pytest.mark.parametrize(
    ("values", "weights"), [([], None), ([1.0, np.nan], None), ([1.0], [-1.0]), ([1.0], [0.0])]
)
def test_refuses(values, weights):
    with pytest.raises(RadarError):
        li_threshold(values, weights)


def small_grid(count=20, spacing_m=0.003):
    side = np.arange(count) * spacing_m
    return Grid(side, side, side - 0.4)


def speckle_with_a_blob(rng, grid, blob=slice(8, 12), noise=0.01):
    image = noise * (rng.normal(size=grid.shape) + 1j * rng.normal(size=grid.shape))
    image[blob, blob, blob] += np.exp(1j)
    return image.astype(np.complex64)


def test_mask_is_the_blob(rng):
    grid = small_grid()
    found = specular_mask(speckle_with_a_blob(rng, grid), grid)
    expected = np.zeros(grid.shape, dtype=bool)
    expected[8:12, 8:12, 8:12] = True
    np.testing.assert_array_equal(found.mask, expected)
    assert found.exponent == 2.0 and found.reason == ""
    assert 0.05 < found.threshold_of_magnitude < 1


def test_background_samples_stand_for_the_volume_they_replace(rng):
    """A crop with weighted samples of the rest has the threshold of the whole volume."""
    grid = small_grid(30)
    whole = speckle_with_a_blob(rng, grid, noise=0.1)
    crop = (slice(4, 16),) * 3
    outside = np.ones(grid.shape, dtype=bool)
    outside[crop] = False
    repeated = np.repeat(np.abs(whole)[outside].reshape(-1), 2)
    background = Background(repeated, np.full(len(repeated), 0.5))
    cropped = Grid(grid.x[4:16], grid.y[4:16], grid.z[4:16])
    full = specular_mask(whole, grid)
    part = specular_mask(whole[crop], cropped, background)
    assert part.threshold_of_magnitude == pytest.approx(full.threshold_of_magnitude, rel=1e-6)
    np.testing.assert_array_equal(part.mask, full.mask[crop])
    alone = specular_mask(whole[crop], cropped)
    assert alone.threshold_of_magnitude != pytest.approx(full.threshold_of_magnitude, rel=1e-2)


def flooded(rng, corner):
    """A bright block, weak speckle, and eight voxels of a given magnitude in the corners of 0.059 m^3."""
    grid = small_grid(40, 0.01)
    image = rng.uniform(0.0, 0.02, grid.shape)
    image[10:20, 10:20, 10:20] = 1.0
    image[::39, ::39, ::39] = corner
    return image, grid


@pytest.mark.parametrize(("corner", "exponent"), [(0.05, 2.0), (0.36, 2.5), (0.45, 3.5), (0.48, 4.0)])
def test_a_flood_is_met_with_the_first_exponent_that_ends_it(rng, corner, exponent):
    image, grid = flooded(rng, corner)
    tried = [power for power in EXPONENTS if slow_li(image**power) > corner**power]
    assert tried[0] == exponent, "the case is not the one meant"
    found = specular_mask(image.astype(np.complex64), grid)
    assert found.exponent == exponent and found.reason == ""
    assert found.threshold_of_magnitude == pytest.approx(slow_li(image**exponent) ** (1 / exponent), rel=1e-5)
    assert np.argwhere(found.mask).min() == 10


def test_a_flood_that_no_exponent_ends_is_reported(rng):
    image, grid = flooded(rng, 0.8)
    found = specular_mask(image.astype(np.complex64), grid)
    assert found.exponent == 4.0 and "more than 0.03 m^3" in found.reason
    assert found.mask[0, 0, 0] and found.mask[15, 15, 15]


def test_what_reflects_far_from_the_crop_raises_the_threshold_no_further():
    grid = small_grid(10)
    image = np.zeros(grid.shape, dtype=np.complex64)
    image[4:6, 4:6, 4:6] = 1
    background = Background(np.append(np.full(8, 1.0), 0.001), np.append(np.full(8, 10.0), 1e4))
    found = specular_mask(image, grid, background)
    assert found.exponent == 2.0 and found.reason == ""


def test_no_voxel_below_five_percent(rng):
    grid = small_grid()
    image = np.full(grid.shape, 1e-9, dtype=np.complex64)
    image[:10] = 0.02
    image[5, 5, 5] = 1
    found = specular_mask(image, grid)
    assert found.threshold_of_magnitude >= 0.05
    assert found.mask.sum() == 1


@pytest.mark.parametrize("scale", [1e-15, 1e12])
def test_scale_of_the_image_does_not_matter(scale, rng):
    grid = small_grid()
    image = speckle_with_a_blob(rng, grid)
    plain, scaled = specular_mask(image, grid), specular_mask(scale * image, grid)
    np.testing.assert_array_equal(plain.mask, scaled.mask)
    assert scaled.threshold_of_magnitude == pytest.approx(scale * plain.threshold_of_magnitude, rel=1e-5)


def test_an_empty_image_gives_an_empty_mask_and_says_why():
    grid = small_grid(4)
    found = specular_mask(np.zeros(grid.shape, dtype=np.complex64), grid)
    assert not found.mask.any() and "zero everywhere" in found.reason


def test_a_crop_that_misses_the_object_says_so():
    grid = small_grid(4)
    image = np.full(grid.shape, 0.001, dtype=np.complex64)
    found = specular_mask(image, grid, Background(np.ones(5), np.ones(5)))
    assert not found.mask.any() and "outside it" in found.reason


@pytest.mark.parametrize("shape", [(1, 1, 1), (5, 1, 1), (1, 6, 4)])
def test_flat_and_constant_images_do_not_crash(shape):
    grid = Grid(*(np.arange(count) * 0.5 for count in shape))
    assert specular_mask(np.ones(shape, dtype=np.complex64), grid).mask.all()


def test_refuses_bad_images():
    grid = small_grid(4)
    image = np.ones(grid.shape, dtype=np.complex64)
    with pytest.raises(RadarError, match="does not fit"):
        specular_mask(image[:3], grid)
    image[0, 0, 0] = np.nan
    with pytest.raises(RadarError, match="1 non-finite voxels"):
        specular_mask(image, grid)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0, 2.0], [1.0]), "shape"),
        (([np.inf], [1.0]), "magnitude must be finite"),
        (([1.0], [-1.0]), "weight must be finite and not negative"),
    ],
)
def test_background_is_validated(arguments, message):
    with pytest.raises(RadarError, match=message):
        Background(*arguments)

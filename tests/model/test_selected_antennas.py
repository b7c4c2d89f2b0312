"""Which antennas take part, on profiles made by hand."""

from __future__ import annotations

import numpy as np

from waveformer.model.selected_antennas import choose_antennas


def profiles(peaks: np.ndarray, position: int = 2) -> np.ndarray:
    magnitude = np.full((len(peaks), 5), 0.1) * peaks[:, None]
    magnitude[:, position] = peaks
    return magnitude


def test_only_strong_peaky_antennas_away_from_the_ends(rng: np.random.Generator) -> None:
    good, weak = profiles(np.full(30, 0.8)), profiles(np.full(5, 0.4))
    first, last = profiles(np.full(5, 1.0), 0), profiles(np.full(5, 1.0), 4)
    flat = profiles(np.full(5, 1.0)) * 0 + [0.9, 0.9, 1.0, 0.9, 0.9]
    choice = choose_antennas(np.concatenate([weak, first, good, last, flat]), 100, rng)
    assert choice.rows.tolist() == list(range(10, 40))
    assert choice.note == ""


def test_the_draw_is_random_sorted_and_repeatable() -> None:
    magnitude = profiles(np.ones(1000))
    draws = [choose_antennas(magnitude, 50, np.random.default_rng(seed)).rows for seed in (0, 0, 1)]
    assert len(np.unique(draws[0])) == 50
    assert (np.diff(draws[0]) > 0).all()
    assert (draws[0] == draws[1]).all()
    assert (draws[0] != draws[2]).any()


def test_the_threshold_falls_until_twenty_are_left(rng: np.random.Generator) -> None:
    peaks = np.concatenate([np.full(19, 1.0), np.full(10, 0.2), np.full(10, 0.07)])
    choice = choose_antennas(profiles(peaks), 100, rng)
    assert choice.rows.tolist() == list(range(29))
    assert choice.note == "29 antennas passed only at 0.1 of the peak"
    few = choose_antennas(profiles(peaks[-12:]), 100, rng)
    assert len(few.rows) == 12  # fewer than 20 even at the last threshold


def test_without_a_clear_echo_the_strongest_are_taken(rng: np.random.Generator) -> None:
    choice = choose_antennas(profiles(np.array([0.0, 3.0, 1.0, 2.0]), 0), 2, rng)
    assert choice.rows.tolist() == [1, 3]
    assert choice.note.startswith("no antenna has a clear echo inside the window")
    assert choose_antennas(profiles(np.array([0.0, 3.0]), 0), 2, rng).rows.tolist() == [1]


def test_no_signal_no_antenna(rng: np.random.Generator) -> None:
    choice = choose_antennas(np.zeros((9, 4)), 5, rng)
    assert len(choice.rows) == 0
    assert "zero" in choice.note

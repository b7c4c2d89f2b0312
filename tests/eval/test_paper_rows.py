"""The paper's figures agree among themselves."""

import numpy as np
import pytest

from waveformer.eval.paper_rows import PAPER_ROWS

BY_NAME = {(row.method, row.condition): row for row in PAPER_ROWS}


def test_every_row_names_its_source_once():
    assert len(BY_NAME) == len(PAPER_ROWS)
    assert all(".md" in row.source for row in PAPER_ROWS)


@pytest.mark.parametrize("method", ["Backprojection", "mmNorm"])
def test_overall_is_the_mean_of_the_size_rows(method):
    row = BY_NAME[method, "all"]
    # Rounding of the three figures and of their mean, and of the comparison.
    assert row.chamfer == pytest.approx(np.mean(row.chamfer_by_size), abs=0.001 + 1e-9)


def test_overall_is_the_mean_of_the_conditions():
    conditions = [BY_NAME["mmNorm", condition].chamfer for condition in ("los", "occluded")]
    assert BY_NAME["mmNorm", "all"].chamfer == pytest.approx(np.mean(conditions), abs=0.001 + 1e-9)


def test_classes_are_monotone():
    for row in PAPER_ROWS:
        for values in (row.chamfer_by_size, row.chamfer_by_coverage):
            assert values is None or list(values) == sorted(values)

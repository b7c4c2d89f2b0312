"""The validation suite: its bookkeeping on made-up results, and the suite itself."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from waveformer.cli import app
from waveformer.simulator import (
    forward,
    validation,
    validation_box,
    validation_flat,
    validation_matter,
    validation_radar,
    validation_sheet,
)
from waveformer.simulator.closed_forms import point_scatterer
from waveformer.simulator.errors import RadarError
from waveformer.simulator.materials import Material
from waveformer.simulator.validation import CheckResult, run_validation
from waveformer.simulator.validation_curved import cylinder_physical_optics
from waveformer.simulator.validation_report import (
    HEADINGS,
    markdown_table,
    plot_validation,
    summary,
    table_rows,
    to_json,
)
from waveformer.simulator.validation_result import MITO_BAND, Trial
from waveformer.simulator.validation_signal import range_peak_m


def result(measured=0.1, tolerance=0.25, **detail):
    return CheckResult(
        "a body", "worst error", measured, tolerance, "dB", "a book", "a reason", "fast", 0.5, detail
    )


def curves():
    """One made-up result per panel of the figure."""
    x, level = np.linspace(0.0, 0.1, 5), np.linspace(-3.0, 0.0, 5)
    compared = {"x": x, "measured_db": level, "reference_x": x, "reference_db": level}
    return [
        result(
            kind="sphere", radius_m=0.05, frequency_hz=7.7e10 + x, level_db_low=level, level_db_high=level + 1
        ),
        result(kind="disc", radius_m=0.03, x=x, measured_ratio=level, reference_x=x, reference_ratio=level),
        result(kind="pattern", **compared),
        result(kind="cylinder", closed_form_db=-1.0, **compared),
        result(kind="edge", **compared),
    ]


@pytest.mark.parametrize(
    ("measured", "passed"), [(0.0, True), (0.25, True), (0.2501, False), (np.inf, False), (np.nan, False)]
)
def test_what_passes(measured, passed):
    assert result(measured).passed is passed


def test_table_holds_every_column():
    rows = table_rows([result(), result(0.3)])
    assert [len(row) for row in rows] == [len(HEADINGS)] * 2
    assert rows[0] == ("a body", "fast", "worst error", "0.1 dB", "0.25 dB", "pass", "a book", "a reason")
    assert rows[1][5] == "FAIL"
    lines = markdown_table([result(), result(0.3)]).splitlines()
    assert len(lines) == 4 and all(line.count("|") == len(HEADINGS) + 1 for line in lines)


def test_summary_counts_failures():
    assert summary([result(), result()]) == "2 checks, all passed, 1 s"
    assert summary([result(), result(1.0)]) == "2 checks, 1 FAILED, 1 s"


def test_json_is_complete_and_strict():
    report = to_json([*curves(), result(np.nan)], quick=True, modes=["fast"], seed=7)
    again = json.loads(json.dumps(report, allow_nan=False))
    assert again["schema"] == 1 and again["settings"] == {"quick": True, "modes": ["fast"], "seed": 7}
    assert again["passed"] is False and again["num_failed"] == 1
    assert {"python", "numpy", "mitsuba", "drjit"} <= set(again["environment"])
    assert again["results"][-1]["measured"] is None
    assert again["results"][0]["detail"]["level_db_low"] == pytest.approx([-3.0, -2.25, -1.5, -0.75, 0.0])


@pytest.mark.parametrize("results", [curves(), [result()], [result(np.nan), result(1.0)]])
def test_figure_is_written_whatever_is_missing(tmp_path, results):
    path = plot_validation(results, tmp_path / "validation.png")
    assert path.read_bytes().startswith(b"\x89PNG")


@pytest.fixture
def planted(monkeypatch):
    """Replaces the suite by given results and records how it was asked for."""

    def plant(*results):
        asked = {}
        monkeypatch.setattr(validation, "run_validation", lambda **how: asked.update(how) or list(results))
        return asked

    return plant


def test_command_passes(planted, tmp_path):
    asked = planted(*curves())
    outcome = CliRunner().invoke(
        app, ["validate", "--quick", "--mode", "fast", "--seed", "3", "--out", str(tmp_path / "new")]
    )
    assert outcome.exit_code == 0, outcome.output
    assert asked["quick"] is True and asked["modes"] == ("fast",) and asked["seed"] == 3
    assert {p.name for p in (tmp_path / "new").iterdir()} == {
        "validation.json",
        "validation.md",
        "validation.png",
    }
    assert "all passed" in outcome.stdout and "a reason" in outcome.stdout and "a book" in outcome.stdout


def test_command_fails_on_one_failure(planted):
    asked = planted(result(), result(0.3))
    outcome = CliRunner().invoke(app, ["validate"])
    assert outcome.exit_code == 1
    assert asked["modes"] == ("fast", "exact") and asked["quick"] is False
    assert "FAIL" in outcome.stdout and "1 FAILED" in outcome.stdout


def test_command_prints_nothing_but_json(planted):
    planted(result(0.3))
    outcome = CliRunner().invoke(app, ["validate", "--json"])
    assert outcome.exit_code == 1
    assert json.loads(outcome.stdout)["results"][0]["name"] == "a body"


def test_terminal_table(planted, capsys):
    from waveformer.cli.validate import _print_table

    _print_table([result(), result(0.3)])
    assert "FAIL" in capsys.readouterr().out


@pytest.mark.parametrize("modes", [(), ("slow",)])
def test_unknown_modes_are_refused(modes):
    with pytest.raises(RadarError, match="modes"):
        run_validation(quick=True, modes=modes)


@pytest.mark.parametrize("range_m", [0.2, 0.3456, 1.7])
def test_range_peak_finds_a_point(range_m):
    h = point_scatterer(0.01, range_m, range_m, MITO_BAND.frequencies_hz)
    assert abs(range_peak_m(h, MITO_BAND) - range_m) < 1e-5


def test_cylinder_reference_is_converged():
    positions = np.array([[0.4, 0.0, 0.0], [0.35, 0.1, 0.03], [-0.2, 0.3, -0.06]])
    coarse = cylinder_physical_optics(0.03, 0.1, positions, MITO_BAND.frequencies_hz[:3])
    fine = cylinder_physical_optics(0.03, 0.1, positions, MITO_BAND.frequencies_hz[:3], density=3)
    np.testing.assert_allclose(coarse, fine, rtol=1e-9)


@pytest.mark.parametrize("check", [validation_flat.plate_far_field, validation_flat.plate_edge_scan])
@pytest.mark.parametrize("fault", [1.03, np.exp(0.03j), "conjugate"])
def test_checks_notice_a_wrong_simulator(monkeypatch, mitsuba_variant, check, fault):
    right = forward.simulate

    def wrong(*args, **how):
        h = right(*args, **how).h
        return SimpleNamespace(h=h.conj() if fault == "conjugate" else h * fault)

    monkeypatch.setattr(forward, "simulate", wrong)
    assert not all(found.passed for found in check(Trial("fast", quick=True, seed=0)))


@pytest.mark.parametrize(
    ("check", "seen"),
    [
        (validation_matter.lossy_sphere, "material"),
        (validation_matter.thin_wall, "material"),
        (validation_matter.named_materials, "material"),
        (validation_matter.oblique_reflection, "material"),
        (validation_matter.rough_surface, "material"),
        (validation_sheet.sheet_transmission, "sheets"),
        (validation_sheet.sheet_under_aperture, "sheets"),
        (validation_sheet.sheet_own_echo, "sheets"),
        (validation_box.box_of_nothing, "box"),
        (validation_box.sphere_in_box, "box"),
        (validation_box.box_walls, "box"),
        (validation_radar.antenna_pattern, "antenna"),
        (validation_radar.iq_image, "front_end"),
    ],
)
def test_checks_notice_wrong_matter(monkeypatch, mitsuba_variant, check, seen):
    """Half a decibel too much wherever there is matter, a sheet, a box, a pattern; an image in I and Q."""
    right = forward.simulate

    def wrong(target, *args, **how):
        measured = right(target, *args, **how)
        applies = seen in how or (seen == "material" and target.material != Material.pec())
        h = measured.h * 1.06 + (0.01 * measured.h.conj() if seen == "front_end" else 0)
        return SimpleNamespace(h=h) if applies else measured

    monkeypatch.setattr(forward, "simulate", wrong)
    assert not all(found.passed for found in check(Trial("fast", quick=True, seed=0)))


def test_quick_validation_passes():
    lines = []
    results = run_validation(quick=True, modes=("fast",), progress=lines.append)
    assert not [f"{r.name}: {r.quantity} = {r.measured:.3g} {r.unit}" for r in results if not r.passed]
    assert len(results) >= 42 and len(lines) >= 30
    assert sum(r.seconds for r in results) < 120  # both modes take 40 s at most on two idle cores

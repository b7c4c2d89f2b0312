"""Configuration: what is refused, and whether the message is enough to repair it."""

from __future__ import annotations

from pathlib import Path

import pytest

from waveformer.config import Config, ConfigError, load_config


class Radar(Config):
    start_hz: float
    num_samples: int = 256


class Scene(Config):
    radar: Radar
    mesh: Path
    extent_m: tuple[float, float] = (0.1, 0.1)
    parts: tuple[Radar, ...] = ()
    preview: bool = True


GOOD = 'mesh = "cup.ply"\nextent_m = [0.2, 0.3]\n[radar]\nstart_hz = 77e9\n'


@pytest.fixture
def write(tmp_path):
    def _write(text: str) -> Path:
        path = tmp_path / "scene.toml"
        path.write_text(text)
        return path

    return _write


def message(path, overrides=None) -> str:
    with pytest.raises(ConfigError) as caught:
        load_config(path, Scene, overrides)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_reads_a_good_file(write):
    scene = load_config(write(GOOD), Scene)
    assert scene.radar.start_hz == 77e9
    assert scene.mesh == Path("cup.ply")
    assert scene.extent_m == (0.2, 0.3)


def test_an_integer_is_a_fine_float(write):
    assert load_config(write(GOOD.replace("77e9", "77000000000")), Scene).radar.start_hz == 77e9


def test_is_frozen(write):
    with pytest.raises(ValueError, match="frozen"):
        load_config(write(GOOD), Scene).preview = False


def test_unknown_key_names_the_known_ones_and_the_closest(write):
    text = message(write(GOOD + "num_sample = 3\n"))
    assert "scene.toml" in text
    assert "'radar.num_sample'" in text
    assert "did you mean 'num_samples'?" in text
    assert "known keys: start_hz, num_samples" in text


def test_unknown_key_inside_a_list(write):
    text = message(write(GOOD + "[[parts]]\nstart_hz = 1.0\n[[parts]]\nstart_hz = 1.0\nstop_hz = 2.0\n"))
    assert "'parts[1].stop_hz'" in text
    assert "known keys: start_hz, num_samples" in text


def test_missing_key(write):
    assert "key 'radar' is missing" in message(write('mesh = "cup.ply"\n'))


@pytest.mark.parametrize(
    ("line", "key", "expected"),
    [
        ("num_samples = '256'", "radar.num_samples", "expected a valid integer, got '256'"),
        ("num_samples = 2.5", "radar.num_samples", "expected a valid integer, got 2.5"),
        ("num_samples = true", "radar.num_samples", "expected a valid integer, got True"),
        ("num_samples = [1]", "radar.num_samples", "expected a valid integer, got [1]"),
    ],
)
def test_wrong_type_names_file_key_and_expectation(write, line, key, expected):
    text = message(write(GOOD + line + "\n"))
    assert "scene.toml" in text
    assert repr(key) in text
    assert expected in text


def test_every_problem_is_named(write):
    text = message(write(GOOD.replace("77e9", "'77 GHz'") + "bandwith = 1\n"))
    assert "radar.start_hz" in text
    assert "radar.bandwith" in text


def test_syntax_error_names_the_line(write):
    assert "line 2" in message(write('mesh = "cup.ply"\nradar = \n'))


def test_missing_file(tmp_path):
    assert "no such configuration file" in message(tmp_path / "absent.toml")


def test_not_text(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xff\xfe\x00")
    assert "not UTF-8" in message(path)


def test_overrides_go_over_the_file(write):
    overrides = {"radar.num_samples": 512, "preview": None, "mesh": Path("mug.ply")}
    scene = load_config(write(GOOD), Scene, overrides)
    assert (scene.radar.num_samples, scene.preview, scene.mesh) == (512, True, Path("mug.ply"))


def test_overrides_are_checked_too():
    assert "command line: unknown key 'meshes'" in message(None, {"meshes": "x"})


def test_override_below_a_value(write):
    assert "'mesh' is a value" in message(write(GOOD), {"mesh.path": 1})

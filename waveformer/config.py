"""Configuration files: TOML in, a frozen, checked model out, and errors that say what to change.

An unknown key is an error, never a silent default, and no value is converted on the way: ``"256"`` is
not a number and ``1`` is not a boolean.
"""

from __future__ import annotations

import difflib
import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

from waveformer.simulator.errors import WaveformerError


class ConfigError(WaveformerError):
    """A configuration file or an option on the command line is not as expected."""


class Config(BaseModel):
    """Base of every configuration: frozen, unknown keys refused. Field names carry their unit."""

    model_config = ConfigDict(extra="forbid", frozen=True)


Model = TypeVar("Model", bound=BaseModel)


def load_config(
    path: str | Path | None, model: type[Model], overrides: Mapping[str, Any] | None = None
) -> Model:
    """Read a TOML file into a model; options of the command line go over it.

    Args:
        path: TOML file; None = no file, only defaults and `overrides`.
        model: the pydantic model to fill, best a subclass of `Config`.
        overrides: values that replace those of the file, by key; a nested key is written with dots
            (``"chirp.start_hz"``). None means "option not given" and is skipped.

    Returns:
        The checked model.

    Raises:
        ConfigError: in one line, the file, the key, and what is expected there.
    """
    values = {} if path is None else _read_toml(Path(path))
    for key, value in (overrides or {}).items():
        if value is not None:
            _set_nested(values, key, value)
    source = "command line" if path is None else str(path)
    try:
        # Through JSON, because its strict mode takes an array for a tuple and a string for a path.
        return model.model_validate_json(json.dumps(values, default=str), strict=True)
    except ValidationError as error:
        # A misspelt key first: it also explains the one that is missing.
        found = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
        problems = [_describe(model, problem) for problem in found]
        raise ConfigError(f"{source}: {'; '.join(problems)}") from error


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such configuration file") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not UTF-8 text (byte {error.start})") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error


def _set_nested(values: dict[str, Any], key: str, value: Any) -> None:
    *sections, last = key.split(".")
    for section in sections:
        values = values.setdefault(section, {})
        if not isinstance(values, dict):
            raise ConfigError(f"{key}: {section!r} is a value in the file, not a section")
    values[last] = value


def _describe(model: type[BaseModel], problem: Mapping[str, Any]) -> str:
    location: tuple[str | int, ...] = problem["loc"]
    key = _dotted(location)
    if problem["type"] == "extra_forbidden":
        known = _known_keys(model, location[:-1])
        closest = difflib.get_close_matches(str(location[-1]), known, n=1)
        suggestion = f", did you mean {closest[0]!r}?" if closest else ";"
        return f"unknown key {key!r}{suggestion} known keys: {', '.join(known) or 'none'}"
    if problem["type"] == "missing":
        return f"key {key!r} is missing"
    expected = problem["msg"].replace("Input should be", "expected").removeprefix("Value error, ")
    given = problem["input"]
    shown = f", got {_short(given)}" if not isinstance(given, Mapping) else ""
    return f"key {key!r}: {expected}{shown}" if key else f"{expected}{shown}"


def _dotted(location: Sequence[str | int]) -> str:
    """Render ``("targets", 0, "mesh")`` as ``targets[0].mesh``."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _known_keys(model: type[BaseModel], location: Sequence[str | int]) -> list[str]:
    """Keys of the section at `location`; list indices and keys of mappings do not change the model."""
    for part in location:
        field = model.model_fields.get(str(part))
        if field is not None and (inner := _model_in(field.annotation)) is not None:
            model = inner
    return [field.alias or name for name, field in model.model_fields.items()]


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The first model inside an annotation such as ``list[Chirp] | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in get_args(annotation):
        if (found := _model_in(argument)) is not None:
            return found
    return None


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."

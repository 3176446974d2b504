"""Load scenarios: from TOML files, from those shipped with Heliograph, and from what a log carries.

Whatever a user can get wrong raises `UserError` with one sentence that names file, key and remedy.
"""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Sequence
from difflib import get_close_matches
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import msgspec

from emulator.errors import InvalidError, UserError
from emulator.graph_sources import with_graph
from emulator.scenario import Scenario, Settings
from emulator.scenario_checks import check, file_of
from emulator.scenario_keys import convert
from emulator.scenario_overrides import Document, apply

SHIPPED_PACKAGE = "scenarios"


def load(
    name_or_path: str,
    *,
    robots: int | None = None,
    seed: int | None = None,
    overrides: Sequence[str] = (),
) -> Scenario:
    """The scenario of a TOML file, or of the shipped name, with `robots`, `seed` and "key=value" set.

    Raises UserError for whatever is wrong with it.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml" or "/" in name_or_path:
        source, text, folder = name_or_path, _read(path, name_or_path), path.resolve().parent
        document = Document(source)
    else:
        found = _find(name_or_path)
        source, text, folder = found.name, found.read_bytes(), None
        document = Document(name_or_path, f"copy {found} and write it there")
    raw = _parse(text, source)
    changes = _Changes(source, document)
    if robots is not None:
        raw["robots"] = robots
        changes.labels["robots"] = f"--robots {robots}"
    if seed is not None:
        raw["seed"] = seed
        changes.labels["seed"] = f"--seed {seed}"
    # A shipped scenario with files of the user's own: those are where the user is.
    settings = _settings(raw, changes, overrides, folder or Path.cwd())
    folder = folder or (Path.cwd() if any(file_of(name) for _, name in _functions(settings)) else None)
    _check_files(settings, folder, changes)
    return _scenario(settings, Path(source).stem, text, folder)


def from_resolved(json_text: str, folder: Path | None, *, text: bytes = b"") -> Scenario:
    """The scenario of which `resolved_json` wrote this. Raises UserError where it cannot be one.

    `folder`: where its file behaviours are; `text`: the file it was loaded from.
    """
    source = "resolved scenario"
    try:
        raw = msgspec.json.decode(json_text, type=dict[str, Any])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise UserError(f"{source}: is not the JSON that a log carries ({error})") from None
    name = raw.pop("name", None)
    if not isinstance(name, str):
        raise UserError(f"{source}: missing key name: must be a text in quotes")
    changes = _Changes(source)
    settings = _settings(raw, changes, (), folder or Path.cwd())
    _check_files(settings, folder, changes)
    return _scenario(settings, name, text, folder)


def shipped() -> list[tuple[str, str]]:
    """Name and title of every scenario that comes with Heliograph, sorted by name."""
    files = sorted(_shipped().items())
    return [(name, tomllib.loads(file.read_text("utf-8")).get("title", "")) for name, file in files]


class _Changes:
    """Which keys were given on the command line, so that errors name what the user wrote."""

    def __init__(self, source: str, document: Document | None = None) -> None:
        self.source = source
        self.document = document or Document(source)
        self.labels: dict[str, str] = {}

    def error(self, invalid: InvalidError) -> UserError:
        """The error, told of the option that set the key, or else of the file."""
        for key, label in self.labels.items():
            if invalid.key == key or invalid.key.startswith((f"{key}.", f"{key}[")):
                return UserError(f"{label}: {invalid}" if key == invalid.key else _told(label, invalid))
        source = f"{self.source} with {', '.join(self.labels.values())}" if self.labels else self.source
        return UserError(_told(source, invalid))


def _told(source: str, invalid: InvalidError) -> str:
    return f"{source}: {invalid}" if invalid.names_key else f"{source}: {invalid.key}: {invalid}"


def _settings(raw: dict[str, Any], changes: _Changes, overrides: Sequence[str], folder: Path) -> Settings:
    raw = copy.deepcopy(raw)
    for override in overrides:
        try:
            key = apply(raw, override, changes.document)
        except InvalidError as invalid:
            raise UserError(_told("--set", invalid)) from None
        changes.labels[key] = f"--set {' '.join(override.split())}"
    try:
        settings = with_graph(convert(raw), folder)
        check(settings)
    except InvalidError as invalid:
        raise changes.error(invalid) from None
    return settings


def _scenario(settings: Settings, name: str, text: bytes, folder: Path | None) -> Scenario:
    fields = {field: getattr(settings, field) for field in Settings.__struct_fields__}
    return Scenario(**fields, name=name, text=text, folder=folder)


def _functions(settings: Settings) -> list[tuple[str, str]]:
    named = [("behaviour", settings.behaviour), ("score", settings.score)]
    named += [(f"group.{group.name}.behaviour", group.behaviour) for group in settings.group]
    named += [(f"robot.{robot.id}.behaviour", robot.behaviour) for robot in settings.robot]
    return [(key, function) for key, function in named if function is not None]


def _check_files(settings: Settings, folder: Path | None, changes: _Changes) -> None:
    for key, function in _functions(settings):
        file = file_of(function)
        if file is None:
            continue
        if folder is None:
            raise changes.error(
                InvalidError(key, f"{file} is a file of its own; say in which folder to find it")
            )
        if not (folder / file).is_file():
            why = f"there is no file {file} in {folder}; give its path relative to the scenario file"
            raise changes.error(InvalidError(key, why))


def _read(path: Path, source: str) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        near = get_close_matches(path.name, [file.name for file in path.parent.glob("*.toml")], n=1)
        hint = f"did you mean {path.parent / near[0]}?" if near else "check its path"
        raise UserError(f"{source}: there is no such file, {hint}") from None
    except OSError as error:
        raise UserError(f"{source}: cannot be read ({error.strerror}); name a TOML file") from None


def _parse(text: bytes, source: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        line = text.count(b"\n", 0, error.start) + 1
        raise UserError(f"{source}: line {line}: is not UTF-8 text; save the file as UTF-8") from None
    except RecursionError:
        raise UserError(f"{source}: is nested too deeply to be read; flatten it") from None
    except ValueError as error:
        raise UserError(_syntax(str(error), text.decode("utf-8"), source)) from None


def _syntax(message: str, text: str, source: str) -> str:
    """The message of tomllib with the line in front, which it gives in brackets or not at all."""
    what, place, _ = message.partition(" (at ")
    found = re.search(r"\(at line (\d+), column (\d+)\)", message)
    where = f"line {found[1]}, column {found[2]}: " if found else ""
    if place and not found:
        where = f"line {text.rstrip().count(chr(10)) + 1}, at the end: "
    return f"{source}: {where}is not valid TOML ({what[:1].lower()}{what[1:]}); mend that line"


def _shipped() -> dict[str, Traversable]:
    try:
        package = resources.files(SHIPPED_PACKAGE)
    except ModuleNotFoundError:
        return {}
    families = [folder for folder in package.iterdir() if folder.is_dir()]
    files = [file for family in families for file in family.iterdir() if file.name.endswith(".toml")]
    return {file.name.removesuffix(".toml"): file for file in sorted(files, key=lambda file: file.name)}


def _find(name: str) -> Traversable:
    known = _shipped()
    if name in known:
        return known[name]
    near = get_close_matches(name, known, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else "name one of them or a TOML file;"
    raise UserError(f"{name}: there is no such scenario, {hint} `heliograph scenarios` lists them")

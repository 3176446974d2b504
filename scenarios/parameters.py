"""Parameters of predictions and studies, from text as users type it."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any, TypeVar, get_type_hints

import msgspec
from msgspec import NODEFAULT, Struct, inspect

from emulator.errors import UserError
from emulator.scenario_checks import InvalidError
from emulator.scenario_keys import described, members, misfit, shown, unknown_key

S = TypeVar("S", bound=Struct)


def parameters_from(struct: type[S], texts: Mapping[str, str], label: str) -> S:
    """The parameters with these keys set. `label` begins the sentence of an error ("--set", "--").

    Raises UserError for an unknown key, a value that does not fit, or a key that is missing.
    """
    values = {key: _value(struct, key, text, label) for key, text in texts.items()}
    for field in msgspec.structs.fields(struct):
        if field.required and field.name not in values:
            words = described(members(_schema(struct))[field.name], "")
            raise UserError(f"{_typed(label, field.name)} is missing: must be {words}")
    return struct(**values)


def assignments(pairs: list[str]) -> dict[str, str]:
    """Keys and values of "key=value" texts. Raises UserError for what is not of that form."""
    found: dict[str, str] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals or not key.strip():
            raise UserError(f"--set {pair}: sets nothing; write key=value")
        found[key.strip()] = text.strip()
    return found


def explained(struct: type[Struct]) -> list[tuple[str, str, str]]:
    """Name, default as text, and description of every parameter."""
    schemas = members(_schema(struct))
    return [
        (field.name, _default(field.default), _description(schemas[field.name]))
        for field in msgspec.structs.fields(struct)
    ]


def _value(struct: type[Struct], key: str, text: str, label: str) -> Any:
    schemas = members(_schema(struct))
    raw: dict[str, Any] = {key: _parsed(text)}
    try:
        if key not in schemas:
            raise unknown_key((key,), schemas, raw)
        return msgspec.convert(raw[key], get_type_hints(struct, include_extras=True)[key])
    except msgspec.ValidationError:
        raise UserError(f"{_typed(label, key)}: {misfit((key,), schemas[key], raw[key], raw)}") from None
    except InvalidError as error:
        raise UserError(f"{label}{error}") from None


def _typed(label: str, key: str) -> str:
    """A key as users type it: options have hyphens."""
    return label + (key.replace("_", "-") if label == "--" else key)


def _parsed(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, KeyError, RecursionError):
        return text


def _schema(struct: type[Struct]) -> inspect.Type:
    return inspect.type_info(struct)


def _default(value: Any) -> str:
    if value is NODEFAULT:
        return "needed"
    return "not set" if value is None else shown(value)


def _description(schema: inspect.Type) -> str:
    options = schema.types if isinstance(schema, inspect.UnionType) else (schema,)
    for option in options:
        if isinstance(option, inspect.Metadata) and option.extra_json_schema:
            return str(option.extra_json_schema.get("description", ""))
    return ""

"""`--set a.b.c=value`: change single keys of a scenario, typed by the schema."""

from __future__ import annotations

import tomllib
from typing import Any

from msgspec import inspect

from emulator.scenario_checks import InvalidError
from emulator.scenario_keys import ROOT, Schema, members, misfit, options, shown, tables, unknown_key

EXCLUSIVE: dict[tuple[str, ...], str] = {("world", "area_m"): "neighbours", ("world", "neighbours"): "area_m"}
"""Of two keys that exclude each other, setting one takes the other's place."""


def apply(raw: dict[str, Any], override: str) -> str:
    """Change the document `raw` in place by one "key=value"; returns the key.

    Tables on the way are created, except below `params`, where only what the file has can be set, to a
    value of the same type. Raises InvalidError for a key that does not exist or a value of the wrong type.
    """
    key, equals, text = override.partition("=")
    key = key.strip()
    path = tuple(word.strip() for word in key.split("."))
    if not equals or not all(path):
        why = f"{shown(override)} sets nothing; write key=value, for example radio.range_m=16"
        raise InvalidError(override, why, names_key=True)
    if path[0] == "params" and len(path) > 1:
        _set_param(raw, path, text.strip())
    else:
        _set(raw, path, text.strip())
    return key


def _set(raw: dict[str, Any], path: tuple[str, ...], text: str) -> None:
    table, schema = raw, ROOT
    for depth, step in enumerate(path[:-1], 1):
        schema = _member(schema, path[:depth], raw)
        if not tables(schema):
            raise InvalidError(
                ".".join(path[:depth]), "holds no keys that could be set singly; set it as a whole"
            )
        inner = table.setdefault(step, {})
        if not isinstance(inner, dict):
            raise misfit(path[:depth], schema, inner, raw)
        table = inner
    name = path[-1]
    value = _value(_member(schema, path, raw), text)
    if any(alternative.tag_field == name for alternative in tables(schema)):
        _keep_known(table, schema, value)
    table.pop(EXCLUSIVE.get(path, ""), None)
    table[name] = value


def _member(schema: Schema, path: tuple[str, ...], raw: dict[str, Any]) -> Schema:
    known = members(schema)
    if path[-1] not in known:
        raise unknown_key(path, known, raw)
    return known[path[-1]]


def _keep_known(table: dict[str, Any], schema: Schema, tag: Any) -> None:
    """Another kind is chosen: what only the kind before knew goes."""
    for alternative in tables(schema):
        if alternative.tag == tag:
            known = {field.encode_name for field in alternative.fields}
            for name in set(table) - known:
                del table[name]


def _value(schema: Schema, text: str) -> Any:
    parsed = _parsed(text)
    wants_text = any(isinstance(option, inspect.StrType | inspect.LiteralType) for option in options(schema))
    return text if wants_text and not isinstance(parsed, str) else parsed


def _parsed(text: str) -> Any:
    """The text as a TOML value, or itself where it is none."""
    try:
        document = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    # A line break in the text would begin another key.
    return document["value"] if set(document) == {"value"} else text


def _set_param(raw: dict[str, Any], path: tuple[str, ...], text: str) -> None:
    raw.setdefault("params", {})
    table: Any = raw
    for depth, step in enumerate(path, 1):
        if not isinstance(table, dict) or step not in table:
            known = table if isinstance(table, dict) else ()
            raise unknown_key(path[:depth], known, raw)
        if depth < len(path):
            table = table[step]
    old = table[path[-1]]
    new = text if isinstance(old, str) and not isinstance(_parsed(text), str) else _parsed(text)
    if isinstance(old, float) and type(new) is int:
        new = float(new)
    if type(new) is not type(old):
        why = f"must be {_kind(old)} like the {shown(old)} in the file, is {shown(new)}"
        raise InvalidError(".".join(path), why)
    table[path[-1]] = new


def _kind(value: Any) -> str:
    kinds = {bool: "true or false", int: "a whole number", float: "a number", str: "a text", list: "a list"}
    return kinds.get(type(value), "a table")

"""`--set a.b.c=value`: change single keys of a scenario, typed by the schema.

The tables of robots and groups go by name: `robot.r03.params.tries`, `group.mobile.share`.
"""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any, NamedTuple

from msgspec import inspect

from emulator.errors import InvalidError
from emulator.scenario_keys import (
    ANY,
    NAMED_BY,
    ROOT,
    Schema,
    item,
    members,
    misfit,
    name_of,
    options,
    shown,
    tables,
    unknown_key,
)

Path = tuple[str, ...]

_GRAPH = ("vertices", "edges", "links", "obstacles")
EXCLUSIVE: dict[Path, tuple[str, ...]] = {
    ("world", "area_m"): ("neighbours",),
    ("world", "neighbours"): ("area_m",),
    ("world", "graph", "file"): ("generator", "args", *_GRAPH),
    ("world", "graph", "generator"): ("file", *_GRAPH),
    ("world", "graph", "vertices"): ("file", "generator", "args"),
    ("group", "robots"): ("share",),
    ("group", "share"): ("robots",),
    ("radio", "tdma", "slot_s"): ("units",),
    ("radio", "tdma", "units"): ("slot_s",),
}
"""Of keys that exclude each other, setting one takes the others' place; groups without their names."""
ARGS: Path = ("world", "graph", "args")


class Document(NamedTuple):
    """A scenario file, as it is told of."""

    name: str
    to_write: str = "write it there"
    """How somebody gets a new key into it."""


def apply(raw: dict[str, Any], override: str, document: Document) -> str:
    """Change `raw`, what `document` holds, in place by one "key=value"; returns the key.

    Tables on the way are created, except below `params`, where only what the file has can be set, to a
    value of the same type, or to a table where it has a text: a word may stand for one. Arguments of the
    graph's generator that the file has keep their type, too; others can be added. Raises InvalidError for a
    key that does not exist or a value of the wrong type.
    """
    key, equals, text = override.partition("=")
    key = key.strip()
    path: Path = tuple(word.strip() for word in key.split("."))
    if not equals or not all(path):
        why = f"{shown(override)} sets nothing; write key=value, for example radio.range_m=16"
        raise InvalidError(override, why, names_key=True)
    table, schema, depth = raw, ROOT, 0
    if path[0] in NAMED_BY and len(path) > 1:
        table, schema, depth = _named_table(raw, path), item(members(ROOT)[path[0]]), 2
    if path[depth] == "params" and len(path) > depth + 1:
        _check_param(raw, table, path, depth, document)
        _set_param(raw, table, path, depth, text.strip())
    elif path[:-1] == ARGS:
        _set_arg(raw, path, text.strip())
    else:
        _set(raw, table, schema, path, depth, text.strip())
    return key


def _named_table(raw: dict[str, Any], path: Path) -> dict[str, Any]:
    """The table of one robot or group, which the file must have."""
    key, listed = path[0], raw.get(path[0], [])
    expected = members(ROOT)[key]
    if not isinstance(listed, list):
        raise misfit(path[:1], expected, listed, raw)
    found = {name: table for table in listed if isinstance(name := name_of(key, table), str)}
    if not found:
        why = f"unknown key {'.'.join(path[:2])}, there are no [[{key}]] tables in the file"
        raise InvalidError(".".join(path[:2]), why, names_key=True)
    if path[1] not in found:
        raise unknown_key(path[:2], found, raw)
    if len(path) == 2:
        known = ", ".join(sorted(members(item(expected))))
        raise InvalidError(".".join(path), f"is a table; set its keys singly, possible are {known}")
    table: dict[str, Any] = found[path[1]]
    return table


def _set(
    raw: dict[str, Any], table: dict[str, Any], schema: Schema, path: Path, depth: int, text: str
) -> None:
    """Set what `path` leads to; its first `depth` steps lead to `table`."""
    for walked, step in enumerate(path[depth:-1], depth + 1):
        schema = _member(schema, path[:walked], raw)
        if not tables(schema):
            raise InvalidError(
                ".".join(path[:walked]), "holds no keys that could be set singly; set it as a whole"
            )
        inner = table.setdefault(step, {})
        if not isinstance(inner, dict):
            raise misfit(path[:walked], schema, inner, raw)
        table = inner
    name = path[-1]
    value = _value(_member(schema, path, raw), text)
    if any(alternative.tag_field == name for alternative in tables(schema)):
        _keep_known(table, schema, value)
    for other in EXCLUSIVE.get((*path[: depth and 1], *path[depth:]), ()):
        table.pop(other, None)
    table[name] = value


def _member(schema: Schema, path: Path, raw: dict[str, Any]) -> Schema:
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


def _check_param(
    raw: dict[str, Any], own: dict[str, Any], path: Path, depth: int, document: Document
) -> None:
    """Raises InvalidError for a param that neither the table `own`, at `path[:depth]`, nor [params] has."""
    params = own.get("params", {})
    if not isinstance(params, dict):
        raise misfit(path[: depth + 1], ANY, params, raw)
    table: Any = _shared(raw) | params
    for walked, step in enumerate(path[depth + 1 :], depth + 2):
        if not isinstance(table, dict):
            raise unknown_key(path[:walked], (), raw)
        if step not in table:
            if get_close_matches(step, table, n=1):
                raise unknown_key(path[:walked], table, raw)
            shared = f"[{'.'.join(path[depth : walked - 1])}]"
            own_table = ".".join(path[: walked - 1])
            # A table of a robot's or group's own stands for the shared one, and hides what is added to that.
            hides = walked > depth + 2 and path[depth + 1] in params
            place = shared if not depth else own_table if hides else f"{own_table} or {shared}"
            raise _absent(".".join(path[:walked]), place, table, document)
        table = table[step]


def _absent(key: str, place: str, present: Iterable[str], document: Document) -> InvalidError:
    """What to say about a param that is not in the file: which ones there can be only behaviours know."""
    names = ", ".join(sorted(present))
    why = f"{document.name} has no such key under {place}; {document.to_write}, then --set can "
    return InvalidError(key, f"{why}change it{f' (there are {names})' if names else ''}")


def _set_param(raw: dict[str, Any], own: dict[str, Any], path: Path, depth: int, text: str) -> None:
    """Set a param of the table `own`, at `path[:depth]`; it has those of the whole scenario as well."""
    params = own.get("params", {})
    known: Any = copy.deepcopy(_shared(raw) | params)
    table = known
    for step in path[depth + 1 : -1]:
        table = table[step]
    table[path[-1]] = _alike(table[path[-1]], text, path)
    own["params"] = params | {path[depth + 1]: known[path[depth + 1]]}


def _shared(raw: dict[str, Any]) -> dict[str, Any]:
    """The params of all robots."""
    shared = raw.get("params")
    return shared if isinstance(shared, dict) else {}


def _set_arg(raw: dict[str, Any], path: Path, text: str) -> None:
    """Set an argument of the generator of the world's graph."""
    table, schema = raw, ROOT
    for walked, step in enumerate(ARGS, 1):
        schema = members(schema)[step]
        table = table.setdefault(step, {})
        if not isinstance(table, dict):
            raise misfit(path[:walked], schema, table, raw)
    name = path[-1]
    table[name] = _alike(table[name], text, path) if name in table else _parsed(text)


def _alike(old: Any, text: str, path: Path) -> Any:
    """The value in a text, if it is of the type that the file has there."""
    new = _parsed(text)
    if isinstance(old, str) and not isinstance(new, str | dict):
        new = text
    if isinstance(old, float) and type(new) is int:
        new = float(new)
    if type(new) is not type(old) and not (isinstance(old, str) and isinstance(new, dict)):
        why = f"must be {_kind(old)} like the {shown(old)} in the file, is {shown(new)}"
        raise InvalidError(".".join(path), why)
    return new


def _kind(value: Any) -> str:
    kinds = {bool: "true or false", int: "a whole number", float: "a number", str: "a text", list: "a list"}
    return kinds.get(type(value), "a table")

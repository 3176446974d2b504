"""The keys of a scenario file: what each expects, and plain sentences for what does not fit.

msgspec decides what fits; its message gives the place, and the schema and the document give the words.
"""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any, TypeVar

import msgspec
from msgspec import inspect

from emulator.errors import InvalidError
from emulator.scenario import Settings

Step = str | int
Schema = inspect.Type
Number = inspect.FloatType | inspect.IntType

T = TypeVar("T")

ROOT = inspect.type_info(Settings)
ANY = inspect.AnyType()

NAMED_BY = {"robot": "id", "group": "name"}
"""Lists of tables, and the key by whose value one of them goes in a dotted key."""

UNITS = {
    "_mps": "metres per second",
    "_bps": "bits per second",
    "_ppm": "parts per million",
    "_rad": "radians",
    "_deg": "degrees",
    "_hz": "hertz",
    "_bits": "bits",
    "_bytes": "bytes",
    "_s": "seconds",
    "_m": "metres",
}
_PLACE = re.compile(r"(?s)(?P<what>.*?)(?: - at `\$(?P<path>.*)`)?")
_NAMED = re.compile(r"(?s)Object (?P<how>contains unknown|missing required) field `(?P<name>.*)`")
_STEP = re.compile(r"\.(\w+)|\[(\d+)\]")


def convert(raw: dict[str, Any]) -> Settings:
    """The settings in a document as TOML or JSON gives it. Raises InvalidError for what does not fit."""
    return fitted(raw, Settings)


def fitted(raw: dict[str, Any], kind: type[T]) -> T:
    """A document as what it is to be. Raises InvalidError for what does not fit."""
    for name, value in raw.items():
        _check_values(name, value)
    try:
        return msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        raise _translated(str(error), raw, inspect.type_info(kind)) from None


def key_of(path: Iterable[Step], raw: Any) -> str:
    """A place in a document as users write it; the table of a robot or group goes by its name."""
    words: list[str] = []
    for step in path:
        raw = _inner(raw, step)
        if isinstance(step, str):
            words.append(step if re.fullmatch(r"[\w-]+", step) else shown(step))
        elif len(words) == 1 and isinstance(name := name_of(words[0], raw), str):
            words.append(name)
        else:
            words[-1] += f"[{step}]"
    return ".".join(words)


def name_of(key: str, table: Any) -> Any:
    """By what a table of the list `key` goes; None where it has no name."""
    return table.get(NAMED_BY[key]) if key in NAMED_BY and isinstance(table, dict) else None


def tables(schema: Schema) -> list[inspect.StructType]:
    """The tables a place may hold: none, one, or the alternatives that a kind chooses between."""
    return [option for option in options(schema) if isinstance(option, inspect.StructType)]


def options(schema: Schema) -> list[Schema]:
    """What a place may hold, without the None that stands for "left out"."""
    whole = schema.type if isinstance(schema, inspect.Metadata) else schema
    union = whole.types if isinstance(whole, inspect.UnionType) else (whole,)
    plain = [option.type if isinstance(option, inspect.Metadata) else option for option in union]
    return [option for option in plain if not isinstance(option, inspect.NoneType)]


def members(schema: Schema) -> dict[str, Schema]:
    """The keys a table may hold, over all its alternatives, and what each expects."""
    found: dict[str, Schema] = {}
    choices = [table for table in tables(schema) if table.tag_field is not None]
    if choices and choices[0].tag_field is not None:
        found[choices[0].tag_field] = inspect.LiteralType(tuple(str(table.tag) for table in choices))
    for table in tables(schema):
        found.update({field.encode_name: field.type for field in table.fields})
    return found


def item(schema: Schema, place: int = 0) -> Schema:
    """What a list may hold in one place."""
    for option in options(schema):
        if isinstance(option, inspect.ListType | inspect.VarTupleType):
            return option.item_type
        if isinstance(option, inspect.TupleType):
            return option.item_types[place]
    return ANY


def unknown_key(path: tuple[Step, ...], known: Iterable[str], raw: Any) -> InvalidError:
    """What to say about a key that does not exist where it stands."""
    name, names = str(path[-1]), sorted(known)
    near = get_close_matches(name, names, n=1)
    if near:
        unit = _unit(near[0])
        hint = f"did you mean {near[0]}{f' ({unit})' if unit else ''}?"
    elif names:
        hint = f"possible are {', '.join(names)}"
    else:
        hint = "nothing can be set there"
    key = key_of(path, raw)
    return InvalidError(key, f"unknown key {key}, {hint}", names_key=True)


def misfit(path: tuple[Step, ...], expected: Schema, value: Any, raw: Any) -> InvalidError:
    """What to say about a value that is not what its key expects."""
    name = next((step for step in reversed(path) if isinstance(step, str)), "")
    why = f"must be {described(expected, name)}, is {shown(value)}"
    choices = [str(v) for o in options(expected) if isinstance(o, inspect.LiteralType) for v in o.values]
    near = get_close_matches(value, choices, n=1) if isinstance(value, str) else []
    if near:
        why += f"; did you mean {near[0]}?"
    elif isinstance(value, str) and any(isinstance(option, Number) for option in options(expected)):
        why += "; write the bare number"
    return InvalidError(key_of(path, raw), why)


def shown(value: Any) -> str:
    """A value as the user wrote it, on one line and not too long."""
    if isinstance(value, float | datetime.date | datetime.time):
        return str(value)
    text = str(value).lower() if isinstance(value, int) else msgspec.json.encode(value, enc_hook=str).decode()
    return text if len(text) <= 60 else text[:57] + "..."


def described(schema: Schema, name: str, many: int = 1) -> str:
    """What a key expects, in words; `many` of them for a list."""
    return " or ".join(dict.fromkeys(_described(option, name, many) for option in options(schema)))


def _described(schema: Schema, name: str, many: int) -> str:
    plural = "s" if many != 1 else ""
    if isinstance(schema, Number):
        kind = "whole number" if isinstance(schema, inspect.IntType) else "number"
        unit = _unit(name)
        of_unit = f" of {unit}" if unit else ""
        return f"{'' if plural else 'a '}{kind}{plural}{of_unit}{_bounds(schema)}"
    if isinstance(schema, inspect.StrType):
        return "texts" if plural else "a text in quotes"
    if isinstance(schema, inspect.BoolType):
        return "true or false"
    if isinstance(schema, inspect.LiteralType):
        return " or ".join(shown(value) for value in schema.values)
    a_list = "lists" if plural else "a list"
    if isinstance(schema, inspect.TupleType):
        count, first = len(schema.item_types), schema.item_types[0]
        if all(item == first for item in schema.item_types):
            return f"{a_list} of {count} {described(first, name, count)}"
        *most, last = [described(item, name) for item in schema.item_types]
        return f"{a_list} of {', '.join(most)} and {last}"
    if isinstance(schema, inspect.ListType | inspect.VarTupleType):
        if tables(schema.item_type):
            return f"[[{name}]] tables"
        return f"{a_list} of {described(schema.item_type, name, 2)}{_lengths(schema)}"
    return "a table"


def _bounds(schema: Number) -> str:
    if schema.gt is not None and schema.le is not None:
        return f" greater than {schema.gt:.15g} and at most {schema.le:.15g}"
    if schema.gt is not None:
        return f" greater than {schema.gt:.15g}"
    if schema.ge is not None and schema.lt is not None:
        return f" of at least {schema.ge:.15g} and less than {schema.lt:.15g}"
    # More digits than 15 are the limit of the type, which nobody wants to read.
    if schema.ge is not None and schema.le is not None and schema.le < 1e15:
        return f" from {schema.ge:.15g} to {schema.le:.15g}"
    return f" of at least {schema.ge:.15g}" if schema.ge is not None else ""


def _lengths(schema: inspect.ListType | inspect.VarTupleType) -> str:
    if isinstance(schema, inspect.ListType) and schema.min_length and schema.max_length:
        return f" ({schema.min_length} to {schema.max_length} of them)"
    return ""


def _unit(name: str) -> str:
    return next((unit for suffix, unit in UNITS.items() if name.endswith(suffix)), "")


def _check_values(key: str, value: Any) -> None:
    """Refuse what TOML can say and neither JSON nor a robot's wire can carry."""
    if isinstance(value, dict):
        for name, inner in value.items():
            _check_values(f"{key}.{name}", inner)
    elif isinstance(value, list):
        for place, inner in enumerate(value):
            _check_values(f"{key}[{place}]", inner)
    elif isinstance(value, float) and not math.isfinite(value):
        raise InvalidError(key, f"must be a finite number, is {value}")
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise InvalidError(key, "is a whole number of more than 64 bits; write a smaller one")
    elif isinstance(value, datetime.date | datetime.time):
        raise InvalidError(key, f"{value} is a date or time; write it as a text in quotes")


def _translated(message: str, raw: dict[str, Any], root: Schema) -> InvalidError:
    place = _PLACE.fullmatch(message)
    assert place is not None
    path = tuple(name or int(number) for name, number in _STEP.findall(place["path"] or ""))
    schema = _schema_at(path, root)
    value: Any = raw
    for step in path:
        value = _inner(value, step)
    named = _NAMED.fullmatch(place["what"])
    if named is None:
        return misfit(path, schema, value, raw)
    inner = (*path, named["name"])
    chosen = _chosen(schema, value)
    if named["how"] == "contains unknown":
        return unknown_key(inner, chosen, raw)
    key = key_of(inner, raw)
    words = described(chosen[named["name"]], named["name"])
    return InvalidError(key, f"missing key {key}: must be {words}", names_key=True)


def _chosen(schema: Schema, value: Any) -> dict[str, Schema]:
    """The keys of a table, of the alternative that its kind chooses."""
    for table in tables(schema):
        tag_field = table.tag_field
        if tag_field is not None and isinstance(value, dict) and value.get(tag_field) == table.tag:
            return {tag_field: members(schema)[tag_field]} | members(table)
    return members(schema)


def _schema_at(path: Iterable[Step], root: Schema) -> Schema:
    schema = root
    for step in path:
        schema = members(schema).get(step, ANY) if isinstance(step, str) else item(schema, step)
    return schema


def _inner(raw: Any, step: Step) -> Any:
    if isinstance(raw, dict):
        return raw.get(step)
    if isinstance(raw, list) and isinstance(step, int) and step < len(raw):
        return raw[step]
    return None

"""Where the graph of a world comes from: a file, a generator, or the scenario itself.

All that can be wrong with it raises `InvalidError` with the key to mend.
"""

from __future__ import annotations

import contextlib
import inspect
import re
import sys
from collections.abc import Callable
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import msgspec

from agent.loading import BehaviourError, forget_user_modules, is_file, load_function
from channels.graph_text import measured
from channels.graphs import Graph, check
from emulator.errors import InvalidError
from emulator.graph_checks import check_obstacles, check_sight
from emulator.graphs import (
    MOST_PAIRS,
    MOST_VERTICES,
    GraphSettings,
    area_around,
    coincident,
    graph_of,
    in_metres,
    links_by_distance,
    settings_of,
)
from emulator.scenario import MAX_SIDE_M, MIN_SIDE_M, Settings
from emulator.scenario_keys import fitted

KEY = "world.graph"
_SOURCES = ("file", "generator", "vertices")
_NAMED = re.compile(r"(?s)(?P<key>[A-Za-z_]\w*)(?P<rest>[\w.\[\]]*): (?P<why>.*)")


def with_graph(settings: Settings, folder: Path) -> Settings:
    """The same settings with the graph of their world as vertices in metres, and an area that holds it.

    `folder`: where the file, or the generator's file, is found.
    """
    world = settings.world
    if world.graph is None:
        return settings
    key = f"{KEY}.{_source(world.graph)}"
    graph = _graph(world.graph, settings.seed, folder)
    if world.graph.starts is not None:
        graph = msgspec.structs.replace(graph, starts=tuple(world.graph.starts))
    _check(graph, world.graph, key)
    graph = _checked_in_metres(graph, world.graph.scale_m, key)
    if world.graph.heard_m is not None:
        check_obstacles(world.obstacles)
        check_sight(graph, world.obstacles)
        links = links_by_distance(graph, world.graph.heard_m, [*graph.obstacles, *world.obstacles])
        graph = msgspec.structs.replace(graph, links=links)
        if len(links) > MOST_PAIRS:
            why = f"makes {len(links)} links, possible are {MOST_PAIRS}; make it shorter"
            raise InvalidError(f"{KEY}.heard_m", why)
    area_m = world.area_m
    if area_m is None and world.neighbours is None:
        width, height = area_around(graph)
        area_m = max(width, MIN_SIDE_M), max(height, MIN_SIDE_M)
    world = msgspec.structs.replace(world, graph=settings_of(graph), area_m=area_m)
    return msgspec.structs.replace(settings, world=world)


def _source(table: GraphSettings) -> str:
    """Which of the three says what the graph is."""
    given = [name for name in _SOURCES if getattr(table, name) is not None]
    if not given:
        why = (
            f"missing key {KEY}.file: name a JSON file, or a {KEY}.generator, "
            f"or give {KEY}.vertices and {KEY}.edges"
        )
        raise InvalidError(f"{KEY}.file", why, names_key=True)
    if len(given) > 1:
        raise InvalidError(f"{KEY}.{given[1]}", f"{KEY}.{given[0]} says what the graph is; keep one of them")
    if table.args and given[0] != "generator":
        why = f"only a generator takes them; leave them out, or set {KEY}.generator"
        raise InvalidError(f"{KEY}.args", why)
    if given[0] != "vertices":
        for name in ("edges", "links", "obstacles"):
            if getattr(table, name):
                raise InvalidError(f"{KEY}.{name}", f"belong to {KEY}.vertices; leave them out")
    return given[0]


def _graph(table: GraphSettings, seed: int, folder: Path) -> Graph:
    if table.file is not None:
        return _from_file(table.file, folder)
    if table.generator is not None:
        return _generated(table.generator, {"seed": seed} | table.args, folder)
    graph = graph_of(table)
    assert graph is not None
    return graph


def _from_file(name: str, folder: Path) -> Graph:
    key, path = f"{KEY}.file", folder / name
    try:
        raw = msgspec.json.decode(path.read_bytes())
    except FileNotFoundError:
        near = get_close_matches(Path(name).name, [file.name for file in path.parent.glob("*.json")], n=1)
        hint = f"did you mean {near[0]}?" if near else "give its path relative to the scenario file"
        raise InvalidError(key, f"there is no file {name} in {folder}, {hint}") from None
    except OSError as error:
        raise InvalidError(key, f"{name} cannot be read ({error.strerror}); name a JSON file") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InvalidError(key, f"{name} is not valid JSON ({error}); mend it") from None
    except ValueError as error:  # of the name itself, such as a null byte
        raise InvalidError(key, f"{name!r} is no name of a file ({error}); name a JSON file") from None
    if not isinstance(raw, dict):
        raise InvalidError(key, f'{name} must be an object, {{"vertices": [...], "edges": [...]}}')
    try:
        return fitted(measured(raw), Graph)
    except InvalidError as wrong:
        place = "" if wrong.names_key else f"{wrong.key}: "
        raise InvalidError(key, f"{name}: {place}{wrong}") from None


def _generated(name: str, args: dict[str, Any], folder: Path) -> Graph:
    key = f"{KEY}.generator"
    if is_file(name):
        forget_user_modules(folder)  # the file may have changed since it was last asked
    with contextlib.redirect_stdout(sys.stderr):  # standard output is for results alone
        try:
            function = load_function(name, folder)
        except BehaviourError as error:
            raise InvalidError(key, f"{error}; mend it, or name another function") from None
        _check_args(name, function, args)
        try:
            graph = function(**args)
        except ValueError as error:
            raise _refused(name, args, str(error)) from None
        except (Exception, SystemExit) as error:
            why = f"{name} fails with {type(error).__name__}: {' '.join(str(error).split())}; mend it"
            raise InvalidError(key, why) from error
    if not isinstance(graph, Graph):
        what = type(graph).__name__
        raise InvalidError(key, f"{name} returns a {what} instead of a Graph; name another function")
    try:
        return in_metres(graph, 1.0)
    except (TypeError, ValueError) as error:
        raise InvalidError(key, f"{name} returns no proper Graph ({error}); mend it") from None


def _check_args(name: str, function: Callable[..., Any], args: dict[str, Any]) -> None:
    """What the function does not take, or lacks, is told of by its key."""
    try:
        known = inspect.signature(function).parameters
    except (TypeError, ValueError):
        return  # what has no signature says itself what it does not like
    taken = [p.name for p in known.values() if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    if not any(p.kind is p.VAR_KEYWORD for p in known.values()):
        if "seed" not in taken:
            raise InvalidError(f"{KEY}.generator", f"{name} takes no seed; give it that argument")
        for arg in args:
            if arg not in taken:
                near = get_close_matches(arg, taken, n=1)
                hint = f"did you mean {near[0]}?" if near else f"possible are {', '.join(sorted(taken))}"
                why = f"unknown key {KEY}.args.{arg}, {hint}"
                raise InvalidError(f"{KEY}.args.{arg}", why, names_key=True)
    for arg in taken:
        if arg not in args and known[arg].default is inspect.Parameter.empty:
            why = f"missing key {KEY}.args.{arg}: {name} needs it"
            raise InvalidError(f"{KEY}.args.{arg}", why, names_key=True)


def _refused(name: str, args: dict[str, Any], message: str) -> InvalidError:
    """A generator's complaint, "key: what is wrong", under the key that its argument has."""
    message = " ".join(message.split())
    named = _NAMED.fullmatch(message)
    if named is None:
        return InvalidError(f"{KEY}.generator", f"{name} fails: {message or 'it does not say why'}")
    return InvalidError(f"{KEY}.args.{named['key']}{named['rest']}", named["why"])


def _check(graph: Graph, table: GraphSettings, key: str) -> None:
    """Raises InvalidError for a graph that is none, or too large."""
    count = len(graph.vertices)
    if count > MOST_VERTICES:
        raise InvalidError(key, f"has {count} vertices, possible are {MOST_VERTICES}; make the graph smaller")
    for what, pairs in (("edges", graph.edges), ("links", graph.links or ())):
        if len(pairs) > MOST_PAIRS:
            raise InvalidError(key, f"has {len(pairs)} {what}, possible are {MOST_PAIRS}; leave some out")
    try:
        check(graph)
    except ValueError as error:
        part, _, why = str(error).partition(": ")
        if table.vertices is not None or (table.starts is not None and part.startswith("starts")):
            raise InvalidError(f"{KEY}.{part}", why) from None
        raise InvalidError(key, f"{table.file or table.generator}: {error}") from None


def _checked_in_metres(graph: Graph, scale_m: float, key: str) -> Graph:
    graph = in_metres(graph, scale_m)
    try:
        check(graph)  # numbers may have become zero, or infinite
    except ValueError as error:
        raise InvalidError(f"{KEY}.scale_m", f"is {scale_m:g}, with which {error}") from None
    lowest = min(min(point) for point in graph.vertices)
    if lowest < 0:
        why = f"has a vertex at {lowest:.12g} m, and the area begins at 0; move the graph up or to the right"
        raise InvalidError(key, why)
    farthest = max(area_around(graph))
    if farthest > MAX_SIDE_M:
        why = f"needs an area with sides of {farthest:g} m, possible are {MAX_SIDE_M:g} m; lower it"
        raise InvalidError(f"{KEY}.scale_m", why)
    same = coincident(graph)
    if same is not None:
        why = f"has vertices {same[0]} and {same[1]} at one place; move one, or raise {KEY}.scale_m"
        raise InvalidError(key, why)
    return graph

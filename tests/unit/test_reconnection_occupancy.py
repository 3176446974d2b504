"""Cellular decomposition, on images drawn by hand."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from agent.behaviours.reconnection.occupancy import decomposed, from_image, occupancy
from channels.graphs import Graph, check, in_sight


def drawn(tmp_path: Path, *lines: str, name: str = "map.png") -> Path:
    """# is black, ? grey as map_server leaves what it does not know, all else white."""
    grey = {"#": 0, "?": 205, ".": 254}
    Image.fromarray(np.array([[grey[c] for c in line] for line in lines], dtype=np.uint8)).save(
        tmp_path / name
    )
    return tmp_path / name


def pairs(graph: Graph) -> set[tuple[int, int]]:
    return {(a, b) for a, b, _ in graph.edges}


@pytest.mark.parametrize("name", ["map.png", "map.pgm"])
def test_blocks_of_an_empty_room(tmp_path: Path, name: str) -> None:
    graph = from_image(drawn(tmp_path, *["." * 9] * 6, name=name), 3)
    check(graph)
    assert graph.vertices == tuple((x + 0.5, y + 0.5) for y in range(2) for x in range(3))
    assert pairs(graph) == {(0, 1), (1, 2), (3, 4), (4, 5), (0, 3), (1, 4), (2, 5)}
    assert {length for _, _, length in graph.edges} == {1.0}
    assert graph.obstacles == ()


def test_y_goes_upwards(tmp_path: Path) -> None:
    graph = from_image(drawn(tmp_path, ".###", "..#.", "...."), 1)
    # From below: four, then three of four, then the one at the left.
    assert graph.vertices == ((0.5, 0.5), (1.5, 0.5), (2.5, 0.5), (3.5, 0.5), (0.5, 1.5), (1.5, 1.5), (3.5, 1.5), (0.5, 2.5))  # fmt: skip
    assert pairs(graph) == {(0, 1), (1, 2), (2, 3), (0, 4), (1, 5), (3, 6), (4, 5), (4, 7)}
    assert np.allclose(sorted(graph.obstacles), [(1, 2, 4, 3), (2, 1, 3, 2)], atol=2e-3)


def test_a_wall_makes_two_cells_of_a_block(tmp_path: Path) -> None:
    """Here of each of three blocks but the lowest, where there is a door."""
    rows = [*[".#."] * 6, *["..."] * 3]
    found = decomposed(drawn(tmp_path, *rows), 3)
    assert found.graph.vertices == (
        (0.5, 0.5),
        (0.5 / 3, 1.5),
        (2.5 / 3, 1.5),
        (0.5 / 3, 2.5),
        (2.5 / 3, 2.5),
    )
    assert pairs(found.graph) == {(0, 1), (0, 2), (1, 3), (2, 4)}
    assert (found.cut_off, found.too_small) == (0, 0)


def test_only_the_largest_part_is_kept(tmp_path: Path) -> None:
    found = decomposed(drawn(tmp_path, "..#.", "..#.", "..##", "..#."), 1)
    assert found.graph.vertices == tuple((x + 0.5, y + 0.5) for y in range(4) for x in range(2))
    assert (found.cut_off, found.too_small) == (3, 0)


def test_slivers_are_no_cells(tmp_path: Path) -> None:
    image = drawn(tmp_path, "....##", "....##", "....#.", "....##")
    assert decomposed(image, 2, min_share=0.25).cut_off == 1
    found = decomposed(image, 2, min_share=0.26)
    assert (found.cut_off, found.too_small) == (0, 1)
    assert len(found.graph.vertices) == 4


def test_vertices_are_free_pixels(tmp_path: Path) -> None:
    """The centroid of a horseshoe lies where nobody can be."""
    graph = from_image(drawn(tmp_path, ".....", ".###.", ".###.", ".###.", ".###.", *["....."] * 5), 5)
    assert graph.vertices == ((0.5, 0.5), (0.5, 1.9))


def test_lengths_lead_through_the_door(tmp_path: Path) -> None:
    rows = [*["..#..."] * 2, "......"]
    graph = from_image(drawn(tmp_path, *rows), 3)
    # The wall is in the left block, whose vertex is beside it; the door is in the lowest row.
    (x0, y0), (x1, y1) = graph.vertices
    assert (3 * x0, 3 * y0, 3 * x1, 3 * y1) == pytest.approx((1.5, 1.5, 4.5, 1.5))
    assert graph.edges == ((0, 1, pytest.approx(2 * math.hypot(1.5, 1) / 3)),)


def test_blocks_are_counted_from_the_lower_left(tmp_path: Path) -> None:
    graph = from_image(drawn(tmp_path, *["." * 5] * 4), 3)
    assert graph.vertices == ((0.5, 0.5), (3.5 / 3, 0.5), (0.5, 3.5 / 3), (3.5 / 3, 3.5 / 3))
    assert pairs(graph) == {(0, 1), (0, 2), (1, 3), (2, 3)}


def test_what_is_unknown_is_not_free_unless_one_says_so(tmp_path: Path) -> None:
    image = drawn(tmp_path, "..??", "....")
    assert len(from_image(image, 1).vertices) == 6
    assert len(from_image(image, 1, free=0.5).vertices) == 8


def test_obstacles_cover_what_is_not_free(tmp_path: Path) -> None:
    chance = np.random.default_rng(4)
    for _ in range(20):
        free = chance.random((12, 15)) < 0.7
        image = tmp_path / "noise.png"
        Image.fromarray(np.where(free, 255, 0).astype(np.uint8)).save(image)
        found = decomposed(image, 1)
        check(found.graph)
        east = np.array([0.4, 0.0])
        centres = np.stack(np.meshgrid(np.arange(15) + 0.5, np.arange(12) + 0.5), axis=-1)
        # Nobody sees through the inside of a pixel that is not free, and all through one that is.
        seen = in_sight(centres - east, centres + east, found.graph.obstacles)
        assert (seen == free[::-1]).all()
        kept = {(x, y) for x, y in found.graph.vertices}
        assert kept <= {tuple(place) for place in centres[free[::-1]].tolist()}
        assert len(kept) + found.cut_off == free.sum()
        assert len(found.graph.obstacles) < np.count_nonzero(~free)


def test_nobody_sees_through_a_wall_of_pixels_that_touch_at_corners(tmp_path: Path) -> None:
    graph = from_image(drawn(tmp_path, "...#", "..#.", ".#..", "...."), 1)
    # The line between these crosses the wall exactly where two of its pixels touch.
    above, below = np.array([1.5, 2.5]), np.array([2.5, 1.5])
    assert {tuple(above), tuple(below)} <= set(graph.vertices)
    assert not in_sight(above, below, graph.obstacles)
    # Nor past one, exactly along its corner; but as soon as there is a gap.
    assert not in_sight(above, np.array([0.5, 1.5]), graph.obstacles)
    assert in_sight(above, np.array([0.49, 1.5]), graph.obstacles)


def test_walls_are_few_rectangles(tmp_path: Path) -> None:
    room = ["#" * 20, *["#" + "." * 18 + "#"] * 10, "#" * 20]
    graph = from_image(drawn(tmp_path, *room), 2)
    assert len(graph.obstacles) == 4


def test_deep_and_coloured_images(tmp_path: Path) -> None:
    plain = np.array([[255, 255, 0], [255, 255, 255], [205, 100, 0]], dtype=np.uint8)
    expected = None
    for name, pixels in {
        "grey.png": plain,
        "deep.png": plain.astype(np.uint16) * 257,
        "deep.pgm": plain.astype(np.uint16) * 257,
        "bits.png": plain > 205,
        "colour.png": np.repeat(plain[:, :, None], 3, axis=2),
    }.items():
        Image.fromarray(pixels).save(tmp_path / name)
        graph = from_image(tmp_path / name, 1)
        assert len(graph.vertices) == 5
        assert expected in (None, graph)
        expected = graph


def test_as_a_generator(tmp_path: Path) -> None:
    image = str(drawn(tmp_path, *["." * 9] * 6))
    assert (
        occupancy(seed=3, image=image, cell=3)
        == occupancy(seed=4, image=image, cell=3)
        == from_image(image, 3)
    )


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"cell": 0}, "cell: must be a whole number of pixels, 1 or more, is 0"),
        ({"cell": 2.5}, "cell: must be a whole number of pixels, 1 or more, is 2.5"),
        ({"free": 2}, "free: must be a number from 0 to 1, is 2"),
        ({"min_share": "all"}, "min_share: must be a number from 0 to 1, is all"),
        ({"free": 0}, "image: MAP has no pixel lighter than free = 0; white is free, black is not"),
        ({"cell": 8}, "cell: blocks of 8 pixels leave no two cells of MAP that touch; choose less"),
        ({"min_share": 1.0}, "min_share: no cell of MAP fills 1.0 of its block; choose less"),
        ({"path": "none.png"}, "image: none.png cannot be read (No such file or directory)"),
        ({"path": __file__}, f"image: {__file__} cannot be read (it is no PGM or PNG image)"),
        ({"path": 7}, "image: must be the path of an image, is 7"),
    ],
)
def test_refusals(given: dict[str, Any], sentence: str, tmp_path: Path) -> None:
    image = drawn(tmp_path, "...#", "#...", "...#", "#...")
    with pytest.raises(ValueError) as refused:  # noqa: PT011
        from_image(**{"path": image, "cell": 4, **given})
    assert str(refused.value) == sentence.replace("MAP", str(image))


def test_too_many_cells(tmp_path: Path) -> None:
    image = drawn(tmp_path, *["." * 101] * 100)
    with pytest.raises(
        ValueError, match=r"cell: blocks of 1 pixels cut .* into 10100 cells, more than 10000; choose more"
    ):
        from_image(image, 1)


@pytest.mark.parametrize("name", ["map.png", "map.pgm"])
def test_torn_images(name: str, tmp_path: Path) -> None:
    """They are refused, unless all pixels are there and only what is around them is missing."""
    image = drawn(tmp_path, *["." * 9] * 6, name=name)
    whole, graph, refused = image.read_bytes(), from_image(image, 3), 0
    for length in range(len(whole)):
        image.write_bytes(whole[:length])
        try:
            found = from_image(image, 3)
        except ValueError as error:
            refused += str(error).startswith(f"image: {image} cannot be read (") and "\n" not in str(error)
        else:
            assert found == graph
            refused += 1
    assert refused == len(whole)


@pytest.mark.parametrize(("module", "needed"), [("PIL", "Pillow"), ("scipy", "SciPy")])
def test_without(module: str, needed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    image = drawn(tmp_path, "..", "..")
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ModuleNotFoundError, match=rf"need {needed}; install heliograph\[desk\]"):
        from_image(image, 1)

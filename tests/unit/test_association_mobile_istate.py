"""The i-state of moving robots, rule by rule (Ivanov & Shell 2016, Alg. 2)."""

from __future__ import annotations

import pytest

from agent.behaviours.association.mobile_istate import MobileIState


def test_it_starts_empty() -> None:
    istate = MobileIState()
    assert (istate.edges(), istate.matches(), istate.wireless, istate.visual) == ({}, {}, [], [])


def test_newcomers_of_one_step_may_belong_together() -> None:
    istate = MobileIState()
    istate.update(["b", "a"], [7, 3, 5], [7, 3])
    assert istate.edges() == {3: ["a", "b"], 7: ["a", "b"]}  # 5 is in view, and has not been lit yet
    assert istate.wireless == ["a", "b"]
    istate.update(["b"], [7, 3, 5], [3])
    assert istate.matches() == {3: "b", 7: "a"}


def test_the_observation_with_which_ids_enter_removes_nothing() -> None:
    istate = MobileIState()
    istate.update(["a"], [1], [1])
    istate.update(["b"], [1, 2], [2])
    assert istate.edges() == {1: ["a"], 2: ["b"]}  # a was silent while 2 was lit: no edge to strike


def test_new_ids_get_no_edges_to_old_ones() -> None:
    istate = MobileIState()
    istate.update(["a", "b"], [1], [1])
    istate.update(["a", "b", "c"], [1, 2], [1, 2])
    assert istate.edges() == {1: ["a", "b"], 2: ["c"]}
    istate.update(["d"], [1, 2], [])  # a new voice without a new light
    assert istate.edges() == {1: ["a", "b"], 2: ["c"]}
    istate.update(["d"], [1, 2, 3], [3])  # and when the light comes, the voice is old
    assert istate.edges() == {1: ["a", "b"], 2: ["c"], 3: []}


def test_edges_go_whose_ends_are_not_alike_active() -> None:
    istate = MobileIState()
    istate.update(["a", "b", "c"], [1, 2, 3], [1, 2, 3])
    istate.update(["a", "b"], [1, 2, 3], [1])
    assert istate.edges() == {1: ["a", "b"], 2: ["c"], 3: ["c"]}
    istate.update([], [1, 2, 3], [])
    assert istate.edges() == {1: ["a", "b"], 2: ["c"], 3: ["c"]}
    istate.update(["a"], [1, 2, 3], [2])
    assert istate.edges() == {1: ["b"], 2: [], 3: ["c"]}


def test_a_light_that_leaves_view_goes_and_comes_back_as_a_stranger() -> None:
    istate = MobileIState()
    istate.update(["a"], [1], [1])
    assert istate.matches() == {1: "a"}
    istate.update([], [], [])
    assert (istate.visual, istate.wireless) == ([], ["a"])
    istate.update(["a"], [1], [1])
    assert istate.edges() == {1: []}  # a is an old voice


def test_a_light_is_lost_before_its_edges_are_judged() -> None:
    istate = MobileIState()
    istate.update(["a", "b"], [1, 2], [1, 2])
    istate.update(["a"], [2], [2])
    assert istate.edges() == {2: ["a"]}


def test_a_dark_light_stays_in_the_list_while_it_is_in_view() -> None:
    istate = MobileIState()
    istate.update(["a"], [1], [1])
    for _ in range(5):
        istate.update([], [1], [])
        assert istate.edges() == {1: ["a"]}


def test_a_voice_is_dropped_after_exactly_so_many_silent_steps() -> None:
    istate = MobileIState(drop_time=3)
    istate.update(["a"], [1], [1])
    for _ in range(2):
        istate.update([], [1], [])
        assert (istate.wireless, istate.edges()) == (["a"], {1: ["a"]})
    istate.update([], [1], [])
    assert (istate.wireless, istate.edges()) == ([], {1: []})


def test_speaking_in_time_starts_the_count_anew() -> None:
    istate = MobileIState(drop_time=3)
    istate.update(["a"], [1], [1])
    for _ in range(4):
        istate.update([], [1], [])
        istate.update([], [1], [])
        istate.update(["a"], [1], [1])
        assert istate.edges() == {1: ["a"]}


def test_a_dropped_voice_comes_back_as_a_stranger() -> None:
    istate = MobileIState(drop_time=1)
    istate.update(["a"], [1], [1])
    istate.update([], [1], [])
    assert istate.edges() == {1: []}
    istate.update(["a"], [1, 2], [1, 2])
    assert istate.edges() == {1: [], 2: ["a"]}  # new with 2, while 1 is an old light


def test_the_bit_of_a_dropped_voice_is_free_for_another() -> None:
    istate = MobileIState(drop_time=2)
    istate.update(["a", "b"], [1, 2], [1, 2])
    istate.update(["b"], [1, 2], [2])
    istate.update(["b", "c"], [1, 2, 3], [2, 3])  # a is dropped, c enters
    assert istate.edges() == {1: [], 2: ["b"], 3: ["c"]}


def test_lights_that_are_not_in_view_are_ignored() -> None:
    istate = MobileIState()
    istate.update(["a"], [], [1])
    assert istate.edges() == {}


@pytest.mark.parametrize("drop_time", [0, -1])
def test_a_drop_time_below_one_is_refused(drop_time: int) -> None:
    with pytest.raises(ValueError, match=f"drop_time is 1 step or more, not {drop_time}"):
        MobileIState(drop_time)


# --- the radio reaches farther than the camera ---------------------------------------------------------


def test_new_lights_may_belong_to_old_voices_that_are_active() -> None:
    istate = MobileIState(wireless_exceeds_visual=True)
    istate.update(["a", "b"], [], [])  # heard, too far to be seen
    istate.update(["a", "c"], [1], [1])
    assert istate.edges() == {1: ["a", "c"]}  # a is old and active, b old and silent, c new


def test_old_voices_that_are_associated_are_no_candidates() -> None:
    istate = MobileIState(wireless_exceeds_visual=True)
    istate.update(["a"], [1], [1])
    istate.update(["a", "b"], [1, 2], [1, 2])
    assert istate.edges() == {1: ["a"], 2: ["b"]}


def test_whether_a_voice_is_associated_is_judged_after_this_step_has_struck_out_edges() -> None:
    istate = MobileIState(wireless_exceeds_visual=True)
    istate.update(["a", "b"], [1], [1])
    istate.update(["a"], [1, 2], [1, 2])  # leaves 1 with a alone
    assert istate.edges() == {1: ["a"], 2: []}


def test_a_voice_among_several_candidates_is_not_associated() -> None:
    istate = MobileIState(wireless_exceeds_visual=True)
    istate.update(["a", "b"], [1], [1])
    istate.update(["a", "b"], [1, 2], [1, 2])
    assert istate.edges() == {1: ["a", "b"], 2: ["a", "b"]}


def test_a_voice_whose_light_has_left_is_free_again() -> None:
    istate = MobileIState(wireless_exceeds_visual=True)
    istate.update(["a"], [1], [1])
    istate.update(["a"], [2], [2])
    assert istate.edges() == {2: ["a"]}


def test_old_lights_get_no_edges_to_new_voices() -> None:
    istate = MobileIState(wireless_exceeds_visual=True)
    istate.update(["a"], [1], [1])
    istate.update(["a", "b"], [1], [1])
    assert istate.edges() == {1: ["a"]}

"""The selection looks back: it leaves what plain forward selection would keep for ever."""

from ambient_trainer.selection.floating import best_sets, swaps, thinned


def test_a_swap_reaches_what_no_growth_of_a_beam_does():
    """Twenty sensors are better alone than either of the pair; one of the two shows once another is there."""

    def score(sets):
        found = []
        for each in sets:
            alone = 1.0 + 0.001 * min(each) if min(each) < 20 else 5.0
            found.append({0: alone, 1: 0.9 if len(each) == 2 else 5.0, 2: 0.1}[len({20, 21} & set(each))])
        return found

    assert best_sets(range(22), 2, score) == [(0,), (20, 21)]


def test_the_search_goes_back_to_a_smaller_set():
    """(2, 3) is only seen when (1, 2, 3) loses a member: from every single one, both its members look bad."""
    scores = {(1,): 0.9, (2,): 1.0, (3,): 1.0, (1, 2): 0.8, (1, 3): 0.8, (2, 3): 0.1, (1, 2, 3): 0.3}
    asked = []

    def score(sets):
        asked.extend(sets)
        return [scores.get(each, 5.0 + len(each)) for each in sets]

    assert best_sets(range(8), 3, score) == [(1,), (2, 3), (1, 2, 3)]


def test_more_is_not_asked_for_than_there_is():
    assert best_sets([4, 7], 6, lambda sets: [float(len(each)) for each in sets]) == [(4,), (4, 7)]


def test_swaps_and_thinning_by_hand():
    assert swaps((1, 3), [1, 2, 3]) == [(1, 2, (2, 3)), (3, 2, (1, 2))]
    assert thinned([(1, 2, 3)]) == {(1, 2), (1, 3), (2, 3)}

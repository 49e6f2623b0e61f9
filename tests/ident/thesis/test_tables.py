"""The thesis's tables of identifiability agree with each other."""

from __future__ import annotations

from ballbar.ident.thesis.tables import REMOVED, TABLE_3_2, TABLE_3_4, THESIS_COSTS


def test_of_every_group_of_dependent_parameters_one_is_left() -> None:
    """Table 3.2 and sec. 3.3."""
    assert TABLE_3_2.keys() == THESIS_COSTS.keys()
    groups = [group for cost in TABLE_3_2.values() for group in cost]
    left = [[name for name in group.split(" | ") if name not in REMOVED] for group in groups]
    assert [len(names) for names in left] == [1] * len(groups)


def test_what_moves_is_said_of_every_parameter_that_was_left_out() -> None:
    """Table 3.4."""
    assert tuple(TABLE_3_4) == REMOVED
    assert all(moved and not {name, *REMOVED} & set(moved) for name, moved in TABLE_3_4.items())

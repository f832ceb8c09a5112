"""The paper's synthetic cases: what they must show (design: a 0.4 m cube centred 1.1 m away, surface rays only)."""

from __future__ import annotations

from dataclasses import replace

import pytest

from vfoa.simulation import CASES, best_setting, simulate, statements, tuning_sums


@pytest.fixture(scope="module")
def few():
    return simulate(n_rays=(4, 40), radii_cm=(5, 10, 20, 30, 40))


def total(rows, case, n_rays, radius_cm):
    (row,) = (row for row in rows if (row.case, row.n_rays, row.radius_cm) == (case, n_rays, radius_cm))
    return row.total


@pytest.mark.parametrize(
    ("n_rays", "radius_cm", "expected"),
    [(40, 5, 0.99), (40, 10, 0.95), (40, 20, 0.82), (4, 30, 0.0), (40, 30, 0.19), (40, 40, 0.0)],
)
def test_both_cues_on_the_centre_give_less_as_the_cone_widens(few, n_rays, radius_cm, expected):
    assert total(few, "1 both on the centre", n_rays, radius_cm) == pytest.approx(expected, abs=0.005)


def test_every_setting_has_one_row_for_each_object_of_each_case(few):
    keys = [(row.case, row.n_rays, row.radius_cm, row.object) for row in few]
    objects = sum(len(case.objects) for case in CASES)
    assert len(keys) == len(set(keys)) == objects * 2 * 5
    assert all(row.total == pytest.approx(row.gaze + row.head) for row in few)


def test_the_sums_over_all_cases_add_up_from_either_side(few):
    everything = sum(row.total for row in few)
    by_rays, by_radius = tuning_sums(few, "n_rays"), tuning_sums(few, "radius_cm")
    assert list(by_rays) == [4, 40]
    assert list(by_radius) == [5, 10, 20, 30, 40]
    assert sum(by_rays.values()) == pytest.approx(everything)
    assert sum(by_radius.values()) == pytest.approx(everything)


def test_no_setting_has_a_greater_sum_than_the_best(few):
    sums = {
        (n, r): sum(row.total for row in few if (row.n_rays, row.radius_cm) == (n, r))
        for n in (4, 40)
        for r in (5, 10, 20, 30, 40)
    }
    assert sums[best_setting(few)] == pytest.approx(max(sums.values()))


def test_every_statement_of_the_paper_holds(few):
    found = statements(few)
    assert len(found) == 14
    assert [s.claim for s in found if not s.holds] == []


def test_a_statement_fails_where_its_numbers_are_wrong(few):
    silenced = tuple(replace(row, gaze=0.5, head=0.5, total=0.5) for row in few)
    assert not any(s.holds for s in statements(silenced) if s.claim.startswith("both on the centre, total"))

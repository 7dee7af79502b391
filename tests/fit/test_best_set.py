"""Probes to combine: the quick search against all sets."""

import itertools

import numpy as np
import pytest

from icjax.fit import design, finger_candidates
from icjax.model import index_finger

MODEL = index_finger(0.19, "fixed")


@pytest.fixture(scope="module", params=[0, 2], ids=["no catch trials", "two"])
def candidates(request):
    return design(MODEL, finger_candidates(MODEL), request.param)


def worst(plan, chosen, contacts):
    return plan.expected(chosen, contacts).width.max()


@pytest.mark.parametrize("contacts", [12, None])
@pytest.mark.parametrize("k", [1, 2, 3])
def test_best_set_is_within_five_per_cent_of_the_best_of_all(candidates, k, contacts):
    chosen = candidates.best_set(k, contacts)
    assert len(set(chosen)) == k
    everything = itertools.combinations(range(len(candidates.probes)), k)
    best = min(worst(candidates, item, contacts) for item in everything)
    assert worst(candidates, chosen, contacts) <= 1.05 * best


def test_one_after_the_other_alone_is_worse(candidates):
    """What the exchange is for; without catch trials the best two hold the best one."""
    first, plan = candidates.best_set(1, 12), candidates
    rest = [item for item in range(len(plan.probes)) if item not in first]
    greedy = min(worst(plan, (*first, item), 12) for item in rest)
    found = worst(plan, plan.best_set(2, 12), 12)
    assert found <= greedy
    if plan.catch_trials:
        assert found < greedy


def test_one_and_all(candidates):
    assert candidates.best_set(1) == candidates.ranking()[:1]
    assert sorted(candidates.best_set(13)) == list(range(13))
    for k in (0, 14):
        with pytest.raises(ValueError, match=f"k = {k}"):
            candidates.best_set(k)


def test_no_exchange_narrows_a_best_set(candidates):
    chosen = candidates.best_set(3, 12)
    rest = np.setdiff1d(np.arange(13), chosen)
    for at, item in itertools.product(range(3), rest.tolist()):
        other = (*chosen[:at], item, *chosen[at + 1 :])
        assert worst(candidates, other, 12) >= worst(candidates, chosen, 12) * (1 - 1e-9)

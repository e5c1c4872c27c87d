"""Effects that nobody stated, against the rows of a comparison."""

from types import SimpleNamespace

import pytest

from model.effects.effect import Effect
from rigctl.comparison.explain import unstated_effects, unstated_lines
from rigctl.comparison.rows import Row

COUNTS = {"dn_0": 1000.0, "dn_45": 900.0, "dn_90": 800.0}


def predictions(**more):
    numbers = {name: value + more.get(name, 0.0) for name, value in COUNTS.items()}
    return {"panel": SimpleNamespace(quantities={name: {"mean": value} for name, value in numbers.items()})}


def rows(**off):
    return [
        Row(
            region="panel",
            quantity=name,
            statistic="mean",
            predicted=value,
            measured=value + off.get(name, 0.0),
            std_error=1.0,
            std_error_inputs=0.0,
            agrees=abs(off.get(name, 0.0)) < 3.0,
        )
        for name, value in COUNTS.items()
    ]


@pytest.fixture(autouse=True)
def no_ratios(monkeypatch):
    monkeypatch.setattr("rigctl.comparison.explain.with_ratios", lambda found: found)


DRIFTING = [(Effect.DRIFT, predictions(dn_0=-10.0, dn_90=10.0))]


def test_an_effect_that_would_make_the_residuals_is_said_to_explain_them():
    # A drift of half the size, the other way round.
    (found,) = unstated_effects(rows(dn_0=5.0, dn_90=-5.0), predictions(), DRIFTING, {})
    assert found.removes == pytest.approx(1.0)
    assert found.errors == pytest.approx(10.0)
    large, likely = unstated_lines([found], disagrees=True)
    assert large.endswith("move a tested number: drift (10 standard errors for 0.001 to 0.01)")
    assert likely.endswith("explain the residuals: drift (100 % of their chi-square; 0.001 to 0.01)")


def test_residuals_that_an_effect_cannot_make_are_not_explained_by_it():
    (found,) = unstated_effects(rows(dn_45=5.0), predictions(), DRIFTING, {})
    assert found.removes == 0.0
    assert len(list(unstated_lines([found], disagrees=True))) == 1


def test_surroundings_add_light_and_take_none():
    (found,) = unstated_effects(rows(dn_0=-5.0), predictions(), [(Effect.ADJACENCY, predictions(dn_0=10.0))], {})
    assert found.removes == 0.0


def test_what_the_run_shows_decides():
    small = [(Effect.DRIFT, predictions(dn_0=-0.1, dn_90=0.1))]
    (found,) = unstated_effects(rows(dn_0=5.0), predictions(), small, {Effect.DRIFT: (1e-4, 2e-5)})
    assert found.is_shown
    assert found.range == "the run shows 0.000100 +- 0.000020"
    assert not list(unstated_lines([found], disagrees=True))

"""Verdicts of inequalities: what counts, what cannot be seen, and what only noise would decide."""

from rigctl.paper.scenes import Number
from rigctl.paper.statements import Reading, above, falls, peak_within, some_step_rises


def number(value, *, error=0.0, kind="plain"):
    return Number(label=f"{value}", value=value, error=error, kind=kind)


def test_a_margin_far_above_the_numerical_error_holds_or_is_opposite():
    assert above(number(2.0, error=0.1), number(1.0, error=0.1)).verdict == "holds"
    assert above(number(1.0, error=0.1), number(2.0, error=0.1)).verdict == "opposite"


def test_a_margin_within_the_numerical_error_is_no_verdict():
    assert above(number(2.0, error=0.3), number(1.0, error=0.3)).verdict == "ambiguous"


def test_what_is_always_detected_cannot_be_compared():
    sure = number(0.9995, kind="p_detection")
    assert above(sure, number(0.9999, kind="p_detection")).verdict == "cannot_be_seen"
    assert above(sure, number(0.99, kind="p_detection")).verdict == "holds"


def test_ratios_of_noise_are_the_noise_floor():
    assert above(number(1.957, kind="exact_snr"), number(1.950, kind="exact_snr")).verdict == "noise_floor"
    assert above(number(2.07, kind="exact_snr"), number(2.80, kind="exact_snr")).verdict == "opposite"


def test_one_reversed_inequality_refutes_a_reading():
    reading = Reading(name="falls", tests=falls([number(3.0), number(1.0), number(2.0)]))
    assert reading.verdict == "opposite"
    assert reading.deciding.margin == -1.0


def test_a_reading_without_numbers_cannot_be_seen():
    assert Reading(name="their data", tests=()).verdict == "cannot_be_seen"


def test_peaks_and_steps():
    numbers = [number(value) for value in (1.0, 3.0, 2.0)]
    assert peak_within(numbers, (10.0, 50.0, 80.0), 40.0, 60.0).verdict == "holds"
    assert peak_within(numbers, (10.0, 50.0, 80.0), 60.0, 80.0).verdict == "opposite"
    assert some_step_rises(numbers).verdict == "holds"
    assert some_step_rises(numbers[1:]).verdict == "opposite"

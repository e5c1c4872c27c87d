import numpy as np
import pytest

from sim_devices.faults import LineNoise

DATA = bytes(range(256)) * 40


def test_a_sound_line_changes_nothing() -> None:
    assert LineNoise().corrupt(DATA, np.random.default_rng(1)) == DATA


@pytest.mark.parametrize(("noise", "change"), [(LineNoise(drop=0.1), -1), (LineNoise(double=0.1), +1)])
def test_bytes_are_lost_or_doubled_as_often_as_asked(noise: LineNoise, change: int) -> None:
    got = noise.corrupt(DATA, np.random.default_rng(2))
    happened = change * (len(got) - len(DATA))
    # binomial, 5 sigma
    assert abs(happened - 0.1 * len(DATA)) <= 5.0 * np.sqrt(len(DATA) * 0.1 * 0.9)


def test_a_flip_changes_one_bit_of_a_byte() -> None:
    got = LineNoise(flip=1.0).corrupt(DATA, np.random.default_rng(3))
    assert all((before ^ after).bit_count() == 1 for before, after in zip(DATA, got, strict=True))


def test_the_same_seed_damages_alike() -> None:
    noise = LineNoise(drop=0.1, double=0.1, flip=0.1)
    assert noise.corrupt(DATA, np.random.default_rng(4)) == noise.corrupt(DATA, np.random.default_rng(4))

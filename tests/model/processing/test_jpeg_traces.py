import numpy as np
import pytest

from model.processing.jpeg_traces import jpeg_traces
from tests.worldlike import Faults, expose, random_world


@pytest.mark.parametrize("seed", range(4))
def test_jpeg_is_found_and_nothing_where_there_was_none(seed: int) -> None:
    for quality in (None, 70, 88):
        draws = np.random.default_rng(seed)
        world = random_world(draws)
        frame = expose(world, Faults(jpeg_quality=quality), draws)[0]
        found = jpeg_traces(frame)
        assert found is not None
        assert found.is_found is (quality is not None)


def test_an_even_picture_tells_nothing() -> None:
    assert jpeg_traces(np.full((64, 64), 7.0)) is None
    assert jpeg_traces(np.zeros((5, 5))) is None
